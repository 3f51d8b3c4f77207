"""How a structure differs from what trial.toml says of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from ..values.tables import NotNegative


@dataclass(frozen=True, slots=True)
class GeometryError:
    """`[geometry_error]` of a plan: normal errors of the numbers in trial.toml, and hubs that trial.toml leaves out.

    The truth is not changed by the errors: only the numbers in trial.toml are.
    """

    rod_length_sigma_m: NotNegative = 0.0
    """Standard deviation, over rods, of the error of the rod length; rods that were cut by hand have such an error."""
    rod_length_offset_m: float = 0.0
    """Error that all rod lengths share; positive: trial.toml says that the rods are too long."""
    anchor_sigma_m: NotNegative = 0.0
    """Standard deviation of the error of each anchor's position, per axis."""
    rest_position_sigma_m: NotNegative = 0.0
    """Standard deviation of the error of the rest shape, per node and axis, in addition to
    `rest.node_position_sigma_m`."""
    natural_length_sigma_m: NotNegative = 0.0
    """Standard deviation, over tendons, of the error of the natural length."""
    hub_radius_m: tuple[NotNegative, NotNegative] | None = None
    """Least and largest distance from the end of a rod to the end of a tendon. Each end of a tendon has its own
    distance, drawn evenly, at a right angle to the rod and on the side to which the tendon goes. The hub turns with its
    rod. Natural lengths are reduced such that the strains at rest are about the same. None: tendons end at the ends of
    the rods."""


@dataclass(frozen=True, slots=True, eq=False)
class ToldErrors:
    """The errors that one seed draws. Each is added to a true number and gives the number in trial.toml."""

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
        """Return the errors.

        Each kind is drawn even if its standard deviation is zero, so that the numbers of one kind do not depend on
        another.
        """
        rods = rng.normal(size=len(structure.rods))
        anchors = rng.normal(size=(len(structure.anchors), 3))
        nodes = rng.normal(size=(structure.node_count, 3))
        tendons = rng.normal(size=len(structure.tendons))
        return cls(
            rod_length_m=plan.rod_length_offset_m + plan.rod_length_sigma_m * rods,
            anchor_m=plan.anchor_sigma_m * anchors,
            rest_position_m=plan.rest_position_sigma_m * nodes,
            natural_length_m=plan.natural_length_sigma_m * tendons,
        )


def hub_offset_m(
    structure: Structure,
    node_position_m: NDArray[np.float64],
    radius_m: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return (tendons, 2, 3) offsets from the node at either end of a tendon to the point on the hub at which it ends.

    Args:
        structure: its rods carry the hubs; a node that is on no rod has no hub.
        node_position_m: (nodes, 3) positions in which tendons have the directions that they have at rest.
        radius_m: least and largest distance.
        rng: random numbers of the distances.
    """
    along = np.zeros_like(node_position_m)
    for a, b in structure.rods:
        rod_m = node_position_m[b] - node_position_m[a]
        along[a] = rod_m / np.linalg.norm(rod_m)
        along[b] = -along[a]
    ends = structure.tendons
    leaving_m = node_position_m[ends[:, ::-1]] - node_position_m[ends]
    across = leaving_m - (leaving_m * along[ends]).sum(axis=2, keepdims=True) * along[ends]
    has_hub = along[ends].any(axis=2, keepdims=True)
    radius = rng.uniform(*radius_m, size=ends.shape)[..., None]
    distance = np.maximum(np.linalg.norm(across, axis=2, keepdims=True), np.finfo(np.float64).tiny)
    return np.asarray(np.where(has_hub, radius * across / distance, 0.0))


def end_to_end_m(
    structure: Structure, node_position_m: NDArray[np.float64], hub_offset_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (tendons,) lengths from hub to hub, with offsets that belong to these (nodes, 3) positions."""
    ends_m = node_position_m[structure.tendons] + hub_offset_m
    return np.asarray(np.linalg.norm(ends_m[:, 1] - ends_m[:, 0], axis=1))
