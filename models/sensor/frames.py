"""Resampling of the readings of unsynchronised boards to frames of all sensors at one rate.

A frame is the mean of the line through the readings, taken over one output period about the frame's time. So every
reading counts once, a lost row is bridged, and boards of 100 Hz are averaged to 50 Hz without aliasing. Three methods
were compared on the available trials: the newest reading, the line at the frame's time, and the mean of the line. The
noise of dR/R at rest was 0.0022, 0.0018 and 0.0013; the length error about each tendon's mean was 0.38, 0.36 and
0.35 mm (press_01), and 1.57, 1.50 and 1.47 mm (slack_02).
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from ..values.readings import STRETCHING, Flag, ResistanceFrame, ResistanceReading, TendonLengths
from ..values.tables import Positive
from .gate import GateSettings, ReadingGate

LONGEST_SILENCE_S = 60.0
"""Time without any reading after which no frames are made until the next one: nothing is known by then of the shape."""
MOST_SILENT_FRAMES = 3000
"""The same as a number of frames, a minute at 50 Hz, so that two rows far apart cannot make frames by the million."""


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """The output rate, and the longest gap between readings that is bridged."""

    rate_hz: Annotated[float, Interval(ge=0.1, le=1000)] = 50.0
    """Frames per second. The times of the frames are whole multiples of the period on the host clock. A sensor model is
    for the rates at which it was trained, the one that ships for 10 to 100 Hz."""
    max_gap_s: Positive = 0.1
    """Longest time between two readings that is bridged, and longest time to wait for a silent board. After it the
    board's sensors are missing."""

    @property
    def longest_silence_s(self) -> float:
        """Time without any reading after which no frames are made until the next one."""
        return min(LONGEST_SILENCE_S, MOST_SILENT_FRAMES / self.rate_hz)


STAMP_ERROR_S = 1e-6
"""Error of a difference of two stamps: readings at 10 Hz are 0.1 s apart, which no binary fraction is exactly."""


class _Source:
    """The recent readings of the sensors of one source (a board or a file), which are read together."""

    def __init__(self, reading: ResistanceReading, natural_ohm: NDArray[np.float64], gate: GateSettings) -> None:
        self.tendon = reading.tendon
        self.t_s: list[float] = []
        self._whole: list[bool] = []
        self.arrival_s = reading.arrival_s
        self._gate = ReadingGate(gate, len(reading.tendon))
        self._natural_ohm = natural_ohm[reading.tendon]
        self._values: list[NDArray[np.float64]] = []
        self._flags: list[NDArray[np.int64]] = []

    def add(self, reading: ResistanceReading) -> None:
        self.arrival_s = reading.arrival_s
        change = reading.resistance_ohm / self._natural_ohm - 1
        value, flags = self._gate.check(reading.t_s, change, reading.sigma_ohm / self._natural_ohm, reading.flags)
        self.t_s.append(reading.t_s)
        resistance_ohm = np.where(np.isnan(value), np.nan, reading.resistance_ohm)
        self._whole.append(bool(np.isfinite(resistance_ohm).all()))
        self._values.append(np.array([resistance_ohm, reading.sigma_ohm]))
        self._flags.append(flags)

    def mean(self, from_s: float, until_s: float, max_gap_s: float) -> ResistanceFrame:
        """Return the mean over an interval, of this source's channels alone, and delete the readings before it."""
        reach = slice(
            max(bisect_left(self.t_s, from_s - max_gap_s) - 1, 0), bisect_right(self.t_s, until_s + max_gap_s) + 1
        )
        t_s = self.t_s[reach]
        middle_s = 0.5 * (from_s + until_s)
        if not t_s:
            return _missing(middle_s, len(self.tendon))
        value, sigma = np.array(self._values[reach]).swapaxes(0, 1)
        if all(self._whole[reach]):  # the usual case: all channels have the same weights
            weight = _mean_weights(t_s, from_s, until_s, max_gap_s)[:, None]
        else:
            finite = np.isfinite(value)
            weight = _weights_of_channels(finite, t_s, from_s, until_s, max_gap_s)
            value, sigma = np.where(finite, value, 0), np.where(finite, sigma, 0)
        seen = weight.sum(axis=0) > 0.5
        mean = np.where(seen, (weight * value).sum(axis=0), np.nan)
        mean_sigma = np.sqrt(((weight * sigma) ** 2).sum(axis=0))
        margin_s = 0.5 * (until_s - from_s)
        first = max(bisect_right(self.t_s, from_s - margin_s), reach.start)
        last = min(bisect_right(self.t_s, until_s + margin_s), reach.stop)
        flags = np.where(seen, 0, int(Flag.MISSING))
        for about in self._flags[first:last]:
            flags = flags | about
        self._drop(until_s - 2 * max_gap_s)
        return ResistanceFrame(middle_s, mean, np.where(seen, mean_sigma, np.nan), flags)

    def _drop(self, before_s: float) -> None:
        """Delete the readings before a time, but for the last of them."""
        count = max(bisect_left(self.t_s, before_s) - 1, 0)
        for readings in (self.t_s, self._whole, self._values, self._flags):
            del readings[:count]


def _missing(t_s: float, count: int) -> ResistanceFrame:
    """Return a frame in which no sensor has a reading."""
    return ResistanceFrame(t_s, np.full(count, np.nan), np.full(count, np.nan), np.full(count, int(Flag.MISSING)))


def _weights_of_channels(
    finite: NDArray[np.bool_], t_s: list[float], from_s: float, until_s: float, max_gap_s: float
) -> NDArray[np.float64]:
    """Return (readings, channels) the weights of `_mean_weights` where only (readings, channels) `finite` counts."""
    channels_of: dict[bytes, list[int]] = {}
    for channel, pattern in enumerate(finite.T):
        channels_of.setdefault(pattern.tobytes(), []).append(channel)
    weight = np.zeros(finite.shape)
    for channels in channels_of.values():  # those that have a value in the same readings
        readings = np.flatnonzero(finite[:, channels[0]])
        seen_s = [t_s[k] for k in readings.tolist()]
        weight[np.ix_(readings, np.array(channels))] = _mean_weights(seen_s, from_s, until_s, max_gap_s)[:, None]
    return weight


def _mean_weights(t_s: list[float], from_s: float, until_s: float, max_gap_s: float) -> NDArray[np.float64]:
    """Return (readings,) the weight of each reading in the mean of the line through all readings over an interval.

    The line is constant before the first reading and after the last, for at most `max_gap_s`. All weights are zero when
    the middle of the interval is in a wider gap.
    """
    if not t_s:
        return np.zeros(0)
    middle_s = 0.5 * (from_s + until_s)
    after = bisect_left(t_s, middle_s)
    before_s = t_s[after - 1] if after > 0 else t_s[0]
    after_s = t_s[after] if after < len(t_s) else t_s[-1]
    gap_s = max(after_s - before_s, before_s - middle_s, middle_s - after_s)
    if gap_s > max_gap_s + STAMP_ERROR_S:
        return np.zeros(len(t_s))
    inside = t_s[bisect_right(t_s, from_s) : bisect_left(t_s, until_s)]
    points = sorted({from_s, *inside, until_s})
    weights = [0.0] * len(t_s)
    widths = [0.0, *(right - left for left, right in pairwise(points)), 0.0]
    for point, left, right in zip(points, widths, widths[1:], strict=False):
        share = left + right  # twice that of the trapezoidal rule
        k = bisect_left(t_s, point)
        if k == 0 or k == len(t_s):
            weights[min(k, len(t_s) - 1)] += share
        else:
            fraction = (point - t_s[k - 1]) / (t_s[k] - t_s[k - 1])
            weights[k - 1] += share * (1 - fraction)
            weights[k] += share * fraction
    weight = np.array(weights)
    return np.asarray(weight / weight.sum())


class FrameAssembler:
    """Makes frames from readings in order of arrival.

    A frame is complete as soon as every source has a reading after it or has been silent for `max_gap_s`.
    """

    def __init__(
        self, natural_ohm: NDArray[np.float64], sources: int, frames: FrameSettings, gate: GateSettings
    ) -> None:
        self._natural_ohm = natural_ohm
        self._settings = frames
        self._gate = gate
        self._sources: list[_Source | None] = [None] * sources
        self._next: int | None = None
        self._last_s = -np.inf
        self._first_arrival_s = np.nan

    def add(self, reading: ResistanceReading) -> Iterator[ResistanceFrame]:
        """Add one reading, and yield the frames that are complete with it."""
        if self._next is not None and reading.t_s - self._last_s > self._settings.longest_silence_s:
            yield from self.finish()
            self._next = round(reading.t_s * self._settings.rate_hz)
        self._last_s = max(reading.t_s, self._last_s)
        source = self._sources[reading.source]
        if source is None:
            source = self._sources[reading.source] = _Source(reading, self._natural_ohm, self._gate)
        source.add(reading)
        if self._next is None:
            self._next = round(reading.t_s * self._settings.rate_hz)
            self._first_arrival_s = reading.arrival_s
        while self._complete(reading.arrival_s):
            yield self._frame()

    def finish(self) -> Iterator[ResistanceFrame]:
        """Yield the frames up to the last reading."""
        while self._next is not None and self._next <= round(self._last_s * self._settings.rate_hz):
            yield self._frame()

    def _complete(self, now_s: float) -> bool:
        assert self._next is not None
        until_s = (self._next + 0.5) / self._settings.rate_hz
        passed = [source is not None and source.t_s[-1] >= until_s for source in self._sources]
        if not any(passed):
            return False
        silent_s = [now_s - (source.arrival_s if source else self._first_arrival_s) for source in self._sources]
        return all(done or silent > self._settings.max_gap_s for done, silent in zip(passed, silent_s, strict=True))

    def _frame(self) -> ResistanceFrame:
        assert self._next is not None
        rate_hz = self._settings.rate_hz
        frame = _missing(self._next / rate_hz, len(self._natural_ohm))
        for source in self._sources:
            if source is not None:
                from_s = (self._next - 0.5) / rate_hz
                until_s = (self._next + 0.5) / rate_hz
                mean = source.mean(from_s, until_s, self._settings.max_gap_s)
                frame.resistance_ohm[source.tendon] = mean.resistance_ohm
                frame.sigma_ohm[source.tendon] = mean.sigma_ohm
                frame.flags[source.tendon] = mean.flags
        self._next += 1
        return frame


class LengthPauses:
    """Makes frames without lengths where rows of lengths pause and other sensors go on, as a silent board's are.

    What other sensors read in a pause is used at its time. All at once, after a pause in which a robot tipped, they
    would be linearised at a shape that is turned by radians.
    """

    def __init__(self, tendons: int, frames: FrameSettings) -> None:
        self._tendons = tendons
        self._settings = frames
        self._step_s = 1 / frames.rate_hz
        self._row_s = np.nan
        self._frame_s = np.nan
        self._of_strips = True

    def add(self, row: TendonLengths) -> None:
        """Take note of a row of lengths."""
        self._row_s = self._frame_s = row.t_s
        self._of_strips = row.of_strips

    def until(self, t_s: float) -> Iterator[TendonLengths]:
        """Yield the frames of a pause before a time at which something is read; none in one that is bridged."""
        if not self._settings.max_gap_s < t_s - self._row_s <= self._settings.longest_silence_s:
            return
        while self._frame_s + 1.5 * self._step_s <= t_s:
            self._frame_s += self._step_s
            yield TendonLengths(
                t_s=self._frame_s,
                length_m=np.full(self._tendons, np.nan),
                sigma_m=np.full(self._tendons, np.inf),
                mode=np.full(self._tendons, STRETCHING),
                flags=np.full(self._tendons, int(Flag.MISSING)),
                of_strips=self._of_strips,
            )
