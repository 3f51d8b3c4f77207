"""The rest shape: the shape of the structure without load, and the tendon lengths in it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..values.chi_squared import are_improbable
from ..values.readings import RestLengths
from ..values.tables import NotNegative, Positive
from .lengths import length_jacobian, propagated_variance
from .mechanics import Mechanics
from .structure import Structure


@dataclass(frozen=True, slots=True)
class RestSettings:
    """Standard deviations of what is known of the structure at rest before the first reading."""

    measured_sigma_m: Positive = 0.0003
    """Standard deviation per axis of a rest position that was measured by motion capture."""
    found_sigma_m: Positive = 0.003
    """Standard deviation per axis of a rest position from form finding, which ignores gravity and a spread of 10 % in
    stiffness; these two move nodes by about this distance."""
    stiffness_spread: Positive = 0.10
    """Relative standard deviation of the stiffness of tendons of one make."""
    natural_length_sigma_m: Positive = 0.0003
    """Standard deviation of a natural length that is measured with a ruler."""
    force_sigma_n: Positive = 0.02
    """Standard deviation of the balance of forces at rest: sway, creep and hysteresis of the rubber."""


UncertainPart = Literal["rods", "anchors", "natural lengths", "rest shape", "axes", "hubs"]
"""A part of the geometry that may have been told wrongly: `axes` are those in which the rest shape was measured, and
`hubs` means that tendons end beside the ends of the rods."""
WrongPart = UncertainPart | Literal["floor", "mirror", "several"]
"""What is wrong of the geometry. With `mirror`, nothing was told that tells the shape from its mirror image; with
`several`, rods, anchors or natural lengths that are wrong do not explain the rest."""
MENDED: frozenset[WrongPart] = frozenset(["rods", "anchors", "natural lengths"])
"""The parts whose estimates replace what was told, without doubt if only one was told wrongly."""
RestSource = Literal["measured", "lengths", "found"]
"""What tells the rest shape: its measured positions, or the lengths at rest; it is found from natural lengths and
stiffness alone where neither was measured."""


@dataclass(frozen=True, slots=True)
class GeometrySigma:
    """How exactly the geometry of a structure is known."""

    rod_length_m: Positive = 0.0002
    """Standard deviation of a rod's length."""
    anchor_m: Positive = 0.0001
    """Standard deviation of an anchor's position, per axis."""
    hub_radius_m: NotNegative = 0.0
    """Distance from a rod's end at which its tendons end, in an unknown direction."""


@dataclass(frozen=True, slots=True, eq=False)
class RestShape:
    """The unloaded shape with its covariance, and the geometry and mechanics that were estimated with it."""

    structure: Structure
    """The structure with the rods and anchors of this shape."""
    node_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes), anchors included; the error is the same in every frame."""
    source: RestSource
    mechanics: Mechanics | None = None
    """The mechanics tared at this shape; None where stiffness is not known."""
    mechanics_covariance: NDArray[np.float64] | None = None
    """(2 tendons, 2 tendons) covariance of the log of the stiffnesses, and then of the natural lengths in m,
    given this shape: the error of the shape is the same in every frame."""
    at_start: bool = True
    """Whether the structure stands at its rest shape in the first frame."""
    wrong: tuple[WrongPart, ...] = ()
    """The parts of the geometry that were told wrongly by the evidence at rest; none where all agrees."""
    hub_force_n: float = 0.0
    """Standard deviation of the balance of forces at a node, because its tendons end on a hub."""
    unbalanced_n: tuple[float, float] = (float("nan"), float("nan"))
    """Root mean square of the unbalanced forces at this shape, with nominal and with tared mechanics."""

    @property
    def node_mass_kg(self) -> NDArray[np.float64]:
        """(nodes,) see `Mechanics.node_mass_kg`; zeros where no mass is known."""
        return self.mechanics.node_mass_kg(self.structure) if self.mechanics else np.zeros(self.structure.node_count)

    @property
    def is_doubted(self) -> bool:
        """Whether what is wrong of the geometry is not mended, or is more than one part: all shapes are in doubt."""
        return len(self.wrong) > 1 or not MENDED.issuperset(self.wrong)

    def as_table(self) -> dict[str, str]:
        """Return what run.toml tells of it: its source, and the parts of the geometry that were told wrongly."""
        return {"rest_shape": self.source, "wrong_geometry": ", ".join(self.wrong) or "none"}

    @property
    def largest_sigma_m(self) -> float:
        """Largest standard deviation of a coordinate."""
        return float(np.sqrt(np.diag(self.covariance_m2).max()))

    def misfits(self, measured: RestLengths) -> bool:
        """Return whether measured lengths are not those of this shape, even without two, whose sensors may be wrong."""
        read = measured.is_read
        apart_m = measured.length_m - self.structure.tendon_length_m(self.node_position_m)
        return are_improbable(apart_m[read] / measured.sigma_m[read], faulty=2)

    def lengths(self, seconds: float) -> RestLengths:
        """Return the tendon lengths at rest with their sigma; the structure stands there for the given seconds."""
        variance = propagated_variance(
            length_jacobian(self.node_position_m, self.structure.tendons), self.covariance_m2
        )
        length_m = self.structure.tendon_length_m(self.node_position_m)
        return RestLengths(seconds, length_m, np.sqrt(np.maximum(variance, 1e-12)))
