"""External loads as estimated: what the balance of forces leaves over, node by node."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from .statics import Statics
from .structure import Structure

LOAD_THRESHOLD_N = 0.2
"""Above it a node is called loaded. On the development trials unloaded nodes show 0.03 to 0.06 N rms while nothing is
pressed, and 0.5 to 2 % of them more than this."""


class Observable(StrEnum):
    """Which part of the load at a node the balance of forces shows."""

    ALL = "all"
    ACROSS_ROD = "across_rod"
    """The part along its rod goes into the anchor at the rod's other end."""
    NONE = "none"
    """An anchor takes any force."""


@dataclass(frozen=True, slots=True, eq=False)
class ExternalLoads:
    """Estimated external forces at the nodes; leading axes are frames."""

    force_n: NDArray[np.float64]
    """(..., nodes, 3) nan at anchors; zero along the rod where that part is not observable."""
    sigma_n: NDArray[np.float64]
    """(..., nodes) root mean square over the observable directions; inf at anchors."""


def observable_loads(structure: Structure) -> tuple[Observable, ...]:
    """Return (nodes,) what is seen of the load at each node."""
    seen = [Observable.ALL] * structure.node_count
    for i, j in structure.rods.tolist():
        for node, other in ((i, j), (j, i)):
            if other in structure.anchors:
                seen[node] = Observable.ACROSS_ROD
    for node in structure.anchors:
        seen[node] = Observable.NONE
    return tuple(seen)


def observable_part(
    structure: Structure, force_n: NDArray[np.float64], node_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (..., nodes, 3), what the balance of forces shows of true ones: F - w w^T F at nodes on an anchored rod.

    Args:
        structure: whose nodes they are.
        force_n: (..., nodes, 3) external forces.
        node_position_m: (..., nodes, 3), for the rods' directions w.
    """
    seen = observable_loads(structure)
    part = force_n.copy()
    part[..., structure.anchors, :] = np.nan
    for i, j in structure.rods.tolist():
        along = node_position_m[..., j, :] - node_position_m[..., i, :]
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        for node in (i, j):
            if seen[node] == Observable.ACROSS_ROD:
                part[..., node, :] -= along * np.sum(along * force_n[..., node, :], axis=-1, keepdims=True)
    return part


def external_loads(
    statics: Statics,
    node_position_m: NDArray[np.float64],
    residual_n: NDArray[np.float64],
    residual_variance_n2: NDArray[np.float64],
) -> ExternalLoads:
    """Return the loads that would balance the residual of `Statics`: F = -r across rods, -s w along floating ones.

    Which end of a floating rod is pushed along it can not be told; it is taken to be the one pushed more across it.

    Args:
        statics: of the structure.
        node_position_m: (..., nodes, 3).
        residual_n: (..., rows) of `Statics.residual_n` there.
        residual_variance_n2: (..., rows) of it.
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
        [2.0 if seen == Observable.ACROSS_ROD else 3.0 for seen in observable_loads(statics.structure)]
    )
    return ExternalLoads(force, np.sqrt(variance / directions))
