"""Positions of some nodes, such as motion capture gives them.

A reading is older than its frame by dt, in which the node has moved. With its arm a = R (s - c) in the world,

    y = x - dt (v + w x a) + noise

Where its recording has a frame of its own, y is placed in the world by an estimate of that frame, with errors z. In
truth it is y + B z there, see `OwnFrame`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..models.pose.placed import PlacedShape, Rows
from ..models.values.aids import PositionReading
from ..models.values.rotations import cross_matrix


def position_rows(placed: PlacedShape, readings: Sequence[PositionReading], t_s: float, sigma_m: float) -> Rows:
    """Return three rows for each position.

    Args:
        placed: the shape in the world.
        readings: the positions since the frame before.
        t_s: time of the frame.
        sigma_m: standard deviation of a position, per axis.
    """
    nodes = np.array([reading.node for reading in readings], dtype=np.int64)
    age_s = np.array([t_s - reading.t_s for reading in readings])
    measured_m = np.array([reading.position_m for reading in readings]).reshape(-1, 3)
    of_shape = np.einsum("kii->ki", placed.node_covariance_m2[nodes])
    predicted_m, jacobian = earlier_nodes(placed, nodes, age_s)
    for k, reading in enumerate(readings):
        if reading.frame is not None:
            B, number = reading.frame.jacobian(reading.position_m), reading.frame.number
            measured_m[k] += B @ placed.state.own_frame_error[number]
            jacobian[k, :, placed.state.layout.of_own_frame(number)] = -B
    return Rows(
        error=(measured_m - predicted_m).ravel(),
        jacobian=jacobian.reshape(-1, placed.state.layout.size),
        variance=(sigma_m**2 + of_shape).ravel(),
    )


def earlier_nodes(
    placed: PlacedShape, nodes: NDArray[np.int64], age_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (k, 3) where some nodes were a little earlier, and its (k, 3, size) derivative by the state's errors.

    Args:
        placed: the shape in the world.
        nodes: (k,) the nodes.
        age_s: (k,) how much earlier.
    """
    state, at = placed.state, placed.state.layout
    arm_m, dt = placed.arm_m[nodes], age_s[:, None]
    velocity = state.velocity_m_per_s + np.cross(state.rate_rad_per_s, arm_m)
    jacobian = placed.jacobian[nodes]
    across = cross_matrix(arm_m)
    jacobian[:, :, at.turn] += dt[:, None] * (cross_matrix(state.rate_rad_per_s) @ across)
    jacobian[:, :, at.rate] = dt[:, None] * across
    jacobian[:, :, at.velocity] = -dt[:, None] * np.eye(3)
    return placed.node_position_m[nodes] - dt * velocity, jacobian
