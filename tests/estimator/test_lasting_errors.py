"""Covariances contain errors that grow with the deformation and its speed, and are as narrow as lengths agree."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

import tensegraph as tg
from pipelines import pipeline_of
from tensegraph.estimator.lasting_errors import (
    BALANCE_SHARE,
    CREEP_S,
    CREEP_SHARE,
    DEFORMATION_SHARE,
    LIVE_RATE_S,
    RATE_S,
    SWING_WINDOW_S,
    LastingErrors,
    frames_near,
)
from tensegraph.models.evaluation.alignment import interpolated_within
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.shape import Reason, Shape, Status
from tensegraph.models.structure.structure import Structure
from tensegraph.models.values.readings import BENDING, STRETCHING, Flag, SensorDrift, TendonLengths

SIGMA_M = 1e-3
NODE = 5
"""A free node."""


def shown(
    rest: RestShape,
    *,
    moved_m: float = 0.0,
    t_s: float = 0.0,
    mode: int = STRETCHING,
    flag: int = 0,
    status: Status = Status.OK,
    rest_in_doubt: bool = False,
    own_rate_per_s: float = 0.0,
) -> Shape:
    """The rest shape with one node moved along x; its covariance is the rest shape's and noise."""
    tendons = len(rest.structure.tendons)
    position_m = rest.node_position_m.copy()
    position_m[NODE, 0] += moved_m
    modes, flags = np.full(tendons, STRETCHING), np.zeros(tendons, dtype=np.int64)
    modes[0], flags[0] = mode, flag
    lengths = TendonLengths(t_s, np.full(tendons, 0.17), np.full(tendons, 0.001), modes, flags)
    none = np.zeros(tendons)
    drift = SensorDrift(none, none, none, own_rate_per_s=own_rate_per_s)
    lengths = replace(lengths, rest_in_doubt=rest_in_doubt, drift=drift)
    covariance_m2 = rest.covariance_m2 + SIGMA_M**2 * np.eye(position_m.size)
    return Shape(t_s, position_m, covariance_m2, status, lengths)


def along_x_m2(shape: Shape) -> float:
    """The variance of the moved node along x."""
    return float(shape.node_covariance_m2[NODE, 0, 0])


def widened_in_trial(lasting: LastingErrors, shape: Shape, velocity: np.ndarray, error_scale: float = 1.0) -> Shape:
    """The shape in batch, with the same velocity in the frames around it."""
    return lasting.of_trial(shape, velocity, np.stack([velocity] * 3), error_scale)


def test_numbers_worked_by_hand(structure: Structure, rest: RestShape) -> None:
    """10 mm of deformation add (0.07 10 mm)^2 = 0.49 mm^2, 20 mm/s for a second 2 (0.05 s 20 mm/s)^2 = 2 mm^2.

    Live, where they have lasted for 2 s, 2 (0.1 s 20 mm/s)^2 = 8 mm^2.
    """
    assert (DEFORMATION_SHARE, RATE_S, LIVE_RATE_S, SWING_WINDOW_S) == (0.07, 0.05, 0.1, 1.0)
    lasting = LastingErrors(structure, rest)
    shape = shown(rest, moved_m=0.01)
    still = np.zeros_like(shape.node_position_m)
    moving = still.copy()
    moving[NODE, 0] = 0.02
    for velocity, added_m2 in ((still, 0.49e-6), (moving, 2.49e-6)):
        widened = widened_in_trial(lasting, shape, velocity)
        assert along_x_m2(widened) - along_x_m2(shape) == pytest.approx(added_m2)
    lasting = LastingErrors(structure, rest)
    for t_s in np.arange(0.0, 2.0, 0.02):
        shape = shown(rest, moved_m=0.02 * t_s, t_s=t_s)
        live = lasting.observe(shape, 1.0)
    held_m = 0.02 * (t_s - 2 * CREEP_S + (t_s + 2 * CREEP_S) * np.exp(-t_s / CREEP_S))
    expected_m2 = 8e-6 + (0.07 * 0.02 * t_s) ** 2 + np.sum((0.2 * held_m) ** 2)
    assert along_x_m2(live) - along_x_m2(shape) == pytest.approx(expected_m2, rel=0.01)


def test_a_node_that_swings_is_as_uncertain_where_it_turns(structure: Structure, rest: RestShape) -> None:
    """5 mm to and fro in a second: v is zero there, and <v v^T> is (2 pi 5 mm/s)^2 / 2, in batch and live."""
    t_s = np.arange(0.0, 3.01, 0.02)
    moved_m, speed = 0.005 * np.cos(2 * np.pi * t_s), -0.01 * np.pi * np.sin(2 * np.pi * t_s)
    velocity = np.zeros((len(t_s), *rest.node_position_m.shape))
    velocity[:, NODE, 0] = speed
    shapes = [shown(rest, moved_m=m, t_s=t) for t, m in zip(t_s, moved_m, strict=True)]
    mean_square = (0.01 * np.pi) ** 2 / 2
    in_batch = LastingErrors(structure, rest).of_trial(shapes[100], velocity[100], velocity[75:125], 1.0)
    added_m2 = along_x_m2(in_batch) - along_x_m2(shapes[100]) - (0.07 * 0.005) ** 2
    assert added_m2 == pytest.approx(0.05**2 * mean_square, rel=0.01)
    lasting = LastingErrors(structure, rest)
    live = [lasting.observe(shape, 1.0) for shape in shapes]
    sideways_m2 = [along_x_m2(one) - along_x_m2(shape) for one, shape in zip(live, shapes, strict=True)]
    assert min(sideways_m2[60:]) > 0.6 * 0.1**2 * mean_square  # of a velocity that is smoothed over 0.1 s


def test_strips_remember_how_long_they_were_held(structure: Structure, rest: RestShape) -> None:
    """10 mm for 8 s: the first m is (1 - 5 e^-4) 10 mm = 9.1 mm, the second (1 - 2 e^-1) 10 mm, the third 0.3 mm.

    Eight seconds later the first is (5 e^-4 - 9 e^-8) 10 mm; after 1 s it is 0.9 mm.
    """
    assert (CREEP_SHARE, *CREEP_S) == (0.2, 2.0, 8.0, 32.0)
    lasting = LastingErrors(structure, rest)
    still = np.zeros_like(rest.node_position_m)
    m_of = {}
    for t_s in np.arange(0.0, 16.005, 0.01):
        shape = shown(rest, moved_m=0.01 if 0 < t_s < 8.005 else 0.0, t_s=t_s)
        added_m2 = along_x_m2(widened_in_trial(lasting, shape, still)) - along_x_m2(shape)
        m_of[round(t_s, 2)] = np.sqrt(max(added_m2 - (0.49e-6 if 0 < t_s < 8.005 else 0.0), 0.0)) / 0.2

    def left(t_s: float) -> np.ndarray:
        """What both filters have not yet followed of a step."""
        return (1 + t_s / CREEP_S) * np.exp(-t_s / CREEP_S)

    for t_s, each in {1.0: 1 - left(1.0), 8.0: 1 - left(8.0), 16.0: left(8.0) - left(16.0)}.items():
        assert m_of[t_s] == pytest.approx(0.01 * np.linalg.norm(each), rel=0.02)
    np.testing.assert_allclose(1 - left(8.0), [0.908, 0.264, 0.026], atol=5e-4)


@pytest.mark.parametrize("kind", ["lengths", "forces"])
def test_lengths_that_no_strips_tell_have_the_errors_of_the_balance_alone(kind, structure, rest, balanced) -> None:
    """Moved by 20 mm for 30 s: 5 % of it where forces are known, and nothing where they are not."""
    its_rest = balanced if kind == "forces" else rest
    errors = LastingErrors(structure, its_rest)
    for t_s in np.arange(0, 30, 0.1):
        shape = shown(its_rest, moved_m=0.02, t_s=t_s)
        told = replace(shape, lengths=replace(shape.lengths, of_strips=False))
        widened = errors.observe(told, 1.0)
    added_m2 = along_x_m2(widened) - along_x_m2(told)
    assert added_m2 == pytest.approx((BALANCE_SHARE * 0.02) ** 2 if kind == "forces" else 0.0)


def test_a_robot_that_stands_at_rest_has_the_covariance_of_its_frame(structure: Structure, rest: RestShape) -> None:
    lasting = LastingErrors(structure, rest)
    for t_s in (0.0, 0.02, 10.0):
        shape = shown(rest, t_s=t_s)
        np.testing.assert_array_equal(lasting.observe(shape, 1.0).covariance_m2, shape.covariance_m2)


@pytest.mark.parametrize(
    ("change", "is_less"),
    [
        pytest.param({}, True, id="all stretched"),
        pytest.param({"mode": BENDING}, False, id="a bent tendon"),
        pytest.param({"flag": int(Flag.AMBIGUOUS)}, False, id="an ambiguous tendon"),
        pytest.param({"status": Status.PARTIAL}, False, id="sensors left out"),
        pytest.param({"status": Status.DOUBT}, False, id="in doubt"),
        pytest.param({"rest_in_doubt": True}, False, id="the rest in doubt"),
        pytest.param({"own_rate_per_s": 1e-4}, False, id="sensors drift apart"),
    ],
)
def test_errors_are_smaller_where_lengths_agree_and_none_lasts(structure, rest, change, is_less) -> None:
    """The part of the rest shape stays as it is: no frame tells more of it."""
    shape = shown(rest, **change)
    still = np.zeros_like(shape.node_position_m)
    free = structure.free_coordinates
    narrow_m2 = widened_in_trial(LastingErrors(structure, rest), shape, still, 0.6).covariance_m2[np.ix_(free, free)]
    of_rest_m2 = rest.covariance_m2[np.ix_(free, free)]
    share = 0.36 if is_less else 1.0
    np.testing.assert_allclose(narrow_m2 - of_rest_m2, share * SIGMA_M**2 * np.eye(len(free)), atol=1e-18)


@given(moved_m=st.floats(-0.1, 0.1), m_per_s=st.floats(-3.0, 3.0), error_scale=st.floats(0.4, 1.0))
def test_covariances_stay_positive_definite(
    structure: Structure, rest: RestShape, moved_m: float, m_per_s: float, error_scale: float
) -> None:
    shape = shown(rest, moved_m=moved_m)
    velocity = np.full_like(shape.node_position_m, m_per_s)
    covariance_m2 = widened_in_trial(LastingErrors(structure, rest), shape, velocity, error_scale).covariance_m2
    np.testing.assert_array_equal(covariance_m2, covariance_m2.T)
    assert np.linalg.eigvalsh(covariance_m2).min() > 0


def test_a_shaken_robot_keeps_the_covariance_of_its_swings(structure: Structure, rest: RestShape) -> None:
    shape = shown(rest, moved_m=0.03).in_doubt(Reason.MOTION)
    fast = np.ones_like(shape.node_position_m)
    kept = widened_in_trial(LastingErrors(structure, rest), shape, fast)
    np.testing.assert_array_equal(kept.covariance_m2, shape.covariance_m2)


def test_frames_within_half_a_second_are_near() -> None:
    """Of a single frame, at the ends, beside a gap, and of slow frames, of which each is alone."""
    assert frames_near(np.array([3.0])) == [slice(0, 1)]
    steady_s = np.arange(0.0, 2.0, 0.02) + 0.001 * (np.arange(100) % 2)
    near = frames_near(np.concatenate([steady_s, 15.0 + steady_s]))
    assert (near[0], near[50], near[99], near[100]) == (slice(0, 25), slice(25, 75), slice(75, 100), slice(100, 125))
    assert frames_near(np.arange(0.0, 5.0, 1.0)) == [slice(k, k + 1) for k in range(5)]


@pytest.mark.parametrize("method", ["live", "batch"])
def test_pressed_and_fast_nodes_are_in_their_ellipsoids(example, method: str) -> None:
    """On half of the example: more than 80 % of the nodes far from rest or fast, and hardly any beyond 99.9 %."""
    trial = tg.open_trial(example)
    pipeline = pipeline_of(trial.description)
    shapes = list(pipeline.shapes(pipeline.lengths(islice(trial.readings(), 1300), 500), method))
    free = trial.description.structure.free_nodes
    truth = trial.truth()
    truth_m = interpolated_within(np.array([shape.t_s for shape in shapes]), truth.t_s, truth.node_position_m)[:, free]
    error_m = np.array([shape.node_position_m[free] for shape in shapes]) - truth_m
    covariance_m2 = np.array([shape.node_covariance_m2[free] for shape in shapes])
    nees = np.einsum("fni,fnij,fnj->fn", error_m, np.linalg.inv(covariance_m2), error_m)
    far = np.linalg.norm(truth_m - truth_m[0], axis=-1) > 0.01
    fast = np.linalg.norm(np.gradient(truth_m, axis=0), axis=-1) > 0.03 / 50  # 0.03 m/s
    for chosen in (far, fast):
        assert chosen.sum() > 100
        assert (nees[chosen] < chi2.ppf(0.95, 3)).mean() > 0.8
    assert (nees > chi2.ppf(0.999, 3)).mean() < 0.005
