"""A recurrent network from resistance to shape, without geometry or forces: the learned rival of the factor graph."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .sensor.lstm import LstmWeights
from .structure.structure import Structure
from .values.errors import InputError

LENGTH_TOLERANCE = 0.1
"""Relative difference of a tendon's length at rest from that in the training, above which the structure is another."""
LOG_SCALE_RANGE = (-3.0, 3.0)
"""Range to which the last output, the log of the scale of the error, is clipped."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeNetwork:
    """Weights, scales and error of a network that was trained for one structure.

    With y the (tendons,) dR/R of all sensors since the rest shape, X_t = y / `change_scale` is the input of the LSTM,
    eqs. (10)-(15), and its head gives (n, s): the free nodes are at rest + `displacement_scale_m` n, with covariance
    exp(2 s) `covariance_m2`.
    """

    weights: LstmWeights
    change_scale: float
    displacement_scale_m: float
    covariance_m2: NDArray[np.float64]
    """(3 free, 3 free) covariance of the errors over exp(s), on trials that were not used in training."""
    rods: NDArray[np.int64]
    """(rods, 2) of the structure."""
    tendons: NDArray[np.int64]
    """(tendons, 2) of the structure."""
    anchors: NDArray[np.int64]
    """(anchors,) of the structure."""
    rest_length_m: NDArray[np.float64]
    """(tendons,) lengths at rest, the mean over the training."""

    def check(self, structure: Structure, rest_length_m: NDArray[np.float64]) -> None:
        """Check that a structure is the one of the training.

        Args:
            structure: any structure.
            rest_length_m: (tendons,) its lengths at rest.

        Raises:
            InputError: when it is another, or of another size.
        """
        for part in ("rods", "tendons", "anchors"):
            if not np.array_equal(getattr(self, part), getattr(structure, part)):
                raise InputError(f"method 'network': expected the structure of its training, got other {part}")
        worst = float(np.max(np.abs(rest_length_m / self.rest_length_m - 1)))
        if worst > LENGTH_TOLERANCE:
            raise InputError(
                f"method 'network': expected tendons at rest as long as in its training, got one {worst:.0%} off"
            )
