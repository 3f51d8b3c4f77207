"""Whether recorded lengths are those of the rest shape at rest, and whether they are still read later.

What the front end tares agrees with the rest shape by construction, and it tells itself whether its readings could be
those of this structure. Lengths that are recorded as such are compared here: with the mean m_e over the time at rest of
tendon e and the rest shape's length l_e, at least half of the tendons have |m_e - l_e| > 5 sigma_e when the structure
is another one, most columns are in another order, or there was no rest. When lengths have offsets, which are not tared,
the sum of (m_e - l_e)^2 / sigma_e^2 without the two largest, whose sensors may be faulty, is larger than chance. When
two columns a and b are exchanged, that sum is smaller with m_a - l_b and m_b - l_a in place of m_a - l_a and m_b - l_b,
by more than chance allows for the best of all pairs.

Tendons between anchors have a known length all the time: when at least half of them have another one, and two or more,
the positions of the anchors are told wrongly; of a single one it may be the sensor.

A program between sensors and host may go on to send the last row when the sensors fall silent. Lengths that are read
have noise: if r of the n rows at rest are equal to the row before, the next one is so with the probability

    p = (r + 1) / (n + 1)

by Laplace's rule, in motion less often. k equal rows in succession have the probability p^k. Lengths without noise are
equal at rest too: then p is about 1, and nothing is told.
"""

import numpy as np
from numpy.typing import NDArray

from ...models.sensor.gate import GateSettings
from ...models.structure.shape import Shape
from ...models.values.chi_squared import IMPROBABLE, are_improbable, chi_squared_quantile
from ...models.values.readings import RestLengths, TendonLengths
from ...models.values.stamps import RestClock

REST_APART_SIGMA = 5.0
"""Number of standard deviations beyond which a tendon's length at rest is not that of the rest shape."""


class MeanMisfit:
    """How far lengths are from known ones, in the mean of the frames so far."""

    def __init__(self, known: RestLengths) -> None:
        self._known = known
        self._count = np.zeros(len(known.length_m))
        self._sigma_m = np.zeros(len(known.length_m))
        self.misfit_m = np.zeros(len(known.length_m))
        """(tendons,)"""

    def add(self, lengths: TendonLengths) -> None:
        """Add one more frame."""
        read = np.isfinite(lengths.length_m) & np.isfinite(lengths.sigma_m)
        self._count += read
        error_m = lengths.length_m[read] - self._known.length_m[read]
        self.misfit_m[read] += (error_m - self.misfit_m[read]) / self._count[read]
        self._sigma_m[read] = lengths.sigma_m[read]

    @property
    def was_read(self) -> NDArray[np.bool_]:
        """(tendons,) which lengths were read at all."""
        return self._count > 0

    @property
    def sigma_m(self) -> NDArray[np.float64]:
        """(tendons,) standard deviation of the misfit: errors of lengths last."""
        return np.hypot(self._sigma_m, self._known.sigma_m)

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """(tendons,) which lengths are others."""
        return self.was_read & (np.abs(self.misfit_m) > REST_APART_SIGMA * self.sigma_m)


class AnchorWatch:
    """Compares the lengths between anchors with the distances of the anchors."""

    def __init__(self, known: RestLengths, joins_anchors: NDArray[np.bool_]) -> None:
        """Begin before the first frame.

        Args:
            known: the lengths of all tendons.
            joins_anchors: (tendons,) which of them are between anchors.
        """
        self._mean = MeanMisfit(known)
        self._joins_anchors = joins_anchors

    def observe(self, lengths: TendonLengths) -> None:
        """Take on the lengths of one more frame."""
        self._mean.add(lengths)

    @property
    def in_doubt(self) -> bool:
        """Whether at least half of these lengths are others, and two or more."""
        others = int((self._mean.beyond & self._joins_anchors).sum())
        return others >= 2 and 2 * others >= int((self._mean.was_read & self._joins_anchors).sum())


class RestWatch:
    """Compares the lengths of one frame after another at rest with those of the rest shape."""

    def __init__(self, rest: RestLengths) -> None:
        self._rest = rest
        self._rest_clock = RestClock(rest.seconds)
        self._mean = MeanMisfit(rest)
        self.in_doubt = False
        """Whether at least half of the tendons do not fit, all together do not, or two fit that are exchanged."""

    @property
    def differs(self) -> NDArray[np.bool_]:
        """(tendons,) which lengths were not those of the rest shape."""
        return self._mean.beyond

    def observe(self, lengths: TendonLengths) -> None:
        """Take on the lengths of one more frame while the structure rests."""
        self._rest_clock.count_frame(lengths.t_s)
        if not self._rest_clock.is_at_rest(lengths.t_s):
            return
        mean = self._mean
        mean.add(lengths)
        read, beyond = mean.was_read, mean.beyond
        self.in_doubt = (
            bool(2 * beyond.sum() >= read.sum() > 0)
            or are_improbable(mean.misfit_m[read] / mean.sigma_m[read], faulty=2)
            or self._are_exchanged(read)
        )

    def _are_exchanged(self, read: NDArray[np.bool_]) -> bool:
        """Return whether two of the tendons that were read have each other's lengths, more probably than by chance."""
        rest_m, sigma_m = self._rest.length_m[read], self._mean.sigma_m[read]
        mean_m = rest_m + self._mean.misfit_m[read]
        square = ((mean_m[:, None] - rest_m) / sigma_m[:, None]) ** 2  # of one tendon's mean, with another's length
        own = np.diag(square)
        exchanged = square + square.T
        pairs = max(len(own) * (len(own) - 1) / 2, 1)
        more_probable = 0.5 * (own[:, None] + own - exchanged) > np.log(pairs / IMPROBABLE)
        return bool((more_probable & (exchanged < chi_squared_quantile(1 - IMPROBABLE, 2))).any())


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
