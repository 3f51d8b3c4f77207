"""Rigidity: which motions of a structure its member lengths determine."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .lengths import length_jacobian
from .structure import Structure

SINGULAR = 1e-6
"""Bound below which a singular value of the (dimensionless) length Jacobian counts as zero. At the regular six-strut
shape the singular value of the mechanism is 1.6e-8 and the next one 0.16; under load the first is nearly always above
2e-3."""


@dataclass(frozen=True, slots=True, eq=False)
class Rigidity:
    """Rank and mechanisms of the length Jacobian d(lengths)/d(free nodes) at one shape, with fixed anchors.

    Its rows are the rods and the tendons that do not join two anchors; its columns are the free nodes' coordinates.
    """

    rank: int
    mechanisms: int
    """Number of independent motions that change no length to first order."""
    self_stresses: int
    """Number of independent sets of member forces that balance without load."""
    smallest_singular_value: float
    """Smallest singular value of the Jacobian, dimensionless: change of lengths per unit motion along the mechanism."""
    mechanism: NDArray[np.float64]
    """(nodes, 3) unit motion that changes the lengths least; zero at the anchors."""


def free_length_jacobian(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., rods + free tendons, 3 * free nodes), the length Jacobian J with fixed anchors."""
    return length_jacobian(node_position_m, structure.free_members, structure.free_coordinates)


def rigid_motions(node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3 nodes, 6) orthonormal displacements of all nodes that change no length: shifts and turns."""
    centred = node_position_m - node_position_m.mean(axis=-2, keepdims=True)
    shifts = np.broadcast_to(np.eye(3), (*centred.shape[:-1], 3, 3))
    turns = np.cross(np.eye(3), centred[..., None, :])  # (..., nodes, axis, 3)
    motions = np.concatenate([np.swapaxes(shifts, -1, -2), np.swapaxes(turns, -1, -2)], axis=-1)
    return np.asarray(np.linalg.qr(motions.reshape(*motions.shape[:-3], -1, 6))[0])


def motions_left(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3 nodes, motions) the orthonormal rigid motions that leave all anchors in place.

    There are six without anchors, three turns about one anchor, one about the line of two, and none with more.
    """
    motions = rigid_motions(node_position_m)
    if structure.is_free_standing:
        return motions
    held = {1: 3, 2: 5}.get(len(structure.anchors), 6)
    left = np.linalg.svd(motions[..., structure.anchored_coordinates, :])[2][..., held:, :]
    return np.asarray(motions @ np.swapaxes(left, -1, -2))


def held_jacobian(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length Jacobian; the rigid motions that the anchors leave are further rows of it."""
    jacobian = free_length_jacobian(structure, node_position_m)
    if structure.is_held:
        return jacobian
    motions = motions_left(structure, node_position_m)[..., structure.free_coordinates, :]
    return np.concatenate([jacobian, np.swapaxes(motions, -1, -2)], axis=-2)


def rigidity(structure: Structure, node_position_m: NDArray[np.float64]) -> Rigidity:
    """Return rank, mechanisms and self-stresses at (nodes, 3) positions."""
    jacobian = held_jacobian(structure, node_position_m)
    _, singular_value, motion = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((singular_value > SINGULAR).sum())
    rows, columns = jacobian.shape
    mechanism = np.zeros((structure.node_count, 3))
    mechanism[structure.free_nodes] = motion[-1].reshape(-1, 3)
    smallest = float(singular_value[-1]) if rows >= columns else 0.0
    return Rigidity(rank, columns - rank, rows - rank, smallest, mechanism)


def branch(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) the sign of det J, where J is the length Jacobian of the free nodes.

    It is 0 where J is not square or where a position is not finite.
    """
    if not structure.is_square:
        return np.zeros(node_position_m.shape[:-2])
    jacobian = free_length_jacobian(structure, node_position_m)
    finite = np.asarray(np.isfinite(jacobian).all(axis=(-2, -1)))
    return np.where(finite, np.linalg.slogdet(np.where(finite[..., None, None], jacobian, 0.0)).sign, 0.0)
