"""Lengths and their derivatives: all that the paper's eqs. (5)-(7) know of the structure."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def member_length_m(node_position_m: ArrayLike, members: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return |x_b - x_a|, (..., members), at (..., nodes, 3) positions."""
    position = np.asarray(node_position_m, dtype=np.float64)
    length: NDArray[np.float64] = np.linalg.norm(
        position[..., members[:, 1], :] - position[..., members[:, 0], :], axis=-1
    )
    return length


def length_jacobian(node_position_m: ArrayLike, members: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return d|x_b - x_a| / dx, (..., members, nodes, 3): the unit vector u at b, -u at a."""
    position = np.asarray(node_position_m, dtype=np.float64)
    difference = position[..., members[:, 1], :] - position[..., members[:, 0], :]
    unit = difference / np.linalg.norm(difference, axis=-1, keepdims=True)
    jacobian = np.zeros((*position.shape[:-2], len(members), *position.shape[-2:]))
    row = np.arange(len(members))
    jacobian[..., row, members[:, 1], :] = unit
    jacobian[..., row, members[:, 0], :] = -unit
    return jacobian
