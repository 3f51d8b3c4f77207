"""Feet that slide."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state, robot_with_two_sensors, samples_of_two
from tensegraph.estimator.free_standing.footholds import Feet, turned_sigma
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.prediction import Prediction
from tensegraph.estimator.free_standing.watches.slide_watch import have_slowed, slid_before
from tensegraph.models.pose.placed import PlacedShape, Rows
from tensegraph.models.structure.floor import UP, Floor

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
    slow = have_slowed(PlacedShape(state, arm_m, SHAPE_M2), 1e-8 * np.eye(state.layout.size), Floor(0.0, UP))
    assert slow[0]
    assert not slow[1:].any()


def pushed(balanced, push_m_per_s2: float) -> tuple[PoseFilter, list, float]:
    """Return the filter of a robot with two sensors that is pushed along x for 0.2 s and brakes as long, and steps."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    steps = []
    for k in range(100):
        t_s = 0.02 * k
        sign = 1.0 if 1.0 <= t_s < 1.2 else -1.0 if 1.2 <= t_s < 1.4 else 0.0
        force = 9.81 * UP + np.array([sign * push_m_per_s2, 0, 0])
        steps.append(poses.step(t_s, x, SHAPE_M2, samples_of_two(t_s, force)))
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


def test_a_shorter_slide_of_a_robot_that_stood_still_is_told(balanced) -> None:
    """16 mm, where most of the error of the way would come from that of the velocity before."""
    poses, steps, distance_m = pushed(balanced, 0.4)
    assert sorted(slip.node for step in steps for slip in step.slips) == [0, 1, 2]
    moved_m = poses.state.position_m - poses.centre_m
    sigma_m = float(np.sqrt(poses.covariance[3, 3]))
    assert abs(moved_m[0] - distance_m) < 2 * sigma_m < 0.015


def test_a_shake_that_moves_nothing_is_no_slide(balanced) -> None:
    poses, steps, _ = pushed(balanced, 0.05)
    assert not [slip for step in steps for slip in step.slips]
    assert poses.state.position_m == pytest.approx(poses.centre_m, abs=0.001)


def test_a_turn_about_the_vertical_is_a_slide_although_no_force_is_felt(balanced) -> None:
    """At 0.3 rad/s for 0.6 s: feet 0.1 m from the middle slide by 18 mm, and about which point nobody knows."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    steps = []
    for k in range(100):
        t_s = 0.02 * k
        rate = 0.3 * UP if 1.0 <= t_s < 1.6 else np.zeros(3)
        turning = [replace(sample, rate_rad_per_s=rate) for sample in samples_of_two(t_s, 9.81 * UP)]
        steps.append(poses.step(t_s, x, SHAPE_M2, turning))
    assert {slip.node for step in steps for slip in step.slips} == {0, 1, 2}
    heading_rad = np.arctan2(poses.state.turn[1, 0], poses.state.turn[0, 0])
    assert heading_rad == pytest.approx(0.18, abs=0.02)
    assert np.sqrt(poses.covariance[3, 3]) > 1.5 * np.sqrt(steps[45].covariance[3, 3])


def test_how_far_feet_have_turned() -> None:
    """By hand: feet at +-0.1 m are 1 mm aside, with 0.5 mm of noise: 0.2 mm m / (0.1 m sqrt(2) 0.5 mm)."""
    state, floor = any_state(0, 0), Floor(0.0, UP)
    arm_m = np.zeros((12, 3))
    arm_m[1:3] = np.outer([0.1, -0.1], floor.axes[0])
    placed = PlacedShape(replace(state, turn=np.eye(3)), arm_m, SHAPE_M2)
    size = state.layout.size
    predicted = Prediction(placed, np.eye(size), np.zeros((size, size)), np.zeros(3))
    rows = Rows(np.array([0, -0.001, 0, 0.001]), np.zeros((4, size)), np.full(4, 0.0005**2))
    assert turned_sigma(Feet(np.array([1, 2]), rows), predicted, floor) == pytest.approx(2 * np.sqrt(2))
    shifted = Rows(np.array([0, 0.001, 0, 0.001]), rows.jacobian, rows.variance)
    assert turned_sigma(Feet(np.array([1, 2]), shifted), predicted, floor) == pytest.approx(0)
    assert turned_sigma(Feet(np.array([1]), rows), predicted, floor) == 0


def test_a_robot_that_nothing_brakes_has_stopped(balanced) -> None:
    """After a blow, which sensors do not measure, it seems to slide at half a metre per second; they feel no friction.

    Where it has stopped is then told by how much the velocity was wrong: 0.1 m behind, for 0.2 s.
    """
    poses, x = robot_with_two_sensors(balanced), balanced.node_position_m
    for k in range(60):
        poses.step(0.02 * k, x, SHAPE_M2, samples_of_two(0.02 * k, 9.81 * UP))
    at = poses.state.layout
    poses.state = replace(poses.state, velocity_m_per_s=np.array([0.5, 0.0, 0.0]))
    poses.covariance[at.velocity, at.velocity] += 0.1**2 * np.eye(3)
    poses._slide_watch.since_s = np.where(poses.standing.nodes, 1.18, np.inf)
    for k in range(60, 80):
        step = poses.step(0.02 * k, x, SHAPE_M2, samples_of_two(0.02 * k, 9.81 * UP))
    assert np.linalg.norm(step.state.velocity_m_per_s) < 0.02
    assert step.state.position_m == pytest.approx(poses.centre_m, abs=0.03)
    assert not np.isfinite(step.slides_since_s).any()
    assert not step.contradicted_imus.any()
