"""The bending sensor, eq. (9): a polynomial of degree five between strain and resistance change.

    f(x) = -4.7589 x^5 - 16.521 x^4 - 20.239 x^3 - 9.9675 x^2 - 0.5464 x - 0.0016

The paper does not say which of the two x is. The text and the captions of Figs. 3D and 4D speak for x = strain
(negative when shortened) and f = dR/R; that is the default. The name f_4(R) in eq. (3) speaks for the opposite. The
two differ by up to 14 % of L0, so it is a setting.

f rises on [-1, x_c], x_c = -0.0301, to its maximum y_c = 0.0064, and falls from there to x = 0: on that fold two
strains have the same f, so it is inverted on [-1, x_c] only. The constant term is a fit's residue (f(0) must be 0,
or bending and stretching would not join), and is left out: y_c = 0.0080 then.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from ..values.low_pass import smoothed_rate

COEFFICIENTS = (-4.7589, -16.521, -20.239, -9.9675, -0.5464, -0.0016)
"""Of eq. (9), highest power first."""


BENDING_LAG_S = (0.124, 0.236)
"""Time constants of a bent sensor, bending and straightening: the paper's 286 and 544 ms to 90 %, over ln 10."""
SMOOTHING_S = 0.06
"""Memory of the rate by which the lag is undone."""


class FoldedPolynomial:
    """A polynomial that rises on [x_min, x_c] and folds over at x_c <= 0; f(0) = 0.

    x_c is its last maximum below 0 (0 without one), x_min the minimum before that, where there is one.

    Inverted as x(s), s = sqrt(y_c - y): that is smooth at the fold, where x(y) has infinite slope.
    """

    def __init__(self, coefficients: ArrayLike = COEFFICIENTS, x_min: float = -1.0) -> None:
        self._f = np.poly1d(np.append(np.asarray(coefficients, dtype=np.float64)[:-1], 0.0))
        critical = [float(x.real) for x in self._f.deriv().roots if abs(x.imag) < 1e-9 and x_min < x.real < 0]
        maxima = [x for x in critical if self._f.deriv(2)(x) < 0]
        self.x_fold = max(maxima, default=0.0)
        self.x_min = max((x for x in critical if x < self.x_fold), default=x_min)
        self.y_fold = float(self._f(self.x_fold))
        self.y_min = float(self._f(x_min))
        self._curvature = abs(float(self._f.deriv(2)(self.x_fold)))
        # knots close together where s = 0, that is at the fold; 1e-12 exact between them
        x = self.x_fold - (self.x_fold - x_min) * np.linspace(0, 1, 4097)
        self._x_of_s = CubicSpline(np.sqrt(np.maximum(self.y_fold - self._f(x), 0)), x)

    def value(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return f(x) on [x_min, 0]."""
        return np.asarray(self._f(np.clip(x, self.x_min, 0.0)), dtype=np.float64)

    def slope(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return f'(x) on [x_min, 0]."""
        return np.asarray(self._f.deriv()(np.clip(x, self.x_min, 0.0)), dtype=np.float64)

    def inverse(self, y: ArrayLike) -> NDArray[np.float64]:
        """Return x on [x_min, x_fold]; y beyond the fold gives the fold, y below f(x_min) gives x_min."""
        s = np.sqrt(np.maximum(self.y_fold - np.maximum(y, self.y_min), 0.0))
        return np.asarray(self._x_of_s(s), dtype=np.float64)

    def inverse_sigma(self, x: ArrayLike, sigma_y: ArrayLike) -> NDArray[np.float64]:
        """Return sigma of x = inverse(y): sigma_y / f', and at the fold, to second order, sqrt(2 sigma_y / |f''|)."""
        sigma_y = np.asarray(sigma_y, dtype=np.float64)
        slope = np.maximum(np.abs(self.slope(x)), 1e-12)
        return np.minimum(sigma_y / slope, np.sqrt(2 * sigma_y / self._curvature))


class BendingCurve:
    """Eq. (9) as a map between strain <= 0 and relative resistance change dR/R, in either reading."""

    def __init__(self, abscissa: Literal["strain", "resistance"] = "strain", coefficients: ArrayLike = COEFFICIENTS):
        self.polynomial = FoldedPolynomial(coefficients)
        self.abscissa = abscissa

    @property
    def ambiguous_change(self) -> float:
        """The dR/R below which no stretched tendon stands, and up to which bent ones do: the height of the fold."""
        return self.polynomial.y_fold if self.abscissa == "strain" else 0.0

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
        """Return where a dR/R is one the curve can give."""
        low = self.polynomial.y_min if self.abscissa == "strain" else self.polynomial.x_min
        return np.asarray(np.asarray(change) >= low)


class LagFree:
    """dR/R with a bent sensor's lag undone: y + tau dy/dt, the rate taken of y smoothed.

    On the bending recordings that takes the error of eq. (9) from 0.019 to 0.007 strain.
    """

    def __init__(self, sensors: int) -> None:
        self._smooth = np.full(sensors, np.nan)

    def step(self, change: NDArray[np.float64], step_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (sensors,) lag-free dR/R, and by how much it differs from the given one."""
        smooth = np.where(np.isnan(self._smooth), change, self._smooth)
        rate = smoothed_rate(change, smooth, step_s, SMOOTHING_S)
        self._smooth = smooth + rate * step_s
        lag = np.where(rate < 0, *BENDING_LAG_S) * rate
        return change + lag, lag
