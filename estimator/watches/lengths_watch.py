"""Whether recorded lengths are those of the rest shape at rest, and whether they are still read later.

What the front end tares agrees with the rest shape by construction, and it tells itself whether its readings could be
those of this structure. Lengths that are recorded as such are compared here: with the mean m_e over the time at rest of
tendon e and the rest shape's length l_e, at least half of the tendons have |m_e - l_e| > 5 sigma_e when the structure
is another one, columns are exchanged, or there was no rest.

A program between sensors and host may go on to send the last row when the sensors fall silent. Lengths that are read
have noise: if r of the n rows at rest are equal to the row before, the next one is so with the probability

    p = (r + 1) / (n + 1)

by Laplace's rule, in motion less often. k equal rows in succession have the probability p^k. Lengths without noise are
equal at rest too: then p is about 1, and nothing is told.
"""

import numpy as np

from ...models.pose.rest_clock import RestClock
from ...models.sensor.gate import GateSettings
from ...models.structure.shape import Shape
from ...models.values.readings import RestLengths

REST_APART_SIGMA = 5.0
"""Number of standard deviations beyond which a tendon's length at rest is not that of the rest shape."""


class RestWatch:
    """Compares the lengths at rest of one shape after another with those of the rest shape."""

    def __init__(self, rest: RestLengths) -> None:
        self._rest = rest
        self._start_s: float | None = None
        self._count = np.zeros(len(rest.length_m))
        self._misfit_m = np.zeros(len(rest.length_m))
        self.in_doubt = False
        """Whether at least half of the tendons do not fit."""

    def observe(self, shape: Shape) -> None:
        """Take on the lengths of one more frame while the structure rests."""
        if self._start_s is None:
            self._start_s = shape.t_s
        if shape.t_s - self._start_s >= self._rest.seconds:
            return
        length_m, sigma_m = shape.lengths.length_m, shape.lengths.sigma_m
        read = np.isfinite(length_m) & np.isfinite(sigma_m)
        self._count += read
        error_m = length_m[read] - self._rest.length_m[read]
        self._misfit_m[read] += (error_m - self._misfit_m[read]) / self._count[read]
        beyond = np.abs(self._misfit_m[read]) > REST_APART_SIGMA * np.hypot(sigma_m[read], self._rest.sigma_m[read])
        self.in_doubt = bool(2 * beyond.sum() >= read.sum() > 0)


class RepeatWatch:
    """Compares the lengths of each shape with those of the one before."""

    def __init__(self, rest_seconds: float, settings: GateSettings) -> None:
        self._rest_clock = RestClock(rest_seconds)
        self._settings = settings
        self._last_m = np.empty(0)
        self._equal_since_s = np.nan
        self._run = 0
        self._repeats = 0
        self._rows = 0
        self.in_doubt = False
        """Whether the row of the latest shape has been told for longer than noise allows."""

    def observe(self, shape: Shape) -> None:
        """Take on the lengths of one more frame; a frame without any says nothing."""
        length_m = shape.lengths.length_m
        if not np.isfinite(length_m).any():
            return
        self._rest_clock.count_frame(shape.t_s)
        is_equal = np.array_equal(length_m, self._last_m, equal_nan=True)
        if self._rest_clock.is_at_rest(shape.t_s):
            self._rows += 1
            self._repeats += is_equal
        self._run = self._run + 1 if is_equal else 0
        if not is_equal:
            self._equal_since_s = shape.t_s
        self._last_m = length_m
        log_probability = self._run * np.log((self._repeats + 1) / (self._rows + 1))
        lasts = shape.t_s - self._equal_since_s >= self._settings.stuck_s
        self.in_doubt = bool(lasts and log_probability < np.log(self._settings.stuck_probability))
