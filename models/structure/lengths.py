"""Lengths of rods and tendons and their derivatives, eqs. (5)-(7)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEAST_M = 1e-12
"""Distance of two nodes below which they are at one place: the direction between them, and the derivative, are zero."""


def member_length_m(node_position_m: ArrayLike, members: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (..., members) lengths |x_b - x_a| at (..., nodes, 3) positions; members are (members, 2) node pairs."""
    position = np.asarray(node_position_m, dtype=np.float64)
    length: NDArray[np.float64] = np.linalg.norm(
        position[..., members[:, 1], :] - position[..., members[:, 0], :], axis=-1
    )
    return length


def length_jacobian(
    node_position_m: ArrayLike, members: NDArray[np.int64], coordinates: NDArray[np.int64] | None = None
) -> NDArray[np.float64]:
    """Return d|x_b - x_a| / dx, (..., members, coordinates): the unit vector u at b, -u at a.

    Args:
        node_position_m: (..., nodes, 3)
        members: (members, 2) node pairs.
        coordinates: indices of the coordinates to differentiate by, among all (3 nodes,); all if None.
    """
    return length_and_jacobian(node_position_m, members, coordinates)[1]


def length_and_jacobian(
    node_position_m: ArrayLike, members: NDArray[np.int64], coordinates: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `member_length_m` and `length_jacobian`."""
    position = np.asarray(node_position_m, dtype=np.float64)
    difference = position[..., members[:, 1], :] - position[..., members[:, 0], :]
    length = np.linalg.norm(difference, axis=-1)
    unit = difference / np.maximum(length, LEAST_M)[..., None]
    jacobian = np.zeros((*position.shape[:-2], len(members), *position.shape[-2:]))
    row = np.arange(len(members))
    jacobian[..., row, members[:, 1], :] = unit
    jacobian[..., row, members[:, 0], :] = -unit
    jacobian = jacobian.reshape(*jacobian.shape[:-2], 3 * jacobian.shape[-2])
    return length, jacobian if coordinates is None else np.take(jacobian, coordinates, axis=-1)


def length_curvature_per_m(
    node_position_m: NDArray[np.float64], members: NDArray[np.int64], motion: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (..., members) second derivatives d^2 l / da^2 along x + a m: (|m_ab|^2 - (m_ab . d)^2) / l.

    m_ab is the motion of b relative to a, and d the unit vector from a to b.

    Args:
        node_position_m: (..., nodes, 3) positions x.
        members: (members, 2) node pairs a, b.
        motion: (..., nodes, 3) motion m.
    """
    a, b = members.T
    difference = node_position_m[..., b, :] - node_position_m[..., a, :]
    relative = motion[..., b, :] - motion[..., a, :]
    length = np.linalg.norm(difference, axis=-1)
    along = np.einsum("...ek,...ek->...e", relative, difference) / length
    return np.asarray((np.sum(relative**2, axis=-1) - along**2) / length)


def propagated_variance(jacobian: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., rows), the variance h P h^T of each row h of a (..., rows, n) Jacobian, P (..., n, n)."""
    return np.asarray(np.sum((jacobian @ covariance) * jacobian, axis=-1))  # a tenth of the time of one einsum
