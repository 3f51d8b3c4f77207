"""Lengths that are told, as of sensors of one's own: each is used as far as it agrees with itself.

Left out are values that jump (`JumpGate`), and those of a sensor that is stuck. Lengths that are read have noise: if r
of the n values of a sensor at rest are equal to the value before, k equal ones in succession have the probability

    p^k,     p = (r + 1) / (n + 1)

by Laplace's rule, in motion less often. A whole row that repeats is told by `RepeatWatch`.

At rest a length does not change. If the variance s^2 of n values there is larger than chance allows for their sigma, as

    (n - 1) s^2 / sigma^2 > chi2_{n-1}(1 - `CHANCE`)

the sigma of this sensor counts s / sigma times from then on.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .sensor.gate import GateSettings, JumpGate
from .structure.shape import chi_squared_quantile
from .values.readings import Flag, TendonLengths

CHANCE = 1e-6
"""Probability that the values of a sensor whose sigma is right scatter as much as is taken for a wrong sigma."""


class ToldLengths:
    """Checks one row of lengths after the other."""

    def __init__(
        self,
        settings: GateSettings,
        full_m: NDArray[np.float64],
        rest_seconds: float,
        unstated_m: float,
    ) -> None:
        """Begin before the first row.

        Args:
            settings: when a value is left out.
            full_m: (tendons,) the length to which strain is relative.
            rest_seconds: how long the structure rests from the first row on.
            unstated_m: standard deviation of a length that is told without one.
        """
        self._settings = settings
        self._full_m = full_m
        self._rest_seconds = rest_seconds
        self._unstated_m = unstated_m
        count = len(full_m)
        self._jumps = JumpGate(settings, count)
        self._first_s = np.nan
        self._last_m = np.full(count, np.nan)
        self._same_since_s = np.full(count, np.nan)
        self._run = np.zeros(count)
        self._repeats = np.zeros(count)
        self._count = np.zeros(count)
        self._mean_m = np.zeros(count)
        self._squares = np.zeros(count)
        self._scale = np.ones(count)

    def checked(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths of one more row, with a sigma each, and without those that are left out."""
        self._first_s = lengths.t_s if np.isnan(self._first_s) else self._first_s
        sigma_m = np.where(np.isnan(lengths.sigma_m), self._unstated_m, lengths.sigma_m)
        counted_m = self._scale * sigma_m
        jumped = self._jumps.outliers(lengths.t_s, lengths.length_m / self._full_m, counted_m / self._full_m)
        stuck = self._stuck(lengths.t_s, lengths.length_m)
        length_m = np.where(jumped | stuck, np.nan, lengths.length_m)
        if self._is_at_rest(lengths.t_s):
            self._rest(length_m, sigma_m)
        flags = np.where(jumped, int(Flag.OUTLIER), 0) | np.where(stuck, int(Flag.STUCK), 0)
        return replace(
            lengths,
            length_m=length_m,
            sigma_m=np.where(np.isnan(length_m), np.inf, self._scale * sigma_m),
            flags=lengths.flags | flags,
        )

    def warnings(self) -> dict[str, str]:
        """Return of each tendon whose sigma counts more than it was told why that is so."""
        return {
            f"tendon {e}": f"at rest it scatters by {self._scale[e]:.1f} times its sigma, which is widened by as much"
            for e in np.flatnonzero(self._scale > 1)
        }

    def _is_at_rest(self, t_s: float) -> bool:
        return t_s - self._first_s < self._rest_seconds

    def _stuck(self, t_s: float, length_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (tendons,) whose values are equal for longer than noise allows, while others change."""
        told = np.isfinite(length_m)
        same = told & (length_m == self._last_m)
        self._last_m = np.where(told, length_m, self._last_m)
        if self._is_at_rest(t_s):
            self._repeats += same
        if same[told].all():  # a whole row says nothing of one sensor
            return np.zeros_like(same)
        self._run = np.where(same, self._run + 1, np.where(told, 0, self._run))
        self._same_since_s = np.where(told & ~same, t_s, self._same_since_s)
        log_probability = self._run * np.log((self._repeats + 1) / (self._count + 1))
        is_long = t_s - self._same_since_s >= self._settings.stuck_s
        return np.asarray(same & is_long & (log_probability < np.log(self._settings.stuck_probability)))

    def _rest(self, length_m: NDArray[np.float64], sigma_m: NDArray[np.float64]) -> None:
        """Add the values of one more row at rest to mean and squares about it (Welford)."""
        told = np.isfinite(length_m)
        self._count = self._count + told
        delta_m = np.where(told, length_m - self._mean_m, 0.0)
        self._mean_m += delta_m / np.maximum(self._count, 1)
        self._squares += np.where(told, delta_m * (length_m - self._mean_m) / sigma_m**2, 0.0)
        degrees = np.maximum(self._count - 1, 1)
        chance = chi_squared_quantile(1 - CHANCE, degrees)
        self._scale = np.where(self._squares > chance, np.sqrt(self._squares / degrees), 1.0)
