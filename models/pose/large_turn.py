"""The covariance of nodes whose structure is turned about a point by an angle that may be large.

A turn by an angle of variance s about an axis e moves a node at r from the point by sin(angle) e x r and
(1 - cos(angle)) e x (e x r). Their second moments are

    E sin^2 = (1 - exp(-2 s)) / 2,     E (1 - cos)^2 = 3 / 2 - 2 exp(-s / 2) + exp(-2 s) / 2

which are s and 3/4 s^2 for small s, and 1/2 and 3/2 where the angle may be any.
"""

import numpy as np
from numpy.typing import NDArray

from ..values.rotations import cross, cross_matrix
from .placed import PlacedShape
from .pose_state import PoseState

KNOWN_RAD2 = 1e-12
"""Least variance of an angle by which to divide, rad^2."""


def turned_covariance_m2(
    placed: PlacedShape, covariance: NDArray[np.float64], pivot_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (3 nodes, 3 nodes), the covariance of all coordinates in the world, by pose and shape.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        pivot_m: (3,) the point about which it turns, in the world.
    """
    at = placed.state.layout.pose
    to_pivot = np.eye(6)
    to_pivot[3:, :3] = -cross_matrix(pivot_m - placed.state.position_m)
    pose = to_pivot @ covariance[at, at] @ to_pivot.T
    variance, axes = np.linalg.eigh(pose[:3, :3])
    variance = np.maximum(variance, KNOWN_RAD2)
    by_sine = 0.5 * (1 - np.exp(-2 * variance))
    by_cosine = 1.5 - 2 * np.exp(-0.5 * variance) + 0.5 * np.exp(-2 * variance)
    arm_m = placed.node_position_m - pivot_m
    jacobian = np.zeros((len(arm_m), 3, 6))
    jacobian[:, :, :3] = -cross_matrix(arm_m) @ (axes * np.sqrt(by_sine / variance)) @ axes.T
    jacobian[:, :, 3:] = np.eye(3)
    first = jacobian.reshape(-1, 6)
    inward = np.stack([arm_m @ (cross_matrix(axis) @ cross_matrix(axis)).T for axis in axes.T], axis=-1)
    second = inward.reshape(-1, 3) * np.sqrt(np.maximum(by_cosine, 0.0))
    return np.asarray(first @ pose @ first.T + second @ second.T + placed.shape_covariance_m2)


def heading_pivot_m(
    state: PoseState, covariance: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (3,) the point about which an error of the heading has turned the way of a robot.

    An error of the heading about the normal n, of variance s, has moved the position p by n x (p - pivot) for each
    radian, which is their covariance divided by s. A robot that may head anywhere may have gone the other way from
    there.

    Args:
        state: the pose.
        covariance: (size, size) of its errors.
        normal: (3,) n.
    """
    at = state.layout
    with_heading = covariance[at.pose, at.turn] @ normal
    by_heading = with_heading[at.position] / max(float(with_heading[at.turn] @ normal), KNOWN_RAD2)
    return np.asarray(state.position_m - cross(by_heading, normal))
