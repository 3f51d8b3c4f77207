"""The floor: a plane that carries the nodes which stand on it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

UP = np.array([0.0, 0.0, 1.0])
"""(3,) against gravity, in the world."""
STANDS_WITHIN_M = 0.005
"""Height above the floor below which a node of the rest shape stands on it."""


@dataclass(frozen=True, eq=False)
class Floor:
    """A plane in the world, whose gravity is along -z."""

    height_m: float
    """Height of the centre of an end cap that stands on the floor, along the normal: the radius of the cap."""
    normal: NDArray[np.float64]
    """(3,) unit vector, upward."""

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """(2, 3) two directions along the floor, which with the normal form a right-handed frame."""
        first = np.cross(np.eye(3)[np.argmin(np.abs(self.normal))], self.normal)
        first = first / np.linalg.norm(first)
        return np.stack([first, np.cross(self.normal, first)])

    def clearance_m(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., nodes) the height of each node above that of a node which stands on the floor."""
        return np.asarray(node_position_m @ self.normal - self.height_m)

    def carries_at_rest(self, node_position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (nodes,) which nodes stand on the floor in the rest shape: those near it, or the lowest three."""
        clearance_m = self.clearance_m(node_position_m)
        return np.asarray(clearance_m <= max(STANDS_WITHIN_M, float(np.sort(clearance_m)[2])))
