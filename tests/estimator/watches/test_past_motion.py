"""How far a structure may be while no length is read: as far as the trial has shown, by hand and in both estimators."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tensegraph import Settings
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.estimator.watches.past_motion import BUILDS_UP_S, PastMotion
from tensegraph.models.structure.shape import Shape, Status

FREE = np.arange(3)


@pytest.fixture
def shape_at(balanced, lengths_of):
    """Makes the shape of two nodes at a height, with a standard deviation of 1 mm per axis."""
    lengths = lengths_of(balanced.structure, balanced.node_position_m)

    def make(height_m: float, t_s: float = 0.0, status: Status = Status.OK) -> Shape:
        position_m = np.array([[0.0, 0.0, height_m], [0.0, 0.0, 0.0]])
        return Shape(t_s, position_m, 1e-6 * np.eye(6), status, lengths, None)

    return make


def test_the_ellipsoid_reaches_the_shapes_of_before(shape_at) -> None:
    """By hand: at 0 and 40 mm before, and estimated at 10 mm: the mean square is (10^2 + 30^2) / 2 = 22.4 mm squared.

    After one time constant 1 - 1/e of it is added, along z of the free node alone.
    """
    past = PastMotion(FREE)
    for height_m in (0.0, 0.04):
        past.observe(shape_at(height_m))
    widened = past.observe(shape_at(0.01, BUILDS_UP_S, Status.PRIOR_ONLY))
    expected = 1e-6 * np.eye(6)
    expected[2, 2] += (1 - np.exp(-1)) * 5e-4
    np.testing.assert_allclose(widened.covariance_m2, expected, atol=1e-15)
    np.testing.assert_array_equal(widened.node_position_m[0], [0.0, 0.0, 0.01])


def test_shapes_without_lengths_tell_nothing(shape_at) -> None:
    """In a longer gap the past is that before it; and without any past nothing is added."""
    past = PastMotion(FREE)
    unknown = shape_at(0.01, 1.0, Status.PRIOR_ONLY)
    assert past.observe(unknown) is unknown
    past.observe(shape_at(0.02, 1.0))
    for t_s in (1.5, 2.0):
        widened = past.observe(shape_at(0.01, t_s, Status.PRIOR_ONLY))
        assert widened.covariance_m2[2, 2] == pytest.approx(1e-6 + (1 - np.exp((1 - t_s) / BUILDS_UP_S)) * 1e-4)


@given(arrays(np.float64, (7, 2, 3), elements=st.floats(-1, 1)), st.integers(0, 7))
@settings(max_examples=50, deadline=None)
def test_shapes_may_be_learned_one_by_one_or_at_once(position_m, split) -> None:
    """Also, what is added is the mean of the outer products, term by term."""
    at_once, in_parts = PastMotion(FREE), PastMotion(FREE)
    at_once.learn(position_m)
    for part in (position_m[:split], *position_m[split:, None]):
        in_parts.learn(part)
    shape = Shape(0.0, np.zeros((2, 3)), np.zeros((6, 6)), Status.PRIOR_ONLY, None, None)
    x_m = position_m.reshape(7, 6)[:, FREE]
    for past in (at_once, in_parts):
        added_m2 = past.widened(shape, np.inf).covariance_m2[np.ix_(FREE, FREE)]
        np.testing.assert_allclose(added_m2, x_m.T @ x_m / 7, atol=1e-12)


@pytest.mark.parametrize("estimator", [LiveSmoother, BatchOptimizer])
def test_a_gap_is_as_wide_as_the_press_before_it(estimator, balanced, lengths_of) -> None:
    """A node is pressed by 40 mm and let go. Two seconds of no readings later, the ellipsoid holds such a press."""
    structure = balanced.structure
    pressed_m = balanced.node_position_m.copy()
    pressed_m[8, 2] -= 0.04
    frames = []
    for t_s in np.arange(0.0, 6.0, 0.05):
        share = np.sin(np.pi * (t_s - 1.0) / 2) ** 2 if 1.0 < t_s < 3.0 else 0.0
        position_m = balanced.node_position_m + share * (pressed_m - balanced.node_position_m)
        frame = lengths_of(structure, position_m, t_s)
        frames.append(replace(frame, sigma_m=np.full(24, np.inf)) if t_s > 4.0 else frame)
    shapes = list(estimator(structure, balanced, Settings()).estimate(frames))
    without = list(estimator(structure, balanced, Settings()).estimate(frames[:20] + frames[80:]))
    assert {shape.status for shape in shapes[82:]} == {Status.PRIOR_ONLY}
    sigma_m, without_m = (np.sqrt(run[-1].node_covariance_m2[8, 2, 2]) for run in (shapes, without))
    moved_m = np.array([shape.node_position_m[8, 2] for shape in shapes[:81]]) - balanced.node_position_m[8, 2]
    assert sigma_m**2 == pytest.approx(without_m**2 + np.mean(moved_m**2), rel=0.1)
