"""The floor: a plane that carries the nodes which stand on it.

Its normal may be told inexactly. With the normal n_0 as told, the floor's axes E, and a tilt t of the floor,

    n = (n_0 + E^T t) / |n_0 + E^T t|

and a point o of the floor, about which it is tilted, a node at x is above it by n . (x - o).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

UP = np.array([0.0, 0.0, 1.0])
"""(3,) against gravity, in the world."""
GRAVITY_M_PER_S2 = 9.81
"""Size g of the acceleration of free fall."""
USUAL_CAP_M = 0.01
"""Radius of an end cap of which nothing is told."""
STANDS_WITHIN_M = 0.005
"""Height above the floor below which a node of the rest shape stands on it."""


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedNormal:
    """The normal of a floor whose normal is not told exactly, as one run estimates it."""

    direction: tuple[float, float, float]
    """Unit vector, upward, in the world."""
    sigma_rad: float
    """Standard deviation of the direction, about the axis about which it is known least."""


@dataclass(frozen=True, eq=False)
class Floor:
    """A plane in the world, whose gravity is along -z."""

    height_m: float
    """Height of the centre of an end cap that stands on the floor, along the normal."""
    normal: NDArray[np.float64]
    """(3,) unit vector, upward."""
    normal_sigma_rad: float = 0.0
    """Standard deviation of the normal's direction, about each of the floor's axes; 0 where it is told exactly."""
    pivot_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """(3,) o, about which the floor is tilted."""
    cap_radius_m: float = USUAL_CAP_M
    """Radius of the end caps, on which rods roll."""

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """(2, 3) two directions along the floor, which with the normal form a right-handed frame."""
        first = np.cross(np.eye(3)[np.argmin(np.abs(self.normal))], self.normal)
        first = first / np.linalg.norm(first)
        return np.stack([first, np.cross(self.normal, first)])

    @property
    def tilt_count(self) -> int:
        """Number of unknowns of the normal: two, or none where it is told exactly."""
        return 2 if self.normal_sigma_rad > 0 else 0

    def under(self, node_position_m: NDArray[np.float64]) -> "Floor":
        """Return the floor moved along its normal to the middle of the three lowest nodes, about which it is tilted."""
        lowest = np.argsort(self.clearance_m(node_position_m))[:3]
        pivot_m = node_position_m[lowest].mean(axis=0)
        return replace(self, height_m=float(self.normal @ pivot_m), pivot_m=pivot_m)

    def tilted(self, tilt: NDArray[np.float64]) -> "Floor":
        """Return the floor with a (2,) tilt; the same floor for (0,), where the normal is told exactly."""
        if not len(tilt):
            return self
        normal = self.normal + tilt @ self.axes
        normal = normal / np.linalg.norm(normal)
        return replace(self, height_m=self.height_m + float((normal - self.normal) @ self.pivot_m), normal=normal)

    def estimated(self, tilt: NDArray[np.float64], covariance: NDArray[np.float64]) -> EstimatedNormal | None:
        """Return the normal of a (tilts,) tilt with its (tilts, tilts) covariance; None where it is told exactly."""
        if not len(tilt):
            return None
        x, y, z = self.tilted(tilt).normal.tolist()
        return EstimatedNormal((x, y, z), float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))

    def clearance_by_tilt_m(
        self, node_position_m: NDArray[np.float64], tilt: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (nodes, tilts) the derivatives of (nodes, 3) positions' heights above the floor by its tilt."""
        if not len(tilt):
            return np.zeros((len(node_position_m), 0))
        n = self.tilted(tilt).normal
        by_tilt = (self.axes - np.outer(self.axes @ n, n)) / np.linalg.norm(self.normal + tilt @ self.axes)
        return np.asarray((node_position_m - self.pivot_m) @ by_tilt.T)

    def clearance_m(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., nodes) the height of each node above that of a node which stands on the floor."""
        return np.asarray(node_position_m @ self.normal - self.height_m)

    def carries_at_rest(self, node_position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (nodes,) which nodes stand on the floor in the rest shape: those near it, or the lowest three."""
        clearance_m = self.clearance_m(node_position_m)
        return np.asarray(clearance_m <= max(STANDS_WITHIN_M, float(np.sort(clearance_m)[2])))
