"""Form finding: the rest shape of a structure, from the lengths of its rods and the natural lengths of its tendons."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

from ..values.errors import IndeterminateError
from ..values.rotations import shortest_rotation
from .lengths import length_jacobian, member_length_m
from .structure import Structure
from .suspension import Suspension

ROD_WEIGHT = 100.0
"""Weight of a rod's length error: a rod is 1e4 times as stiff as a tendon, so that it changes by 1e-5 of its length."""
LEVEL = 0.7
"""Height of the normal of the anchors' plane, a unit vector, below which that is a wall: it is steeper than 45
degrees."""
LEAST_OF_A_HULL = 4
"""Least number of nodes that have a hull."""
STARTS = 8
"""Number of random shapes at which the search for the rest shape starts."""
MOST_ROD_ERROR = 0.01
"""Largest error of a rod's length, as a share of it, in a shape that keeps the rods' lengths."""
NEWTON_STEPS = 5
"""Steps in which a measured shape, some millimetres off, gets the lengths of its rods to a nanometre."""


def with_rods_as_told(structure: Structure, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest (nodes, 3) positions in which rods have their lengths, so that joined rods meet in a model."""
    x = structure.with_anchors_placed(node_position_m)
    for _ in range(NEWTON_STEPS):
        missing_m = structure.rod_length_m - member_length_m(x, structure.rods)
        jacobian = length_jacobian(x, structure.rods, structure.free_coordinates)
        move_m = np.linalg.lstsq(jacobian, missing_m)[0]
        x = structure.position_m(x[structure.free_nodes].ravel() + move_m)
    return x


def find_rest_shape(structure: Structure, near_m: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return (nodes, 3), the shape of least energy of equally stiff tendons, with fixed anchors and rod lengths.

    The shape minimises sum (l - L0)^2 over the tendons: the prestress of the tendons selects one stiff shape, which the
    lengths alone do not determine. Of the two mirror images about the plane of the anchors, the one above the plane
    (towards +z) is returned. Loads and differences in stiffness are ignored. Without anchors one of the two mirror
    images is returned as it stands on its broadest face, in the plane z = 0, with the centroid above the origin; with
    one or two, as it hangs from them.

    Args:
        structure: with anchors, or without.
        near_m: (nodes, 3) a shape from which the search starts, and beside which it ends; None: it starts anywhere.

    Raises:
        IndeterminateError: when no start leads to a shape that keeps the rods' lengths.
    """
    energy = _TendonEnergy(structure)
    if near_m is not None:
        return _nearby(structure, energy, near_m)
    if structure.is_free_standing:
        return _stood_up(_free_shape(structure, energy))
    if not structure.is_held:
        return Suspension.of(structure).hanging_m(_free_shape(structure, energy))
    base = structure.anchor_position_m
    if abs(np.linalg.svd(base - base.mean(axis=0))[2][-1, 2]) < LEVEL:
        raise IndeterminateError(
            "the anchors are on a wall, and no length tells on which side of it the structure is: expected "
            "structure.node_position_m, about as at rest"
        )
    shapes = energy.least_about(base.mean(axis=0), [-0.6, -0.6, 0.0], [0.6, 0.6, 1.0])
    above = [x for x in shapes if x[structure.free_nodes, 2].mean() > base[:, 2].mean()]
    if not above:
        raise IndeterminateError(
            "the structure has no rest shape with these rod, tendon and anchor lengths: check their units"
        )
    return above[0]


def _free_shape(structure: Structure, energy: "_TendonEnergy") -> NDArray[np.float64]:
    """Return (nodes, 3), the shape of least energy without anchors, anywhere, or on less than three of them."""
    middle_m = structure.anchor_position_m.sum(axis=0) / max(len(structure.anchors), 1)
    shapes = energy.least_about(middle_m, [-0.6, -0.6, -0.6], [0.6, 0.6, 0.6])
    if not shapes:
        raise IndeterminateError("the structure has no rest shape with these rod and tendon lengths: check their units")
    return shapes[0]


def _nearby(structure: Structure, energy: "_TendonEnergy", near_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (nodes, 3) the shape of least energy beside another; without anchors it is turned and placed likewise."""
    start = near_m[structure.free_nodes]
    members = np.concatenate([structure.rods, structure.tendons])
    empty = np.flatnonzero(member_length_m(structure.position_m(start.ravel()), members) == 0.0)
    if len(empty):
        a, b = members[empty[0]]
        raise IndeterminateError(
            f"structure.node_position_m: nodes {a} and {b} are joined and at one place: check positions and anchors"
        )
    _, position, rod_error = energy.least_from(start)
    if rod_error.max() > MOST_ROD_ERROR:
        raise IndeterminateError(
            f"structure.node_position_m: near these positions rod {int(rod_error.argmax())} cannot have its length "
            f"of {structure.rod_length_m[rod_error.argmax()]:g} m: check units and anchors"
        )
    if structure.is_free_standing or structure.is_held:
        return position
    return Suspension.of(structure).hanging_m(position)


def _stood_up(node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (nodes, 3) the same shape as it stands on the face of its hull that holds it most broadly."""
    if len(node_position_m) < LEAST_OF_A_HULL:
        raise IndeterminateError(
            f"{len(node_position_m)} nodes have no hull on whose faces they could stand: expected "
            "structure.node_position_m, or anchors"
        )
    x = node_position_m - node_position_m.mean(axis=0)
    hull = ConvexHull(x)
    margins = []
    for face, outward in zip(hull.simplices, hull.equations[:, :3], strict=True):
        corners = x[face] - np.outer(x[face] @ outward, outward)
        edges = np.roll(corners, -1, axis=0) - corners
        inward = np.cross(outward, edges) / np.linalg.norm(edges, axis=1)[:, None]
        inward *= np.sign(np.sum(inward * (corners.mean(axis=0) - corners), axis=1))[:, None]
        margins.append(np.min(-np.sum(inward * corners, axis=1)))
    down = hull.equations[int(np.argmax(margins)), :3]
    stood = x @ shortest_rotation(down, np.array([0.0, 0.0, -1.0])).T
    return np.asarray(stood - np.array([0.0, 0.0, stood[:, 2].min()]))


class _TendonEnergy:
    """The sum of (l - L0)^2 over tendons and of weighted rod errors, as a function of the free coordinates."""

    def __init__(self, structure: Structure) -> None:
        self._structure = structure
        self._members = np.concatenate([structure.rods, structure.tendons])

    def residual(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (rods + tendons,) the terms whose squares are summed."""
        structure = self._structure
        position = structure.position_m(coordinates)
        rod_error = member_length_m(position, structure.rods) - structure.rod_length_m
        stretch = structure.tendon_length_m(position) - structure.natural_length_m
        return np.concatenate([ROD_WEIGHT * rod_error, stretch])

    def jacobian(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (rods + tendons, 3 free), the derivative of `residual`."""
        structure = self._structure
        rows = length_jacobian(structure.position_m(coordinates), self._members, structure.free_coordinates)
        rows[: len(structure.rods)] *= ROD_WEIGHT
        return rows

    def least_about(
        self, middle_m: NDArray[np.float64], low: list[float], high: list[float]
    ) -> list[NDArray[np.float64]]:
        """Return the (nodes, 3) shapes that keep the rods' lengths, of least energy first.

        The free nodes start at random, `low` to `high` mean rod lengths per axis from the point (3,) `middle_m`.
        """
        structure = self._structure
        scale = float(structure.rod_length_m.mean())
        rng = np.random.default_rng(0)
        shapes = []
        for _ in range(STARTS):
            start = middle_m + scale * rng.uniform(low, high, (len(structure.free_nodes), 3))
            cost, position, rod_error = self.least_from(start)
            if rod_error.max() < MOST_ROD_ERROR:
                shapes.append((cost, position))
        return [position for _, position in sorted(shapes, key=lambda shape: shape[0])]

    def least_from(self, start_m: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Return the least energy near (free nodes, 3) positions, (nodes, 3) the shape, and (rods,) its rod errors.

        The errors are shares of the rods' lengths.
        """
        structure = self._structure
        solution = least_squares(self.residual, start_m.ravel(), self.jacobian, method="trf", xtol=1e-10, ftol=1e-12)
        position_m = structure.position_m(solution.x)
        rod_error = np.abs(member_length_m(position_m, structure.rods) / structure.rod_length_m - 1)
        return solution.cost, position_m, rod_error
