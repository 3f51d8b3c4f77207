"""Feet that slide."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state, robot_with_two_sensors, samples_of_two
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.watches.slide_watch import at_rest, slid_before
from tensegraph.models.pose.placed import PlacedShape
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
    rests = at_rest(PlacedShape(state, arm_m, SHAPE_M2), 1e-8 * np.eye(state.layout.size), Floor(0.0, UP))
    assert rests[0]
    assert not rests[1:].any()


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


def test_a_shake_that_moves_nothing_is_no_slide(balanced) -> None:
    poses, steps, _ = pushed(balanced, 0.05)
    assert not [slip for step in steps for slip in step.slips]
    assert poses.state.position_m == pytest.approx(poses.centre_m, abs=0.001)
