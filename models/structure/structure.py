"""The structure: rods connected by tendons, of which some nodes are anchored, or none."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..values.errors import InputError
from ..values.units import OTHER_UNIT
from .lengths import member_length_m


@dataclass(frozen=True, eq=False)
class Structure:
    """A tensegrity of rigid rods and elastic tendons; nodes are the ends of both, numbered from 0.

    Rods may share a node, about which they turn freely, and a node may be on no rod. A rigid body is a set of nodes
    whose distances are fixed: each of these distances is a rod.

    Raises:
        InputError: for anything that is not such a structure; the text names the member or node.
    """

    rods: NDArray[np.int64]
    """(rods, 2) node pairs; first the rods themselves, then the distances that are fixed in rigid bodies."""
    tendons: NDArray[np.int64]
    """(tendons, 2) node pairs, in the order of the sensors."""
    rod_length_m: NDArray[np.float64]
    """(rods,) length of each rod; a single number applies to all rods."""
    natural_length_m: NDArray[np.float64]
    """(tendons,) natural (unstretched) length L0 of each tendon; a single number applies to all tendons."""
    anchors: NDArray[np.int64]
    """(anchors,) nodes whose position is known."""
    anchor_position_m: NDArray[np.float64]
    """(anchors, 3) positions of the anchors, which define the coordinate frame of every result."""
    unsensed: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """(unsensed,) tendons without a sensor: they pull, and nothing measures their lengths."""

    def __post_init__(self) -> None:
        rods = _node_pairs("rods", self.rods)
        tendons = _node_pairs("tendons", self.tendons)
        anchors = _nodes("anchors", self.anchors)
        unsensed = np.asarray(self.unsensed, dtype=np.int64).reshape(-1)
        _check_topology(rods, tendons, anchors)
        _check_numbers("unsensed", "tendon", unsensed, len(tendons))
        values = {
            "rods": rods,
            "tendons": tendons,
            "rod_length_m": _positive("rod_length_m", self.rod_length_m, len(rods)),
            "natural_length_m": _positive("natural_length_m", self.natural_length_m, len(tendons)),
            "anchors": anchors,
            "anchor_position_m": _anchor_positions(self.anchor_position_m, len(anchors)),
            "unsensed": unsensed,
        }
        for name, value in values.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        _check_sizes(self)

    @cached_property
    def node_count(self) -> int:
        """Number of nodes: one more than the largest number of a node."""
        return _node_count(self.rods, self.tendons, self.anchors)

    @cached_property
    def free_nodes(self) -> NDArray[np.int64]:
        """(free,) the nodes that are not anchors."""
        return np.setdiff1d(np.arange(self.node_count), self.anchors)

    @cached_property
    def free_coordinates(self) -> NDArray[np.int64]:
        """(3 free,) the indices of the free nodes' coordinates among all (3 nodes,)."""
        return np.asarray((3 * self.free_nodes[:, None] + np.arange(3)).ravel())

    @cached_property
    def anchored_coordinates(self) -> NDArray[np.int64]:
        """(3 anchors,) the indices of the anchors' coordinates among all (3 nodes,), in the order of the anchors."""
        return np.asarray((3 * self.anchors[:, None] + np.arange(3)).ravel())

    @cached_property
    def joins_anchors(self) -> NDArray[np.bool_]:
        """(tendons,) True for tendons that join two anchors, so that their lengths say nothing of the shape."""
        return np.asarray(np.isin(self.tendons, self.anchors).all(axis=1))

    @cached_property
    def is_sensed(self) -> NDArray[np.bool_]:
        """(tendons,) True for tendons with a sensor."""
        return np.asarray(~np.isin(np.arange(len(self.tendons)), self.unsensed))

    @cached_property
    def sensed_tendons(self) -> NDArray[np.int64]:
        """(sensed tendons,) the numbers of the tendons with a sensor."""
        return np.flatnonzero(self.is_sensed)

    @cached_property
    def is_free_tendon(self) -> NDArray[np.bool_]:
        """(tendons,) True for tendons with a sensor that do not join two anchors: only they measure the shape."""
        return np.asarray(self.is_sensed & ~self.joins_anchors)

    @cached_property
    def free_tendons(self) -> NDArray[np.int64]:
        """(free tendons,) the numbers of the tendons with a sensor that do not join two anchors."""
        return np.flatnonzero(self.is_free_tendon)

    @cached_property
    def free_members(self) -> NDArray[np.int64]:
        """(rods + free tendons, 2) node pairs of the members whose lengths are known and depend on the shape."""
        return np.concatenate([self.rods, self.tendons[self.is_free_tendon]])

    @property
    def is_free_standing(self) -> bool:
        """Whether no node is anchored, so that lengths say nothing of where the structure is and how it is turned."""
        return len(self.anchors) == 0

    @property
    def is_held(self) -> bool:
        """Whether three anchors or more hold it; about one anchor it swings and turns, about two it swings."""
        return len(self.anchors) > 2

    @property
    def is_square(self) -> bool:
        """Whether there are as many free members as free coordinates, so that the length Jacobian is square."""
        return self.is_held and len(self.free_members) == len(self.free_coordinates)

    @property
    def faces(self) -> NDArray[np.int64]:
        """(faces, 3) nodes of the triangles that three tendons form, except triangles of three anchors."""
        joined = {frozenset(pair) for pair in self.tendons.tolist()}
        triangles = [
            (a, b, c)
            for a, b in sorted(sorted(pair) for pair in joined)
            for c in range(b + 1, self.node_count)
            if {a, b, c} - set(self.anchors.tolist()) and frozenset((a, c)) in joined and frozenset((b, c)) in joined
        ]
        return np.array(triangles, dtype=np.int64).reshape(-1, 3)

    def tendon_length_m(self, node_position_m: ArrayLike) -> NDArray[np.float64]:
        """(..., tendons) tendon lengths at (..., nodes, 3) positions."""
        return member_length_m(node_position_m, self.tendons)

    def joins_as(self, other: "Structure") -> bool:
        """Return whether the members of another structure join the same nodes, and the same nodes are anchors."""
        names = ("rods", "tendons", "anchors")
        return self.node_count == other.node_count and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    def check_unit(self, name: str, node_position_m: NDArray[np.float64]) -> None:
        """Check that positions are in metres, as the rods are.

        Args:
            name: of the positions, for the error text.
            node_position_m: (..., nodes, 3), nan where a node was not measured.

        Raises:
            InputError: when the nodes are a hundred times as far from each other as the rods are long, or as near.
        """
        measured = np.isfinite(node_position_m).all(axis=(*range(node_position_m.ndim - 2), -1))
        if measured.sum() < 2:
            return
        position_m = node_position_m[..., measured, :]
        apart_m = float(np.median(np.ptp(position_m, axis=-2).max(axis=-1)))
        rod_m = float(np.median(self.rod_length_m))
        if not rod_m / OTHER_UNIT < apart_m < OTHER_UNIT * rod_m:
            raise InputError(
                f"{name}: expected nodes as far apart as rods of {rod_m:g} m hold them, got {apart_m:g} m: "
                "is the unit right?"
            )

    def with_anchors_placed(self, node_position_m: ArrayLike) -> NDArray[np.float64]:
        """(..., nodes, 3) the same positions, with the anchors moved to their known positions."""
        position = np.array(node_position_m, dtype=np.float64)
        position[..., self.anchors, :] = self.anchor_position_m
        return position

    def position_m(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """(nodes, 3) positions of all nodes, from the (3 free,) coordinates of the free nodes."""
        position = np.empty((self.node_count, 3))
        position[self.anchors] = self.anchor_position_m
        position[self.free_nodes] = coordinates.reshape(-1, 3)
        return position


LEAST_HINGE_M = 1e-3
"""Distance between two anchors, over the square root of two, below which they give no direction of a hinge."""

ANCHORED_STRETCH = 4.0
"""Length over natural length that no strip with a sensor survives, of tendons whose length anchors tell."""


def _node_pairs(name: str, value: ArrayLike) -> NDArray[np.int64]:
    try:
        pairs = np.array(value)
    except ValueError as error:
        raise InputError(f"{name}: expected pairs of nodes, got rows of unequal length") from error
    if not pairs.size:
        raise InputError(f"{name}: expected pairs of node numbers, got none")
    if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
        raise InputError(f"{name}: expected pairs of node numbers, got an array of shape {pairs.shape} ({pairs.dtype})")
    return pairs.astype(np.int64)


def _nodes(name: str, value: ArrayLike) -> NDArray[np.int64]:
    nodes = np.array(value)
    if nodes.ndim != 1 or (len(nodes) and not np.issubdtype(nodes.dtype, np.integer)):
        raise InputError(f"{name}: expected node numbers, got an array of shape {nodes.shape} ({nodes.dtype})")
    return nodes.astype(np.int64)


def _positive(name: str, value: ArrayLike, count: int) -> NDArray[np.float64]:
    array = np.array(value, dtype=np.float64)
    if array.shape not in ((), (count,)):
        raise InputError(f"{name}: expected one number or {count}, got {array.size}")
    array = np.broadcast_to(array, (count,)).copy()
    for index in np.flatnonzero(~(np.isfinite(array) & (array > 0))):
        raise InputError(f"{name}[{index}]: expected a positive, finite length, got {array[index]}")
    return array


def _anchor_positions(value: ArrayLike, count: int) -> NDArray[np.float64]:
    position = np.array(value, dtype=np.float64).reshape(-1, 3) if count == 0 else np.array(value, dtype=np.float64)
    if position.shape != (count, 3) or not np.isfinite(position).all():
        raise InputError(f"anchor_position_m: expected {count} finite rows of x, y, z, got shape {position.shape}")
    if count < 2:
        return position
    spread = np.linalg.svd(position - position.mean(axis=0), compute_uv=False)
    if count == 2 and spread[0] < LEAST_HINGE_M:
        raise InputError("anchor_position_m: both anchors are at one place: expected two places, or one anchor")
    if count > 2 and spread[1] < 1e-3 * max(spread[0], 1e-9):
        raise InputError("anchor_position_m: the anchors lie on one line: expected a triangle, so that nothing turns")
    return position


def _node_count(*nodes: NDArray[np.int64]) -> int:
    return 1 + max(int(part.max(initial=-1)) for part in nodes)


def _check_topology(rods: NDArray[np.int64], tendons: NDArray[np.int64], anchors: NDArray[np.int64]) -> None:
    """Raise InputError for what is not a tensegrity of rods and tendons."""
    most = 2 * (len(rods) + len(tendons)) - 1
    joined: dict[frozenset[int], str] = {}
    for name, pairs in (("rod", rods), ("tendon", tendons)):
        for index, (a, b) in enumerate(pairs.tolist()):
            here, pair = f"{name} {index}", frozenset((a, b))
            if min(a, b) < 0 or max(a, b) > most:
                raise InputError(f"{here} ({a}-{b}): node out of range: expected 0 to {most}")
            if a == b:
                raise InputError(f"{here} ({a}-{b}): expected two different nodes")
            if pair in joined:
                raise InputError(f"{here} ({a}-{b}): joins the same nodes as {joined[pair]}")
            joined[pair] = here
    node_count = _node_count(rods, tendons)
    _check_numbers("anchors", "node", anchors, node_count)
    rods_at = np.bincount(rods.ravel(), minlength=node_count)
    tendons_at = np.bincount(tendons.ravel(), minlength=node_count)
    anchored = np.isin(np.arange(node_count), anchors)
    if anchored.all():
        raise InputError("anchors: every node is one: expected a node whose position is to be estimated")
    for node in np.flatnonzero((rods_at == 0) & (tendons_at == 0)):
        raise InputError(f"node {node}: no rod and no tendon ends there: expected all numbers up to {node_count - 1}")
    for node in np.flatnonzero((tendons_at == 0) & (rods_at < 2) & ~anchored):
        raise InputError(f"node {node}: no tendon holds it")
    for node in np.flatnonzero((rods_at == 0) & (tendons_at < 2) & ~anchored):
        raise InputError(f"node {node}: is on no rod, and one tendon alone holds it: expected two or more")
    _check_parts(np.concatenate([rods, tendons]), anchored)


def _check_parts(members: NDArray[np.int64], anchored: NDArray[np.bool_]) -> None:
    """Raise InputError for parts that no member joins, unless anchors hold each that has other nodes, too."""
    count = len(anchored)
    joined = coo_array((np.ones(len(members)), (members[:, 0], members[:, 1])), shape=(count, count))
    parts, part_of_node = connected_components(joined, directed=False)
    anchors = np.bincount(part_of_node, weights=anchored)
    loose = (anchors < 3) & (np.bincount(part_of_node) > anchors)
    if parts > 1 and loose.any():
        first = part_of_node[np.argmax(loose[part_of_node])]
        nodes = ", ".join(map(str, np.flatnonzero(part_of_node == first)))
        raise InputError(
            f"nodes {nodes}: no rod and no tendon joins them to the others: expected three anchors among them, or "
            "one structure in each trial"
        )


def _check_numbers(name: str, kind: str, numbers: NDArray[np.int64], count: int) -> None:
    """Raise InputError for nodes or tendons that do not exist, or that are named twice."""
    for index, number in enumerate(numbers):
        if not 0 <= number < count:
            raise InputError(f"{name}[{index}]: {kind} {number} out of range: expected 0 to {count - 1}")
        if number in numbers[:index]:
            raise InputError(f"{name}[{index}]: {kind} {number} is named twice")


def _check_sizes(structure: Structure) -> None:
    """Raise InputError for lengths and positions of which some are in another unit than the others."""
    rod_m = float(np.median(structure.rod_length_m))
    sizes = {
        "rod_length_m": structure.rod_length_m,
        "natural_length_m": structure.natural_length_m,
        "anchor_position_m": np.linalg.norm(structure.anchor_position_m[1:] - structure.anchor_position_m[:-1], axis=1),
    }
    for name, size_m in sizes.items():
        for index in np.flatnonzero((size_m > OTHER_UNIT * rod_m) | (size_m < rod_m / OTHER_UNIT))[:1]:
            raise InputError(
                f"{name}[{index}]: expected sizes like that of the rods, {rod_m:g} m, got {size_m[index]:g} m: "
                "is the unit right?"
            )
    apart_m = structure.tendon_length_m(structure.with_anchors_placed(np.zeros((structure.node_count, 3))))
    natural_m = structure.natural_length_m
    for tendon in np.flatnonzero(structure.joins_anchors & (apart_m > ANCHORED_STRETCH * natural_m))[:1]:
        raise InputError(
            f"anchor_position_m: tendon {tendon} is {natural_m[tendon]:g} m long and joins two anchors "
            f"{apart_m[tendon]:g} m apart: expected at most {ANCHORED_STRETCH:g} times its length: is the unit right?"
        )
