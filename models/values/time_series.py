"""Values over time: the first-order low-pass filter m += (y - m) w, interpolation, correlation, and parts."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = float | NDArray[np.float64]
"""One number for all, or one for each."""


def parts(count: int, size: int) -> Iterator[slice]:
    """Yield the slices of at most `size` values that follow each other, of a number of values."""
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


def low_pass_weight(step_s: Floats, time_constant_s: Floats) -> NDArray[np.float64]:
    """Return w = 1 - exp(-dt / tau), the share of the distance to its input by which the filter moves in one step."""
    return np.asarray(1 - np.exp(-(step_s / time_constant_s)))


class SmoothedRate:
    """The rate of a value after a first-order low-pass, (m' - m) / dt; the low-pass starts at the first value."""

    def __init__(self, count: int, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._smooth = np.full(count, np.nan)

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start the (count,) chosen ones anew from their next value."""
        self._smooth[chosen] = np.nan

    def step(self, value: NDArray[np.float64], step_s: Floats) -> NDArray[np.float64]:
        """Return the (count,) rates per second after one more value."""
        smooth = np.where(np.isnan(self._smooth), value, self._smooth)
        rate = (value - smooth) * low_pass_weight(step_s, self._time_constant_s) / step_s
        self._smooth = smooth + rate * step_s
        return np.asarray(rate)


def interpolated(
    t_s: NDArray[np.float64], known_s: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (times, ...) values at t_s, of those that are (known, ...) at known_s; beyond these, the nearest value."""
    columns = values.reshape(len(known_s), -1).T
    at_times = np.stack([np.interp(t_s, known_s, column) for column in columns], axis=1)
    return at_times.reshape(len(t_s), *values.shape[1:])


def correlation_samples(residual: NDArray[np.float64]) -> float:
    """Return the correlation time of a series in samples: 1 + 2 sum of the autocorrelation up to its first zero."""
    autocorrelation = autocorrelation_of(residual)
    negative = np.flatnonzero(autocorrelation <= 0)
    end = int(negative[0]) if len(negative) else len(autocorrelation)
    return float(1 + 2 * autocorrelation[1:end].sum())


def autocorrelation_of(residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (lags,) the autocorrelation at lags of 0, 1, ... samples.

    It is taken about zero, not about the mean, because a constant error is correlated, too. Of a series of zeros it is
    that of noise: 1 at lag 0, and 0 elsewhere.
    """
    largest = np.abs(residual).max()
    if largest == 0:
        return np.asarray(np.arange(len(residual)) == 0, dtype=np.float64)
    padded = np.fft.rfft(residual / largest, 2 * len(residual))
    power = np.fft.irfft(np.abs(padded) ** 2)[: len(residual)]
    return np.asarray(power / power[0])
