"""The first-order low-pass filter, m += (y - m) w, which serves for running means, smoothed rates and lags."""

import numpy as np
from numpy.typing import NDArray

Floats = float | NDArray[np.float64]
"""One number for all, or one for each."""


def low_pass_weight(step_s: Floats, time_constant_s: Floats) -> NDArray[np.float64]:
    """Return w = 1 - exp(-dt / tau), the share of the distance to its input by which the filter moves in one step."""
    return np.asarray(1 - np.exp(-np.asarray(step_s) / np.asarray(time_constant_s)))


class SmoothedRate:
    """The rate of a value after a first-order low-pass, (m' - m) / dt; the low-pass starts at the first value."""

    def __init__(self, count: int, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._smooth = np.full(count, np.nan)

    def step(self, value: NDArray[np.float64], step_s: Floats) -> NDArray[np.float64]:
        """Return the (count,) rates per second after one more value."""
        smooth = np.where(np.isnan(self._smooth), value, self._smooth)
        rate = (value - smooth) * low_pass_weight(step_s, self._time_constant_s) / step_s
        self._smooth = smooth + rate * step_s
        return np.asarray(rate)
