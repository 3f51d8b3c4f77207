"""Feet that slide."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.slide_watch import at_rest, slid_before
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.values.aids import Imu, ImuReading

SHAPE_M2 = 1e-6 * np.eye(36)


def test_a_slide_is_known_from_its_start() -> None:
    """Node 1 is found to slide in the frames at 0.4 and 0.5 s, since some time after 0.1 s; node 0 never."""
    since_s = np.full((6, 2), np.inf)
    since_s[4:, 1] = 0.1
    slides = slid_before(since_s, 0.1 * np.arange(6))
    assert np.flatnonzero(slides[:, 1]).tolist() == [2, 3, 4, 5]
    assert not slides[:, 0].any()


def test_a_foot_is_at_rest_by_its_own_speed() -> None:
    """By hand: at 40 mm/s it is, 0.1 m further out on a body that turns at 1 rad/s, at 140 mm/s, it is not."""
    state = replace(
        any_state(0, 0), turn=np.eye(3), velocity_m_per_s=np.array([0, 0.04, 0]), rate_rad_per_s=np.array([0, 0, 1.0])
    )
    arm_m = np.zeros((12, 3))
    arm_m[1:, 0] = 0.1
    rests = at_rest(PlacedShape(state, arm_m, SHAPE_M2), 1e-8 * np.eye(state.layout.size), Floor(0.0, UP))
    assert rests[0]
    assert not rests[1:].any()


def robot_with_two_sensors(balanced) -> PoseFilter:
    """Return the filter of a robot that rests for half a second, with sensors on rods of two directions."""
    x = balanced.node_position_m
    rods = balanced.structure.rods
    along = [(x[rods[k, 1]] - x[rods[k, 0]]) / np.linalg.norm(x[rods[k, 1]] - x[rods[k, 0]]) for k in (0, 2)]
    imus = (Imu(0, 0.5, along[0]), Imu(2, 0.5, along[1]))
    robot = FreeStandingRobot(Floor(float(x[0, 2]), UP), imus, (), 0.5)
    return PoseFilter(balanced, robot, PoseSettings())


def samples(t_s: float, force: np.ndarray, turns: tuple[np.ndarray, ...] = (np.eye(3), np.eye(3))) -> list[ImuReading]:
    """Return two samples of each sensor, whose axes are turned against those of the world."""
    return [ImuReading(i, t_s - 0.01 + 0.01 * half, np.zeros(3), turns[i] @ force) for half in (0, 1) for i in (0, 1)]


def pushed(balanced, push_m_per_s2: float) -> tuple[PoseFilter, list, float]:
    """Return the filter of a robot with two sensors that is pushed along x for 0.2 s and brakes as long, and steps."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    steps = []
    for k in range(100):
        t_s = 0.02 * k
        sign = 1.0 if 1.0 <= t_s < 1.2 else -1.0 if 1.2 <= t_s < 1.4 else 0.0
        force = 9.81 * UP + np.array([sign * push_m_per_s2, 0, 0])
        steps.append(poses.step(t_s, x, SHAPE_M2, samples(t_s, force)))
    return poses, steps, push_m_per_s2 * 0.2**2


def test_a_slide_of_all_feet_is_told_with_its_distance(balanced) -> None:
    """A push of 1 m/s^2: 40 mm in 0.4 s, by 4 mm a frame at most, which is less than the shape is wrong by."""
    poses, steps, distance_m = pushed(balanced, 1.0)
    slips = [slip for step in steps for slip in step.slips]
    assert sorted(slip.node for slip in slips) == [0, 1, 2]
    for slip in slips:
        assert 0.9 < slip.t_s < 1.6
        assert abs(slip.distance_m - distance_m) < 2 * slip.sigma_m < 0.025
        assert slip.way_m[0] > 0.9 * slip.distance_m
    moved_m = poses.state.position_m - poses.centre_m
    sigma_m = float(np.sqrt(poses.covariance[3, 3]))
    assert abs(moved_m[0] - distance_m) < 2 * sigma_m < 0.025


def test_a_shake_that_moves_nothing_is_no_slide(balanced) -> None:
    poses, steps, _ = pushed(balanced, 0.05)
    assert not [slip for step in steps for slip in step.slips]
    assert poses.state.position_m == pytest.approx(poses.centre_m, abs=0.001)


def lifted(balanced, lift_m_per_s2: float, until_s: float) -> tuple[PoseFilter, list]:
    """Return the filter of a robot that is lifted within 0.8 s from 1 s on, and put down from 2.2 s on, and steps."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    steps = []
    for t_s in np.arange(0.0, until_s, 0.02):
        up = [(1.0, 1.0), (1.4, -1.0), (2.2, -1.0), (2.6, 1.0)]
        sign = next((sign for from_s, sign in up if from_s <= t_s < from_s + 0.4), 0.0)
        force = (9.81 + sign * lift_m_per_s2) * UP
        steps.append(poses.step(float(t_s), x, SHAPE_M2, samples(float(t_s), force)))
    return poses, steps


def test_a_robot_that_is_lifted_is_followed_in_the_air(balanced) -> None:
    """At 0.8 m/s^2 up for 0.4 s, and as much down: 128 mm, within the ellipsoid, while the floor carries nothing."""
    poses, steps = lifted(balanced, 0.8, 2.1)
    rise_m, sigma_m = poses.state.position_m[2] - poses.centre_m[2], float(np.sqrt(poses.covariance[5, 5]))
    assert abs(rise_m - 0.128) < 3 * sigma_m < 0.1
    assert not steps[-1].standing.nodes.any()
    assert steps[-1].standing.contradicted
    assert steps[-1].lifted_since_s == pytest.approx(1.0, abs=0.5), "the last watch that began before it"


def test_a_robot_that_is_put_down_stands_again_and_is_doubted_for_a_while(balanced) -> None:
    poses, steps = lifted(balanced, 0.8, 5.6)
    assert np.flatnonzero(steps[-1].standing.nodes).tolist() == [0, 1, 2]
    assert poses.state.position_m[2] == pytest.approx(poses.centre_m[2], abs=0.005)
    assert poses.covariance[3, 3] > 0.005**2, "where it was put down is not known well"
    assert not steps[-1].standing.contradicted
    assert next(step for step in steps if step.standing.contradicted).standing.nodes.sum() == 0


def test_a_robot_that_trembles_on_the_floor_is_not_lifted(balanced) -> None:
    _, steps = lifted(balanced, 0.05, 2.0)
    assert all(np.isinf(step.lifted_since_s) and step.standing.nodes.any() for step in steps)
    assert not any(step.standing.contradicted for step in steps)
