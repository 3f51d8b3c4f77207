"""Inertial sensors that the others outvote: by hand at the limit, and in a filter whose sensor has a stuck axis."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.estimator.free_standing.contacts import nothing_stands
from tensegraph.estimator.free_standing.imu_trust import OUTVOTED_SIGMA, ImuTrust
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.pose_start import state_at_rest
from tensegraph.estimator.free_standing.prediction import Prediction
from tensegraph.factors.imu import ImuArray
from tensegraph.models.pose.imu_samples import ImuSamples
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot, Imu
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import ImuReading
from tensegraph.models.values.rotations import across, rotation, rotation_vector

SENSOR_RAD = 0.03
SETTINGS = PoseSettings()


def rod_directions(balanced: RestShape, rods: list[int]) -> np.ndarray:
    first, second = balanced.structure.rods[rods].T
    along = balanced.node_position_m[second] - balanced.node_position_m[first]
    return along / np.linalg.norm(along, axis=1, keepdims=True)


def disagreeing(balanced: RestShape, rods: list[int], body_rad: float, off_rad: float) -> tuple[list[int], list[int]]:
    """Return which sensors are outvoted, and which are doubted, where the first has turned across its rod, alone."""
    directions = rod_directions(balanced, rods)
    imus = tuple(Imu(rod, 0.5, axis) for rod, axis in zip(rods, directions, strict=True))
    robot = FreeStandingRobot(floor=Floor(0.0, UP), imus=imus, rest_seconds=0.2)
    state = state_at_rest(balanced.node_position_m, robot)
    turned = state.imu_turn.copy()
    turned[0] = rotation(off_rad * across(directions[0])[0])
    covariance = np.zeros((state.layout.size, state.layout.size))
    for part, sigma in ((state.layout.turn, body_rad), (state.layout.imu_turn, SENSOR_RAD)):
        here = np.arange(part.start, part.stop)
        covariance[here, here] = sigma**2
    nodes = len(balanced.node_position_m)
    placed = PlacedShape(
        replace(state, imu_turn=turned), balanced.node_position_m - state.position_m, np.zeros((3 * nodes, 3 * nodes))
    )
    trust = ImuTrust(len(imus), 0.2, SETTINGS)
    trust.outvotes(ImuArray(imus, balanced.structure.rods), Prediction(placed, covariance, covariance, np.zeros(3)))
    return np.flatnonzero(trust.is_lost).tolist(), np.flatnonzero(trust.contradicted).tolist()


@pytest.mark.parametrize(("sigmas", "expected"), [(0.9, []), (1.1, [0])])
def test_the_limit_by_hand(balanced, sigmas: float, expected: list[int]) -> None:
    """Of a body whose turn is known, a sensor is off by its own sigma and that of the rod's lag."""
    sigma_rad = np.sqrt(SENSOR_RAD**2 + (SETTINGS.deformation_rad_per_s * SETTINGS.shape_holds_s) ** 2 + 1e-6)
    off_rad = float(np.arcsin(sigmas * OUTVOTED_SIGMA * sigma_rad))
    assert disagreeing(balanced, [0, 2, 4], 1e-6, off_rad) == (expected, expected)


def test_three_sensors_outvote_one_where_nothing_else_tells_how_the_body_has_turned(balanced) -> None:
    assert disagreeing(balanced, [0, 2, 4], 3.0, 0.8) == ([0], [0])


def test_of_two_sensors_that_disagree_none_is_outvoted_and_both_are_doubted(balanced) -> None:
    assert disagreeing(balanced, [0, 2], 3.0, 0.8) == ([], [0, 1])


def test_a_sensor_that_was_right_in_a_tip_before_it_was_given_up_was_not_told_wrongly() -> None:
    """The first sensor turns by 1.2 rad about a level axis in half a second; the second one lies still."""
    trust, none = ImuTrust(2, 0.5, PoseSettings()), np.zeros(2, dtype=np.bool_)
    for k in range(250):
        rate, up = np.zeros((2, 3)), np.tile(GRAVITY_M_PER_S2 * UP, (2, 1))
        rate[0, 0] = 2.4 * (50 < k <= 75)
        up[0] = rotation(np.array([-0.048 * np.clip(k - 50, 0, 25), 0, 0])) @ up[0]
        trust.hear(0.02 * k, ImuSamples(rate, up, np.full(2, 2), none, np.full(2, 0.02), none, none))
    assert not trust.told_wrongly.any()
    trust.give_up()
    assert trust.contradicted.tolist() == [True, True]
    assert trust.told_wrongly.tolist() == [False, True]


def test_a_sensor_whose_rates_were_cut_off_is_doubted_from_then_on() -> None:
    trust = ImuTrust(2, 0.0, PoseSettings())
    still, up = np.zeros((2, 3)), np.tile(9.81 * UP, (2, 1))
    for k, cut_off in enumerate([False, True, False]):
        none, is_cut_off = np.zeros(2, dtype=np.bool_), np.array([cut_off, False])
        samples = ImuSamples(still, up, np.ones(2, dtype=np.int64), none, np.full(2, 0.02), is_cut_off, none)
        trust.hear(0.02 * k, samples)
        assert trust.contradicted.tolist() == [k > 0, False]
    assert trust.is_used.all()


def test_two_sensors_that_disagree_a_little_are_not_doubted(balanced) -> None:
    assert disagreeing(balanced, [0, 2], 3.0, 0.1) == ([], [])


@pytest.mark.parametrize(("moves", "expected"), [(1.0, []), (0.0, [0])])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_sensor_of_which_one_axis_is_stuck_is_left_out(balanced, axis: int, moves: float, expected: list) -> None:
    """Turned in the air by 2.7 rad, of which one axis of the first sensor misses the second half."""
    rods, x = [0, 2, 4], balanced.node_position_m
    imus = tuple(Imu(rod, 0.5, np.array([0.0, 0.0, 1.0])) for rod in rods)
    robot = FreeStandingRobot(floor=Floor(float(x[0, 2]), UP), imus=imus, rest_seconds=0.2)
    poses = PoseFilter(balanced, robot, SETTINGS)
    d = rod_directions(balanced, rods)
    mounted = np.stack([*np.moveaxis(across(d), 1, 0), d], axis=2)
    mounted[:, :, 1] *= np.linalg.det(mounted)[:, None]  # right-handed
    vector, before = mounted[0] @ np.full(3, 2.7 / np.sqrt(3)), np.eye(3)
    for k in range(90):
        turn = rotation(min(max((k - 20) / 60, 0.0), 1.0) * vector)
        rates = mounted.swapaxes(1, 2) @ rotation_vector(before.T @ turn) / 0.02
        rates[0, axis] *= 1.0 if k < 50 else moves
        force = GRAVITY_M_PER_S2 * (turn @ mounted)[:, 2]
        aids = [ImuReading(i, 0.02 * k, rates[i], force[i]) for i in range(len(rods))]
        step = poses.step(0.02 * k, x, 1e-12 * np.eye(x.size), aids, nothing_stands(len(x)))
        before = turn
    assert np.flatnonzero(step.contradicted_imus).tolist() == expected
