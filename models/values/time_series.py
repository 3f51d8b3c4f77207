"""Values over time: the low-pass filter m += (y - m) w, interpolation, correlation, parts, and hidden regimes.

What follows a signal takes its next samples, one or many, and remembers where it stood: the numbers are the same,
however many samples it is given at a time.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = float | NDArray[np.float64]
"""One number for all, or one for each."""


def parts(count: int, size: int) -> Iterator[slice]:
    """Yield the slices of at most `size` values that follow each other, of a number of values."""
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


def median_step_s(t_s: NDArray[np.float64] | Sequence[float], of_one: float = np.inf) -> float:
    """Return the time from one of (samples,) times to the next, in the median; `of_one` where there is no next."""
    return float(np.median(np.diff(t_s))) if len(t_s) > 1 else of_one


def any_before(holds: NDArray[np.bool_], end: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (samples, ...) whether something holds at each sample or a later one, before the sample of number `end`.

    Args:
        holds: (samples, ...)
        end: (samples,) later than the sample itself, and at most the number of samples.
    """
    until = np.concatenate([np.zeros_like(holds[:1], dtype=np.int64), np.cumsum(holds, axis=0)])
    return np.asarray(until[end] > until[:-1])


def low_pass_weight(step_s: Floats, time_constant_s: Floats) -> NDArray[np.float64]:
    """Return w = 1 - exp(-dt / tau), the share of the distance to its input by which the filter moves in one step."""
    return np.asarray(1 - np.exp(-(step_s / time_constant_s)))


def low_passed(
    value: NDArray[np.float64], weight: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (samples, ...) the low-pass m of values from (...) a start: m += (y - m) w.

    Args:
        value: (samples, ...)
        weight: (samples, ...), see `low_pass_weight`; value and weight may have 1 where start has more.
        start: (...) m before the first sample.
    """
    passed = np.empty((len(value), *start.shape))
    m = start
    for k in range(len(value)):
        passed[k] = m = m + (value[k] - m) * weight[k]
    return passed


def start_or_first(start: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a (...) start, and where it is nan, the first of (samples, ...) values."""
    return np.where(np.isnan(start), value[0], start)


def value_before(values: NDArray[Any], start: NDArray[Any]) -> NDArray[Any]:
    """Return (samples, ...) the value before each of (samples, ...) values, the first of which is a (...) start."""
    return np.concatenate([start[None], values[:-1]])


def last_seen(value: NDArray[np.float64], seen: NDArray[np.bool_], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (samples, ...) values, or the last one `seen` where there is none; a (...) start before the first."""
    result = np.empty((len(value), *start.shape))
    last = start
    for k in range(len(value)):
        result[k] = last = np.where(seen[k], value[k], last)
    return result


class SmoothedRate:
    """The rate of a value after a first-order low-pass, (m' - m) / dt; the low-pass starts at the first value."""

    def __init__(self, count: int, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._smooth = np.full(count, np.nan)

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start the (count,) chosen ones anew from their next value."""
        self._smooth[chosen] = np.nan

    def run(self, value: NDArray[np.float64], step_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (samples, count) rates per second of more values.

        Args:
            value: (samples, count)
            step_s: (samples, count), or (samples, 1) for all, the time before each.
        """
        rate = np.empty_like(value)
        per_s = low_pass_weight(step_s, self._time_constant_s) / step_s
        smooth = start_or_first(self._smooth, value)
        for k in range(len(value)):
            rate[k] = (value[k] - smooth) * per_s[k]
            smooth = smooth + rate[k] * step_s[k]
        self._smooth = smooth
        return rate


class Regimes:
    """The probability of each of several regimes, of which one is left for any, by its prior, after `memory_s`."""

    def __init__(self, prior: NDArray[np.float64], memory_s: float) -> None:
        self._prior = prior
        self._memory_s = memory_s
        self.probability = prior

    def forget(self) -> None:
        """Take it as unknown again which regime there is."""
        self.probability = self._prior

    def predict(self, step_s: float) -> None:
        """Carry the probabilities over a time step."""
        stay = np.exp(-step_s / self._memory_s)
        self.probability = stay * self.probability + (1 - stay) * self._prior

    def update(self, log_evidence: NDArray[np.float64]) -> None:
        """Multiply the probabilities by the evidence."""
        likelihood = np.exp(log_evidence - log_evidence.max())
        self.probability = self.probability * likelihood / (self.probability @ likelihood)

    def smoothed(self, t_s: NDArray[np.float64], filtered: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (times, regimes) the probabilities given all evidence, from those given the past evidence."""
        smoothed = filtered.copy()
        for k in range(len(t_s) - 2, -1, -1):
            stay = np.exp(-(t_s[k + 1] - t_s[k]) / self._memory_s)
            predicted = stay * filtered[k] + (1 - stay) * self._prior
            ratio = smoothed[k + 1] / predicted
            smoothed[k] = filtered[k] * (stay * ratio + (1 - stay) * (self._prior @ ratio))
        return smoothed


def interpolated(
    t_s: NDArray[np.float64], known_s: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (times, ...) values at t_s, of those that are (known, ...) at known_s; beyond these, the nearest value."""
    columns = values.reshape(len(known_s), -1).T
    at_times = np.stack([np.interp(t_s, known_s, column) for column in columns], axis=1)
    return at_times.reshape(len(t_s), *values.shape[1:])


def mean_over_frames(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over the first axis of the values that are not nan; nan where there are none."""
    known = ~np.isnan(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


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
