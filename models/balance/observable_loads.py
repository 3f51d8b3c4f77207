"""The loads at the nodes, as far as they can be observed: what the balance of forces leaves over."""

from enum import StrEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..structure.external_loads import ExternalLoads
from ..structure.structure import Structure
from .joined_rods import JoinedRods
from .statics import Statics


class Observable(StrEnum):
    """The part of the load at a node that can be computed from the balance of forces."""

    ALL = "all"
    ACROSS_ROD = "across_rod"
    """Only the part across the node's rod; the part along it goes into the anchor at the rod's other end."""
    ACROSS_JOINED_RODS = "across_joined_rods"
    """Only the part that joined rods do not take; it is shared by the nodes that these rods connect."""
    NONE = "none"
    """No part, because the node is an anchor, which takes any force, or rods alone hold it, which do so."""


@lru_cache(maxsize=1)  # a run asks in every frame, always of one structure
def observable_loads(structure: Structure) -> tuple[Observable, ...]:
    """Return (nodes,) which part of the load at each node is observable."""
    observable = [Observable.ALL] * structure.node_count
    for i, j in structure.rods.tolist():
        for node, other in ((i, j), (j, i)):
            if other in structure.anchors:
                observable[node] = Observable.ACROSS_ROD
    joined = JoinedRods(structure)
    for node, rows in zip(joined.nodes, joined.rows_per_node, strict=True):
        observable[node] = Observable.ACROSS_JOINED_RODS if rows else Observable.NONE
    for node in structure.anchors:
        observable[node] = Observable.NONE
    return tuple(observable)


def observable_part(
    structure: Structure, force_n: NDArray[np.float64], node_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (..., nodes, 3), the observable part of true loads.

    It is F - w w^T F at a node on an anchored rod, and (I - J^+ J) F at the nodes of joined rods, see `joined_rods`.

    Args:
        structure: the structure that the loads act on.
        force_n: (..., nodes, 3) external forces F.
        node_position_m: (..., nodes, 3), which give the rods' directions w; where they are nan, the part of the nodes
            of these rods is nan.
    """
    observable = observable_loads(structure)
    part = force_n.copy()
    part[..., structure.anchors, :] = np.nan
    for i, j in structure.rods.tolist():
        along = node_position_m[..., j, :] - node_position_m[..., i, :]
        length_m = np.linalg.norm(along, axis=-1, keepdims=True)
        along = along / np.where(length_m > 0, length_m, 1.0)  # of a rod whose ends are told at one place, all is seen
        for node in (i, j):
            if observable[node] == Observable.ACROSS_ROD:
                part[..., node, :] -= along * np.sum(along * force_n[..., node, :], axis=-1, keepdims=True)
    joined = JoinedRods(structure)
    if len(joined.nodes):
        known = np.asarray(np.isfinite(node_position_m[..., joined.nodes, :]).all(axis=(-2, -1)))
        of_joined = np.where(known[..., None, None], force_n[..., joined.nodes, :], np.nan)
        allowed = joined.allowed(node_position_m[known]) @ of_joined[known].reshape(-1, 3 * len(joined.nodes), 1)
        of_joined[known] = allowed.reshape(-1, len(joined.nodes), 3)
        part[..., joined.nodes, :] = of_joined
        part[..., joined.nodes[joined.rows_per_node == 0], :] = np.nan
    return part


def external_loads(
    statics: Statics,
    node_position_m: NDArray[np.float64],
    residual_n: NDArray[np.float64],
    residual_variance_n2: NDArray[np.float64],
) -> ExternalLoads:
    """Return the loads that balance the residual of `Statics`: F = -r across rods, -s w along floating rods.

    The residual along a floating rod does not show at which of its ends the load acts; it is attributed to the end
    with the larger load across the rod.

    Args:
        statics: the balance of forces of the structure.
        node_position_m: (..., nodes, 3) positions x.
        residual_n: (..., rows) residual of `Statics.residual_n` at x.
        residual_variance_n2: (..., rows) variance of the residual.
    """
    lead = node_position_m.shape[:-2]
    count = statics.structure.node_count
    nodes = statics.nodes
    rods = statics.floating_rods
    across = residual_n[..., : 3 * len(nodes)]
    axial = residual_n[..., 3 * len(nodes) :]
    force = np.full((*lead, count, 3), np.nan)
    force[..., nodes, :] = -across.reshape(*lead, -1, 3)
    variance = np.full((*lead, count), np.inf)
    variance[..., nodes] = residual_variance_n2[..., : 3 * len(nodes)].reshape(*lead, -1, 3).sum(axis=-1)
    along = node_position_m[..., rods[:, 1], :] - node_position_m[..., rods[:, 0], :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    pushed = np.sum(force[..., rods, :] ** 2, axis=-1)
    first = (pushed[..., 0] >= pushed[..., 1])[..., None]
    force[..., rods[:, 0], :] -= np.where(first, axial[..., None] * along, 0.0)
    force[..., rods[:, 1], :] -= np.where(first, 0.0, axial[..., None] * along)
    variance[..., rods.ravel()] += np.repeat(residual_variance_n2[..., 3 * len(nodes) :], 2, axis=-1)
    directions = np.array(
        [2.0 if part == Observable.ACROSS_ROD else 3.0 for part in observable_loads(statics.structure)]
    )
    joined = statics.joined
    is_held = joined.rows_per_node == 0
    directions[joined.nodes[~is_held]] = joined.rows_per_node[~is_held]
    force[..., joined.nodes[is_held], :], variance[..., joined.nodes[is_held]] = np.nan, np.inf
    return ExternalLoads(force, np.sqrt(variance / directions))
