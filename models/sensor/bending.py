"""The bending sensor, eq. (9): a polynomial of degree five that relates strain and resistance change.

    f(x) = -4.7589 x^5 - 16.521 x^4 - 20.239 x^3 - 9.9675 x^2 - 0.5464 x - 0.0016

The paper does not say which of the two x is. Its text and the captions of Figs. 3D and 4D suggest x = strain (negative
when shortened) and f = dR/R, which is the default. The name f_4(R) in eq. (3) suggests the opposite. The results differ
by up to 14 % of L0, so that the choice is a setting.

f rises on [-1, x_c], x_c = -0.0301, to its maximum y_c = 0.0064, and falls between x_c and x = 0. On this fold two
strains have the same f, so that f is inverted on [-1, x_c] only. The constant term is left out, because f(0) must be 0
for bending and stretching to agree at zero strain; it is an artefact of the fit. Without it y_c = 0.0080.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from ..values.errors import InputError
from ..values.time_series import SmoothedRate

COEFFICIENTS = (-4.7589, -16.521, -20.239, -9.9675, -0.5464, -0.0016)
"""Coefficients of eq. (9), highest power first."""


BENDING_LAG_S = (0.124, 0.236)
"""Time constants of a sensor that bends and of one that straightens: the paper's times to 90 %, 286 and 544 ms, divided
by ln 10."""
LEAST_BENT = -0.1
"""Strain from which strips are bent at least, so that a curve can be told from their recordings."""
SMOOTHING_S = 0.06
"""Time constant of the smoothing of dR/R before its rate is taken for the lag correction."""


class FoldedPolynomial:
    """A polynomial with f(0) = 0 that rises on [x_min, x_c] and falls between x_c and 0.

    x_c <= 0 is its last maximum below 0, or 0 when there is none. x_min is the minimum before x_c, or else -1.

    The inverse is computed as x(s) with s = sqrt(y_c - y), which is smooth at the fold, where x(y) has infinite slope.

    Raises:
        InputError: for a polynomial that does not rise there, or not from `LEAST_BENT` on.
    """

    def __init__(self, coefficients: ArrayLike = COEFFICIENTS) -> None:
        self._f = np.poly1d(np.append(np.asarray(coefficients, dtype=np.float64)[:-1], 0.0))
        critical = [float(x.real) for x in self._f.deriv().roots if abs(x.imag) < 1e-9 and -1 < x.real < 0]
        maxima = [x for x in critical if self._f.deriv(2)(x) < 0]
        self.x_fold = max(maxima, default=0.0)
        self.x_min = max((x for x in critical if x < self.x_fold), default=-1.0)
        self.y_fold = float(self._f(self.x_fold))
        self.y_min = float(self._f(self.x_min))
        self._slope = self._f.deriv()
        self._curvature = abs(float(self._f.deriv(2)(self.x_fold)))
        # the knots are close together in s near the fold, s = 0; the spline is exact to 1e-12 between the knots
        x = self.x_fold - (self.x_fold - self.x_min) * np.linspace(0, 1, 4097)
        s = np.sqrt(np.maximum(self.y_fold - self._f(x), 0))
        if not (self.x_min <= LEAST_BENT < self.x_fold and (np.diff(s) > 0).all()):
            here = f"{self.x_min:.3g} to {self.x_fold:.3g}"
            raise InputError(f"bending curve: expected a polynomial that rises about {LEAST_BENT:g}, got {here}")
        self._x_of_s = CubicSpline(s, x)

    def value(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return f(x) on [x_min, 0]."""
        return np.asarray(self._f(np.clip(x, self.x_min, 0.0)), dtype=np.float64)

    def slope(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return f'(x) on [x_min, 0]."""
        return np.asarray(self._slope(np.clip(x, self.x_min, 0.0)), dtype=np.float64)

    def inverse(self, y: ArrayLike) -> NDArray[np.float64]:
        """Return x on [x_min, x_fold]; y beyond the fold gives the fold, y below f(x_min) gives x_min."""
        s = np.sqrt(np.maximum(self.y_fold - np.maximum(y, self.y_min), 0.0))
        return np.asarray(self._x_of_s(s), dtype=np.float64)

    def inverse_sigma(self, x: ArrayLike, sigma_y: ArrayLike) -> NDArray[np.float64]:
        """Return sigma of x = inverse(y): the smaller of sigma_y / f' and, to second order, sqrt(2 sigma_y / |f''|)."""
        sigma_y = np.asarray(sigma_y, dtype=np.float64)
        slope = np.maximum(np.abs(self.slope(x)), 1e-12)
        return np.minimum(sigma_y / slope, np.sqrt(2 * sigma_y / self._curvature))


class BendingCurve:
    """Eq. (9) as a map between strain <= 0 and relative resistance change dR/R, with x = strain or x = dR/R."""

    def __init__(self, abscissa: Literal["strain", "resistance"] = "strain", coefficients: ArrayLike = COEFFICIENTS):
        self.polynomial = FoldedPolynomial(coefficients)
        self.abscissa = abscissa

    def change(self, strain: ArrayLike) -> NDArray[np.float64]:
        """Return dR/R at a strain in [-1, 0]."""
        return self.polynomial.value(strain) if self.abscissa == "strain" else self.polynomial.inverse(strain)

    def strain(self, change: ArrayLike, sigma_change: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return strain <= 0 and its sigma at a dR/R with its sigma."""
        if self.abscissa == "strain":
            strain = self.polynomial.inverse(change)
            return strain, self.polynomial.inverse_sigma(strain, sigma_change)
        strain = np.minimum(self.polynomial.value(change), 0.0)
        slope = np.maximum(np.abs(self.polynomial.slope(change)), 0.5)
        return strain, slope * np.asarray(sigma_change, dtype=np.float64)

    def in_range(self, change: ArrayLike) -> NDArray[np.bool_]:
        """Return where a dR/R is in the range of the curve."""
        low = self.polynomial.y_min if self.abscissa == "strain" else self.polynomial.x_min
        return np.asarray(np.asarray(change) >= low)


class LagFree:
    """Correction of dR/R for the lag of a bent sensor: y + tau dy/dt, with the rate of the smoothed y.

    On the bending recordings the correction reduces the error of eq. (9) from 0.019 to 0.007 of strain.
    """

    def __init__(self, sensors: int) -> None:
        self._rate = SmoothedRate(sensors, SMOOTHING_S)

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start (sensors,) chosen ones anew: what they read before tells no rate."""
        self._rate.restart(chosen)

    def run(
        self, change: NDArray[np.float64], step_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (samples, sensors) lag-free dR/R, and the correction that was added to the given dR/R.

        Args:
            change: (samples, sensors) dR/R.
            step_s: (samples, sensors), or (samples, 1) for all, the time before each sample.
        """
        rate = self._rate.run(change, step_s)
        lag = np.where(rate < 0, *BENDING_LAG_S) * rate
        return change + lag, lag
