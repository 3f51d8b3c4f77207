"""The rest shape: where the structure stands before anyone touches it, and what it says of the tendons."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..values.readings import RestLengths
from ..values.tables import Positive
from .lengths import length_jacobian, propagated_variance
from .statics import Mechanics
from .structure import Structure


@dataclass(frozen=True, slots=True)
class RestSettings:
    """How well the structure at rest is known beforehand."""

    measured_sigma_m: Positive = 0.0003
    """Of a node measured by motion capture, per axis."""
    found_sigma_m: Positive = 0.003
    """Of a node found from lengths alone, per axis: 10 % of spread in stiffness and gravity move nodes by so much."""
    stiffness_spread: Positive = 0.10
    """By which share tendons of one make differ in stiffness."""
    natural_length_sigma_m: Positive = 0.0003
    """Of a natural length, as a ruler gives it."""
    force_sigma_n: Positive = 0.02
    """Of the balance of forces at rest: sway, creep and hysteresis of the rubber."""


@dataclass(frozen=True, slots=True, eq=False)
class RestShape:
    """The unloaded shape, with its uncertainty, and the mechanics that balance there."""

    node_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes)"""
    source: Literal["measured", "found"]
    mechanics: Mechanics | None = None
    """Tared at this shape; None where stiffness is not known."""
    at_start: bool = True
    """Whether the structure stands there when the first frame is taken."""
    unbalanced_n: tuple[float, float] = (float("nan"), float("nan"))
    """Root mean square of the unbalanced forces there, with nominal and with tared mechanics."""

    def lengths(self, structure: Structure, seconds: float) -> RestLengths:
        """Return the tendon lengths at rest with their sigma."""
        variance = propagated_variance(length_jacobian(self.node_position_m, structure.tendons), self.covariance_m2)
        length_m = structure.tendon_length_m(self.node_position_m)
        return RestLengths(seconds, length_m, np.sqrt(np.maximum(variance, 1e-12)))
