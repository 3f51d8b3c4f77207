"""Where a structure is not what trial.toml says: the truth stays what stands there, what is told is off."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from ..values.tables import NotNegative


@dataclass(frozen=True, slots=True)
class GeometryError:
    """`[geometry_error]` of a plan: errors of what trial.toml tells, normal, and hubs that it does not tell of."""

    rod_length_sigma_m: NotNegative = 0.0
    """Standard deviation over rods of the length told, as of rods cut by hand."""
    rod_length_offset_m: float = 0.0
    """By how much all rods are told too long, as by a ruler that starts elsewhere."""
    anchor_sigma_m: NotNegative = 0.0
    """Per axis, of the anchors' positions told."""
    rest_position_sigma_m: NotNegative = 0.0
    """Per node and axis, of the rest shape told, on top of `rest.node_position_sigma_m`."""
    natural_length_sigma_m: NotNegative = 0.0
    """Standard deviation over tendons of the natural length told."""
    hub_radius_m: tuple[NotNegative, NotNegative] | None = None
    """Least and largest distance from the end of a rod to where a tendon ends: each tendon's end has its own, drawn
    evenly, at right angles to the rod and on the side to which the tendon goes. The hub turns with its rod. Natural
    lengths are shorter by so much that strains at rest stay about the same. None: tendons end at the ends of the rods.
    """


@dataclass(frozen=True, slots=True, eq=False)
class ToldErrors:
    """What one seed makes of it: added to what is true gives what is told."""

    rod_length_m: NDArray[np.float64]
    """(rods,)"""
    anchor_m: NDArray[np.float64]
    """(anchors, 3)"""
    rest_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    natural_length_m: NDArray[np.float64]
    """(tendons,)"""

    @classmethod
    def draw(cls, plan: GeometryError, structure: Structure, rng: np.random.Generator) -> "ToldErrors":
        """Return the errors; each kind is drawn whether it is wanted or not, so that none depends on another."""
        rods = rng.normal(size=len(structure.rods))
        anchors = rng.normal(size=(len(structure.anchors), 3))
        nodes = rng.normal(size=(structure.node_count, 3))
        tendons = rng.normal(size=len(structure.tendons))
        return cls(
            plan.rod_length_offset_m + plan.rod_length_sigma_m * rods,
            plan.anchor_sigma_m * anchors,
            plan.rest_position_sigma_m * nodes,
            plan.natural_length_sigma_m * tendons,
        )


def hub_offset_m(
    structure: Structure,
    node_position_m: NDArray[np.float64],
    radius_m: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return (tendons, 2, 3) from the node at either end of a tendon to where it ends on that node's hub.

    Args:
        structure: whose rods carry the hubs; a node on no rod has none.
        node_position_m: (nodes, 3) where tendons leave as they will at rest.
        radius_m: least and largest distance.
        rng: of the distances.
    """
    position_m = node_position_m
    along = np.zeros_like(position_m)
    for a, b in structure.rods:
        along[a] = (position_m[b] - position_m[a]) / np.linalg.norm(position_m[b] - position_m[a])
        along[b] = -along[a]
    ends = structure.tendons
    leaving = position_m[ends[:, ::-1]] - position_m[ends]
    across = leaving - (leaving * along[ends]).sum(axis=2, keepdims=True) * along[ends]
    has_hub = along[ends].any(axis=2, keepdims=True)
    radius = rng.uniform(*radius_m, size=ends.shape)[..., None]
    distance = np.maximum(np.linalg.norm(across, axis=2, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(np.where(has_hub, radius * across / distance, 0.0))


def end_to_end_m(
    structure: Structure, node_position_m: NDArray[np.float64], hub_offset_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (tendons,) lengths from hub to hub, the offsets as they stand at (nodes, 3) positions."""
    ends_m = node_position_m[structure.tendons] + hub_offset_m
    return np.asarray(np.linalg.norm(ends_m[:, 1] - ends_m[:, 0], axis=1))
