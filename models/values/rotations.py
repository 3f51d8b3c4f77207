"""Rotations in three dimensions: matrices R, and rotation vectors w = angle times axis in rad."""

import numpy as np
from numpy.typing import NDArray

SMALL_RAD = 1e-8
"""Angle below which a rotation vector is the antisymmetric part of its matrix."""
CROSS_MATRICES = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0.0]])
"""(3, 9) the cross matrices of the three axes, row by row."""


def cross_matrix(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 3, 3) matrices V of finite (..., 3) vectors, with V u = v x u."""
    return np.asarray(v @ CROSS_MATRICES).reshape(*v.shape, 3)


def cross(v: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 3) products v x u of finite (..., 3) vectors; `np.cross` takes several times as long for few."""
    return np.asarray((cross_matrix(v) @ u[..., None])[..., 0])


def across(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 2, 3) two unit vectors across each of (..., 3) unit vectors u, and across each other.

    They are the second and third row of the reflection 1 - q q^T / (1 + |u_x|), q = u + sign(u_x) e_x, of u to an axis.
    """
    q = u.copy()
    q[..., 0] += np.copysign(1.0, u[..., 0])
    return np.asarray(np.eye(3)[1:] - u[..., 1:, None] * (q / (1 + np.abs(u[..., :1])))[..., None, :])


def rotation(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 3, 3) rotations about (..., 3) rotation vectors, by Rodrigues' formula."""
    angle = np.sqrt(np.sum(w * w, axis=-1))[..., None, None]
    V = cross_matrix(w)
    by_sine = np.sinc(angle / np.pi)
    by_cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + by_sine * V + by_cosine * (V @ V))


def rotation_vector(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 3) rotation vectors of (..., 3, 3) rotations, of angles below pi."""
    m = matrix
    axis = np.stack([m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], axis=-1)
    sine = 0.5 * np.sqrt(np.sum(axis * axis, axis=-1))
    cosine = 0.5 * (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1)
    angle = np.arctan2(sine, cosine)
    return np.asarray(0.5 * axis * np.where(sine > SMALL_RAD, angle / np.maximum(sine, SMALL_RAD), 1.0)[..., None])


def best_rotation(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 3, 3) rotations R that turn centred points x into y best, in the sense of least squares.

    Args:
        x: (..., points, 3) with mean zero.
        y: (..., points, 3) with mean zero.
    """
    left, _, right = np.linalg.svd(np.swapaxes(y, -1, -2) @ x)
    right = right.copy()
    right[..., 2, :] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.asarray(left @ right)


def shortest_rotation(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation that turns the unit vector u into the unit vector v by the smallest angle."""
    axis = np.cross(u, v)
    sine, cosine = float(np.linalg.norm(axis)), float(u @ v)
    if sine < SMALL_RAD:
        axis, sine = np.cross(u, np.eye(3)[np.argmin(np.abs(u))]), 1.0
        axis = axis / np.linalg.norm(axis)
        return rotation(axis * (0.0 if cosine > 0 else np.pi))
    return rotation(axis / sine * np.arctan2(sine, cosine))
