"""The pose at the start, where the structure was measured at rest: the axes of the body are those of the world."""

import numpy as np
from numpy.typing import NDArray

from ...models.pose.placed import Rows
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import Robot
from ...models.structure.floor import Floor
from ...models.values.rotations import rotation_vector

IMU_TURN_RAD = 0.3
"""Standard deviation of the attitude of a sensor that is taken on. It comes from the direction of its rod and from
gravity, whose rows tell it again in the same frame, with the biases that are in it: about a rod that is nearly upright
it is known to some degrees only."""
STILL = 1e-3
"""Standard deviation of all motion while the structure stands at rest at the start, in rad and m and per second."""


def state_at_rest(node_position_m: NDArray[np.float64], robot: Robot) -> PoseState:
    """Return the state of a robot that is at rest at (nodes, 3) positions; sensors are turned as the world is."""
    imus = len(robot.imus)
    return PoseState(
        turn=np.eye(3),
        position_m=node_position_m.mean(axis=0),
        rate_rad_per_s=np.zeros(3),
        velocity_m_per_s=np.zeros(3),
        foothold_m=node_position_m @ robot.floor.axes.T,
        imu_turn=np.tile(np.eye(3), (imus, 1, 1)),
        rate_bias_rad_per_s=np.zeros((imus, 3)),
        force_bias_m_per_s2=np.zeros((imus, 3)),
        misalignment=np.zeros((imus, 2)),
        range_offset_m=np.zeros(len(robot.range_pairs)),
        floor_tilt=np.zeros(robot.floor.tilt_count),
        rate_scale=np.zeros((imus, 3)),
        beacon_error_m=np.zeros(len(robot.beacons)),
        own_frame_error=np.zeros((robot.own_frames, 6)),
    )


def covariance_at_rest(state: PoseState, floor: Floor, settings: PoseSettings) -> NDArray[np.float64]:
    """Return (size, size) the covariance of the errors of this state.

    Args:
        state: at rest.
        floor: the floor, whose normal may be known inexactly.
        settings: for what is not known of sensors.
    """
    at = state.layout
    sigma = np.full(at.size, STILL)
    sigma[at.imu_turn] = IMU_TURN_RAD
    sigma[at.rate_bias] = settings.rate_bias_rad_per_s
    sigma[at.force_bias] = settings.force_bias_m_per_s2
    sigma[at.misalignment] = settings.misalignment_rad
    sigma[at.range_offset] = settings.range_offset_m
    sigma[at.floor_tilt] = floor.normal_sigma_rad
    sigma[at.rate_scale] = settings.rate_scale
    sigma[at.beacon_error] = settings.beacon_error_m
    sigma[at.own_frame] = 1.0
    return np.diag(sigma**2)


def rest_rows(state: PoseState, position_m: NDArray[np.float64]) -> Rows:
    """Return rows that say that the structure is at rest, not turned, with its centroid at (3,) a position."""
    error = -np.concatenate(
        [rotation_vector(state.turn), state.position_m - position_m, state.rate_rad_per_s, state.velocity_m_per_s]
    )
    return Rows(error, np.eye(12, state.layout.size), np.full(12, STILL**2))
