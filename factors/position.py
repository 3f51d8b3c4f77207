"""Positions of some nodes in the world, such as motion capture gives them: y = x_k + noise."""

from collections.abc import Sequence

import numpy as np

from ..models.pose.placed import PlacedShape, Rows
from ..models.values.aids import PositionReading


def position_rows(placed: PlacedShape, readings: Sequence[PositionReading], sigma_m: float) -> Rows:
    """Return three rows for each position.

    Args:
        placed: the shape in the world.
        readings: the positions of one frame.
        sigma_m: standard deviation of a position, per axis.
    """
    nodes = np.array([reading.node for reading in readings], dtype=np.int64)
    measured_m = np.array([reading.position_m for reading in readings]).reshape(-1, 3)
    of_shape = np.einsum("kii->ki", placed.node_covariance_m2[nodes])
    return Rows(
        error=(measured_m - placed.node_position_m[nodes]).ravel(),
        jacobian=placed.jacobian[nodes].reshape(-1, placed.state.layout.size),
        variance=(sigma_m**2 + of_shape).ravel(),
    )
