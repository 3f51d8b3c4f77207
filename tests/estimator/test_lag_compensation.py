"""Live shapes are moved on by the lag of their lengths, as far as their velocity is known."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

import tensegraph as tg
from pipelines import pipeline_of
from tensegraph.estimator.lag_compensation import VELOCITY_HOLDS_S, LagCompensation
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.evaluation.alignment import interpolated_within
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.readings import TendonLengths

LAG_S = 0.04
NOISE_M = 1e-3


def shown(t_s: float, position_m, *, sigma_m: float = NOISE_M, lag_s: float = LAG_S, measured: bool = True) -> Shape:
    """A shape of two nodes, of which the second one stands still, at the first one's position."""
    nodes_m = np.array([position_m, [0.0, 0.0, 0.0]], dtype=float)
    sigma = np.array([0.001 if measured else np.inf])
    lengths = TendonLengths(t_s, np.array([0.1]), sigma, np.array([1]), np.array([0]), lag_s=lag_s)
    return Shape(t_s, nodes_m, sigma_m**2 * np.eye(6), Status.OK, lengths)


def last(shapes: list[Shape]) -> Shape:
    compensation = LagCompensation()
    return [compensation.now(shape) for shape in shapes][-1]


def at_velocity(m_per_s: float, steps_s: list[float], **of_shape) -> list[Shape]:
    return [shown(t_s, [m_per_s * t_s, 0.0, 0.0], **of_shape) for t_s in np.cumsum(steps_s)]


def test_a_number_worked_by_hand() -> None:
    """0.025 m/s, as fast as sigma / T = 0.001 / 0.04: half of tau v = 1 mm is gone on, C grows by 0.2 (0.5 mm)^2."""
    shape = last(at_velocity(0.025, [0.02] * 3))
    np.testing.assert_allclose(shape.node_position_m, [[0.025 * 0.06 + 0.5e-3, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-12)
    expected_m2 = NOISE_M**2 * np.eye(6)
    expected_m2[0, 0] += LAG_S / VELOCITY_HOLDS_S * 0.5e-3**2
    np.testing.assert_allclose(shape.covariance_m2, expected_m2, rtol=1e-12, atol=1e-24)


@given(st.floats(0.3, 3.0), st.floats(0.01, 0.09))
def test_a_fast_node_is_where_it_is_at_the_time_of_the_frame(m_per_s: float, step_s: float) -> None:
    """Of any rate of frames: the position is that of the time, to the share of the speed that may be an error."""
    shape = last(at_velocity(m_per_s, [step_s] * 20))
    moved_m = shape.node_position_m[0, 0] - m_per_s * 20 * step_s
    assert 0.99 * LAG_S * m_per_s <= moved_m <= LAG_S * m_per_s


@pytest.mark.parametrize(
    "shapes",
    [
        pytest.param([shown(0.02 * k, [0.05 * (k == 9), 0.0, 0.0]) for k in range(10)], id="a jump"),
        pytest.param([shown(0.02 * k, [0.05 * (k % 2), 0.0, 0.0]) for k in range(10)], id="to and fro"),
        pytest.param(at_velocity(1.0, [0.02] * 8 + [0.3]), id="after a gap"),
        pytest.param(at_velocity(1.0, [0.3] * 8), id="frames too far apart"),
        pytest.param(at_velocity(1.0, [0.02] * 2), id="too few frames"),
        pytest.param(at_velocity(1.0, [0.02] * 8, lag_s=0.0), id="no lag"),
        pytest.param(at_velocity(1.0, [0.02] * 8, measured=False), id="no lengths"),
        pytest.param([shown(0.02 * k, [0.0, 0.0, 0.0], sigma_m=0.0) for k in range(10)], id="exact, and at rest"),
    ],
)
def test_an_unknown_velocity_moves_nothing(shapes: list[Shape]) -> None:
    np.testing.assert_array_equal(last(shapes).node_position_m, shapes[-1].node_position_m)
    np.testing.assert_array_equal(last(shapes).covariance_m2, shapes[-1].covariance_m2)


def test_few_shapes_are_held() -> None:
    compensation = LagCompensation()
    for step_s in (0.001, 0.02, 1.0):
        for shape in at_velocity(0.1, [step_s] * 300):
            compensation.now(replace(shape, t_s=shape.t_s + 1e3 * step_s))
        assert len(compensation._before) <= LAG_S / step_s + 3


def test_presses_of_the_example_are_followed_better(example) -> None:
    """Fast nodes are a seventh nearer to the truth and more often in their ellipsoids, slow ones 2 % further away.

    In the first thirteen of thirty seconds.
    """
    trial = tg.open_trial(example)
    pipeline = pipeline_of(trial.description)
    smoother = LiveSmoother(pipeline.rest.structure, pipeline.rest, pipeline.settings)
    late = [smoother.update(lengths) for lengths in pipeline.lengths(islice(trial.readings(), 1300), 500)]
    compensation = LagCompensation()
    now = [compensation.now(shape) for shape in late]
    free = trial.description.structure.free_nodes
    truth = trial.truth()
    truth_m = interpolated_within(np.array([shape.t_s for shape in now]), truth.t_s, truth.node_position_m)[:, free]
    fast = np.linalg.norm(np.gradient(truth_m, axis=0), axis=-1) > 0.03 / 50  # 0.03 m/s

    def errors(shapes: list[Shape]) -> tuple[float, float, float]:
        """The rms error of fast and of slow nodes, and the share of fast ones in their ellipsoids of 95 %."""
        error_m = np.array([shape.node_position_m[free] for shape in shapes]) - truth_m
        covariance_m2 = np.array([shape.node_covariance_m2[free] for shape in shapes])
        nees = np.einsum("fni,fnij,fnj->fn", error_m, np.linalg.inv(covariance_m2), error_m)
        square_m2 = (error_m**2).sum(axis=-1)
        rms_m = np.sqrt([square_m2[fast].mean(), square_m2[~fast].mean()])
        return *rms_m, (nees[fast] < chi2.ppf(0.95, 3)).mean()

    fast_m, slow_m, inside = errors(now)
    late_fast_m, late_slow_m, late_inside = errors(late)
    assert fast_m < 0.85 * late_fast_m
    assert slow_m < 1.025 * late_slow_m
    assert inside > late_inside + 0.12
