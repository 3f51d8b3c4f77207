"""The support of a structure: what gravity and the floor do to its nodes, as far as they are known.

The mass m of a node, which is half that of each member that ends there, pulls it down with m g. The floor carries the
nodes that stand on it: without other loads three of them carry the weight W like a table with three legs,

    sum N_k = W,   sum N_k x_k = W x_c    (across the direction of gravity, with the centroid x_c)

and what a hand adds, and friction, is unknown.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.floor import GRAVITY_M_PER_S2
from ..structure.lengths import LEAST_M
from ..structure.structure import Structure

LEAST_N = 1e-6
"""Least weight of a structure, so that one without mass can stand, too."""
FRICTION = 0.5
"""Ratio of the standard deviation of friction to the load that a node carries: rubber or plastic on a floor."""


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """The expected force of gravity and floor at each node, with its covariance."""

    force_n: NDArray[np.float64]
    """(..., nodes, 3)"""
    covariance_n2: NDArray[np.float64]
    """(..., nodes, 3, 3)"""

    def part(self, frames: slice | NDArray[np.int64]) -> "Support":
        """Return that in some of several frames."""
        return Support(self.force_n[frames], self.covariance_n2[frames])


def hung_up(node_mass_kg: NDArray[np.float64]) -> Support:
    """Return the support of (nodes,) masses in the anchors' frame: gravity along -z, and no floor."""
    force_n = (node_mass_kg * GRAVITY_M_PER_S2)[:, None] * np.array([0.0, 0.0, -1.0])
    return Support(force_n, np.zeros((len(node_mass_kg), 3, 3)))


def weightless(node_mass_kg: NDArray[np.float64]) -> Support:
    """Return the support of a structure that may be turned and carried in any way: a force of unknown direction."""
    variance = (node_mass_kg * GRAVITY_M_PER_S2) ** 2 / 3
    return Support(np.zeros((len(node_mass_kg), 3)), variance[:, None, None] * np.eye(3))


def in_the_air(structure: Structure, node_mass_kg: NDArray[np.float64]) -> Support:
    """Return the support of a structure without a floor: where nothing anchors it, gravity may be in any direction."""
    return (weightless if structure.is_free_standing else hung_up)(node_mass_kg)


def standing(
    node_mass_kg: NDArray[np.float64],
    node_position_m: NDArray[np.float64],
    up: NDArray[np.float64],
    up_sigma: float,
    carried: NDArray[np.float64],
) -> Support:
    """Return the support of a structure that stands on a floor; up and carried may have leading axes.

    Args:
        node_mass_kg: (nodes,) mass at each node, see `Mechanics.node_mass_kg`.
        node_position_m: (nodes, 3) in any coordinate frame.
        up: (..., 3) unit vector against gravity in the same frame.
        up_sigma: standard deviation of this direction, in rad.
        carried: (..., nodes) probability that the floor carries each node.
    """
    weight = node_mass_kg * GRAVITY_M_PER_S2
    carried_n, spread_n = legs_n(weight, node_position_m, up, carried)
    force_n = (carried_n - weight)[..., None] * up[..., None, :]
    upward = up[..., None, :, None] * up[..., None, None, :]
    along = spread_n**2
    across = (FRICTION * carried_n) ** 2 + 0.5 * (weight * np.minimum(up_sigma, 1.0)) ** 2
    covariance = along[..., None, None] * upward + across[..., None, None] * (np.eye(3) - upward)
    return Support(force_n, covariance)


def legs_n(
    weight_n: NDArray[np.float64], x: NDArray[np.float64], up: NDArray[np.float64], carried: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (..., nodes) the load that the floor carries at each node, and its standard deviation.

    The loads are those of least squares about equal shares, in proportion to the probability of being carried.
    """
    total = max(float(weight_n.sum()), LEAST_N)
    share = carried / np.maximum(carried.sum(axis=-1, keepdims=True), 1.0)
    centred = x - weight_n @ x / total
    level = centred - (centred @ up[..., None]) * up[..., None, :]
    spread_m = np.sqrt(np.mean(level**2, axis=(-2, -1), keepdims=True))
    scaled = np.swapaxes(level, -1, -2) / np.maximum(spread_m, LEAST_M)  # none where all nodes are above one another
    rows = np.concatenate([np.ones((*scaled.shape[:-2], 1, len(x))), scaled], axis=-2)
    scale = np.sqrt(share) * total
    gap = total * np.eye(4)[0] - (rows @ (share * total)[..., None])[..., 0]
    step = np.linalg.pinv(rows * scale[..., None, :], rcond=1e-3) @ gap[..., None]
    loads = np.clip(share * total + scale * step[..., 0], 0.0, total)
    doubtful = carried * (1 - carried)
    return carried * loads, np.sqrt(carried * (0.3 * total / 3) ** 2 + doubtful * loads**2)
