"""Poses of free-standing structures for tests."""

import numpy as np

from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.pose_state import PoseState
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import Imu, ImuReading
from tensegraph.models.values.rotations import rotation


def any_state(imus: int, pairs: int, seed: int = 4, tilts: int = 0, own_frames: int = 0) -> PoseState:
    """Return a state in which every part differs from zero, of a structure with 12 nodes."""
    rng = np.random.default_rng(seed)
    return PoseState(
        turn=rotation(np.array([0.3, -0.5, 0.7])),
        position_m=np.array([0.1, -0.2, 0.3]),
        rate_rad_per_s=rng.standard_normal(3),
        velocity_m_per_s=0.1 * rng.standard_normal(3),
        foothold_m=0.1 * rng.standard_normal((12, 2)),
        imu_turn=rotation(rng.standard_normal((imus, 3))),
        rate_bias_rad_per_s=0.01 * rng.standard_normal((imus, 3)),
        force_bias_m_per_s2=0.1 * rng.standard_normal((imus, 3)),
        misalignment=0.02 * rng.standard_normal((imus, 2)),
        range_offset_m=0.05 * rng.standard_normal(pairs),
        floor_tilt=0.1 * rng.standard_normal(tilts),
        rate_scale=0.01 * rng.standard_normal((imus, 3)),
        beacon_error_m=0.02 * rng.standard_normal(min(pairs, 1)),
        own_frame_error=rng.standard_normal((own_frames, 6)),
    )


def robot_with_two_sensors(balanced: RestShape) -> PoseFilter:
    """Return the filter of a robot that rests for half a second, with sensors on rods of two directions."""
    x = balanced.node_position_m
    rods = balanced.structure.rods
    along = [(x[rods[k, 1]] - x[rods[k, 0]]) / np.linalg.norm(x[rods[k, 1]] - x[rods[k, 0]]) for k in (0, 2)]
    imus = (Imu(0, 0.5, along[0]), Imu(2, 0.5, along[1]))
    robot = FreeStandingRobot(floor=Floor(float(x[0, 2]), UP), imus=imus, rest_seconds=0.5)
    return PoseFilter(balanced, robot, PoseSettings())


def samples_of_two(
    t_s: float, force: np.ndarray, turns: tuple[np.ndarray, ...] = (np.eye(3), np.eye(3))
) -> list[ImuReading]:
    """Return two samples of each sensor, whose axes are turned against those of the world."""
    return [ImuReading(i, t_s - 0.01 + 0.01 * half, np.zeros(3), turns[i] @ force) for half in (0, 1) for i in (0, 1)]
