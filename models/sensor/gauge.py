"""The static gauge curve: dR/R as a function of strain without history, and how much sensors differ from it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .bending import BendingCurve

OVERSHOOT = 1.25
"""Ratio of the largest strain that is returned to the largest strain recorded. The bound is needed because a strip that
is released suddenly has a far higher dR/R than any stretched strip."""


@dataclass(frozen=True, eq=False)
class StaticGauge:
    """dR/R = g(strain): piecewise linear when stretched, eq. (9) when bent; g(0) = 0.

    A single sensor measures offset + gain * g.
    """

    strain_knots: NDArray[np.float64]
    """(knots,) increasing strains, the first is 0."""
    change_knots: NDArray[np.float64]
    """(knots,) increasing dR/R at these strains, the first is 0."""
    gain_sigma: float
    """Standard deviation of the gain over sensors; its mean is 1."""
    offset_sigma: float
    """Standard deviation of the offset, dR/R at zero strain, over sensors and time; its mean is 0."""

    def change(self, strain: ArrayLike, bending: BendingCurve) -> NDArray[np.float64]:
        """Return dR/R at a strain of either sign."""
        strain = np.asarray(strain, dtype=np.float64)
        return np.where(strain < 0, bending.change(np.minimum(strain, 0)), self._stretched_change(strain))

    def stretched_strain(self, change: ArrayLike) -> NDArray[np.float64]:
        """Return the strain of a stretched tendon at a dR/R.

        Beyond its knots the curve continues straight, at its upper end up to `most_strain`.
        """
        strain = _interpolate(np.asarray(change, dtype=np.float64), self.change_knots, self.strain_knots)
        return np.asarray(np.minimum(strain, self.most_strain))

    @property
    def most_strain(self) -> float:
        """The largest strain that `stretched_strain` returns."""
        return OVERSHOOT * float(self.strain_knots[-1])

    @cached_property
    def _slopes(self) -> NDArray[np.float64]:
        return np.asarray(np.diff(self.change_knots) / np.diff(self.strain_knots))

    def slope(self, strain: ArrayLike) -> NDArray[np.float64]:
        """Return dg/d(strain) of a stretched tendon."""
        piece = np.searchsorted(self.strain_knots[1:-1], strain, side="right")
        return np.asarray(self._slopes[piece])

    def _stretched_change(self, strain: NDArray[np.float64]) -> NDArray[np.float64]:
        return _interpolate(strain, self.strain_knots, self.change_knots)


def common_change(
    change: NDArray[np.float64], gain: NDArray[np.float64] | float, offset: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return the dR/R that a sensor of gain 1 and offset 0 would measure: (y - offset) / gain."""
    return np.asarray((change - offset) / gain)


def _interpolate(x: NDArray[np.float64], xs: NDArray[np.float64], ys: NDArray[np.float64]) -> NDArray[np.float64]:
    inside = np.interp(x, xs, ys)
    below = (x - xs[0]) * (ys[1] - ys[0]) / (xs[1] - xs[0])
    above = (x - xs[-1]) * (ys[-1] - ys[-2]) / (xs[-1] - xs[-2])
    return np.asarray(inside + np.minimum(below, 0) + np.maximum(above, 0))
