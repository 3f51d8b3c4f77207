"""Resampling of the readings of unsynchronised boards to frames of all sensors at one rate.

A frame is the mean of the line through the readings, taken over one output period about the frame's time. So every
reading counts once, a lost row is bridged, and boards of 100 Hz are averaged to 50 Hz without aliasing. The noise of
dR/R at rest is 0.0013, that of the newest reading 0.0022, and that of the line at the frame's time 0.0018.

Frames between the rows of a slow board would add nothing but noise that lasts, which looks like motion: there are less
than twice as many of them as rows of the slowest board.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from ..values.readings import STRETCHING, Flag, ResistanceFrame, ResistanceReading, TendonLengths
from ..values.stamps import ROUNDING_S
from ..values.tables import Positive
from ..values.time_series import median_step_s
from .gate import GateSettings, ReadingGate

LONGEST_SILENCE_S = 60.0
"""Time without any reading after which no frames are made until the next one: nothing is known by then of the shape."""
MOST_SILENT_FRAMES = 3000
"""The same as a number of frames, a minute at 50 Hz, so that two rows far apart cannot make frames by the million."""


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """The output rate, and the longest gap between readings that is bridged."""

    rate_hz: Annotated[float, Interval(ge=0.1, le=1000)] = 50.0
    """Frames per second, or the half, the third and so on of them where boards are slower. The times of the frames are
    whole multiples of the period on the host clock. A sensor model is for the rates at which it was trained, the one
    that ships for 10 to 100 Hz."""
    max_gap_s: Positive = 0.1
    """Longest time between two readings that is bridged, and longest time to wait for a silent board, or one and a half
    rows of a slow one. After it the board's sensors are missing."""

    @property
    def longest_silence_s(self) -> float:
        """Time without any reading after which no frames are made until the next one."""
        return min(LONGEST_SILENCE_S, MOST_SILENT_FRAMES / self.rate_hz)


PERIOD_ROWS = 5
"""Number of rows of each source from which the time between its rows is known."""
BEGUN_AFTER_S = 1.0
"""Time after the first reading in which sources may be silent or slower before there are frames without them."""
ROUNDED_ROWS = 0.1
"""Part of a frame by which rows may be closer than the frames: clocks differ, and times vary."""
LATE_ROWS = 1.5
"""Times between two rows of a slow source that are bridged."""
LONGEST_ROW_S = 0.2
"""Longest such time: what a robot does in between is not known."""


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

    @property
    def period_s(self) -> float:
        """The time between the last readings, their median; 0 before the second."""
        return median_step_s(self.t_s, of_one=0.0)

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
    if gap_s > max_gap_s + ROUNDING_S:
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

    A frame is complete as soon as every source has a reading after it or has been silent for `max_gap_s`. The first one
    waits until the times between rows are known.
    """

    def __init__(
        self,
        natural_ohm: NDArray[np.float64],
        sources: int,
        frames: FrameSettings,
        gate: GateSettings,
        longest_step_s: float = np.inf,
    ) -> None:
        """Begin before the first reading.

        Args:
            natural_ohm: (sensors,) natural resistance.
            sources: number of boards, or 1 for a file.
            frames: rate, and what is bridged.
            gate: which readings are left out.
            longest_step_s: longest time between frames of slow boards; 0 for frames as many as are told.
        """
        self._natural_ohm = natural_ohm
        self._settings = frames
        self._gate = gate
        self._longest_step_s = longest_step_s
        self._sources: list[_Source | None] = [None] * sources
        self.rate_hz = frames.rate_hz
        """Frames per second, see `FrameSettings.rate_hz`."""
        self._max_gap_s = frames.max_gap_s
        self._period_s: list[float] = []
        self._next: int | None = None
        self._first_s = np.nan
        self._last_s = -np.inf
        self._first_arrival_s = np.nan

    def add(self, reading: ResistanceReading) -> Iterator[ResistanceFrame]:
        """Add one reading, and yield the frames that are complete with it."""
        if reading.t_s - self._last_s > self._settings.longest_silence_s:
            yield from self.finish()
            self._next, self._first_s = None, np.nan
            self._sources = [None] * len(self._sources)
            self._max_gap_s = self._settings.max_gap_s
        self._last_s = max(reading.t_s, self._last_s)
        source = self._sources[reading.source]
        if source is None:
            source = self._sources[reading.source] = _Source(reading, self._natural_ohm, self._gate)
        source.add(reading)
        if np.isnan(self._first_s):
            self._first_s, self._first_arrival_s = reading.t_s, reading.arrival_s
        if self._next is None and self._knows_periods(reading.arrival_s):
            self._begin()
        while self._next is not None and self._complete(self._next, reading.arrival_s):
            yield self._frame(self._next)

    def finish(self) -> Iterator[ResistanceFrame]:
        """Yield the frames up to the last reading."""
        if self._next is None and not np.isnan(self._first_s):
            self._begin()
        while self._next is not None and self._next <= round(self._last_s * self.rate_hz):
            yield self._frame(self._next)

    def slow_sources(self) -> dict[int, str]:
        """Return of each source that is slower than the frames, by its number, what that means."""
        texts = {}
        for number, period_s in enumerate(self._period_s):
            if period_s > self._max_gap_s:
                texts[number] = f"a row each {period_s:.3g} s: frames between them have no reading: send them faster"
            elif self._frames_in(period_s) > 1 and self.rate_hz < self._settings.rate_hz:
                rates = f"{self.rate_hz:.3g} frames a second, and not {self._settings.rate_hz:g}"
                texts[number] = f"a row each {period_s:.3g} s: {rates}"
        return texts

    def _frames_in(self, period_s: float) -> int:
        """Return how many whole frames of the rate that was told there are between two rows."""
        return int(period_s * self._settings.rate_hz + ROUNDED_ROWS)

    def _knows_periods(self, now_s: float) -> bool:
        """Return whether every source has rows enough, or has had time for them."""
        rows = min(len(source.t_s) if source else 0 for source in self._sources)
        return rows >= PERIOD_ROWS or now_s - self._first_arrival_s > BEGUN_AFTER_S

    def _begin(self) -> None:
        """Choose the rate by the slowest source, and the first frame."""
        self._period_s = [source.period_s if source else 0.0 for source in self._sources]
        period_s = max(self._period_s)
        self.rate_hz = self._settings.rate_hz / max(self._frames_in(min(period_s, self._longest_step_s)), 1)
        if period_s <= LONGEST_ROW_S:
            self._max_gap_s = max(self._max_gap_s, LATE_ROWS * period_s)
        self._next = round(self._first_s * self.rate_hz)

    def _complete(self, number: int, now_s: float) -> bool:
        until_s = (number + 0.5) / self.rate_hz
        passed = [source is not None and source.t_s[-1] >= until_s for source in self._sources]
        if not any(passed):
            return False
        silent_s = [now_s - (source.arrival_s if source else self._first_arrival_s) for source in self._sources]
        return all(done or silent > self._max_gap_s for done, silent in zip(passed, silent_s, strict=True))

    def _frame(self, number: int) -> ResistanceFrame:
        frame = _missing(number / self.rate_hz, len(self._natural_ohm))
        for source in self._sources:
            if source is not None:
                from_s = (number - 0.5) / self.rate_hz
                until_s = (number + 0.5) / self.rate_hz
                mean = source.mean(from_s, until_s, self._max_gap_s)
                frame.resistance_ohm[source.tendon] = mean.resistance_ohm
                frame.sigma_ohm[source.tendon] = mean.sigma_ohm
                frame.flags[source.tendon] = mean.flags
        self._next = number + 1
        return frame


class LengthPauses:
    """Makes frames between rows of lengths that are far apart, while other sensors go on.

    What other sensors read in between is used at its time. All at once, after a pause in which a robot tipped, it would
    be linearised at a shape that is turned by radians. The frames of a pause have no lengths, as those of a board that
    is silent. In no more than `LATE_ROWS` times the gap that is bridged, lengths change in proportion to the time: rows
    0.2 s apart, bridged, were wrong by more than the frames without them.
    """

    def __init__(self, tendons: int, frames: FrameSettings, bridges: bool) -> None:
        """Begin before the first row.

        Args:
            tendons: their number.
            frames: rate, and what is bridged.
            bridges: whether there are frames between rows that are no pause, too.
        """
        self._tendons = tendons
        self._settings = frames
        self._bridges = bridges
        self._longest_s = frames.max_gap_s * (LATE_ROWS if bridges else 1.0) + ROUNDING_S
        self._step_s = 1 / frames.rate_hz
        self._row: TendonLengths | None = None
        self._frame_s = np.nan

    def until(self, t_s: float) -> Iterator[TendonLengths]:
        """Yield the frames of a pause before a time at which something is read; none in one that is bridged."""
        if self._row is None or not self._longest_s < t_s - self._row.t_s <= self._settings.longest_silence_s:
            return
        while self._frame_s + 1.5 * self._step_s <= t_s:
            self._frame_s += self._step_s
            yield TendonLengths(
                t_s=self._frame_s,
                length_m=np.full(self._tendons, np.nan),
                sigma_m=np.full(self._tendons, np.inf),
                mode=np.full(self._tendons, STRETCHING),
                flags=np.full(self._tendons, int(Flag.MISSING)),
                of_strips=self._row.of_strips,
            )

    def up_to(self, row: TendonLengths) -> Iterator[TendonLengths]:
        """Yield the frames since the row before, if they are bridged, and a row of lengths itself."""
        before, self._row = self._row, row
        if self._bridges and before is not None and row.t_s - before.t_s <= self._longest_s:
            yield from _between(before, row, int((row.t_s - before.t_s) / self._step_s + ROUNDED_ROWS))
        self._frame_s = row.t_s
        yield row


def _between(before: TendonLengths, after: TendonLengths, parts: int) -> Iterator[TendonLengths]:
    """Yield the lengths at the times that part the time between two rows, on the line through both."""
    for k in range(1, parts):
        share = k / parts
        nearer = before if share < 0.5 else after
        length_m = (1 - share) * before.length_m + share * after.length_m
        is_read = np.isfinite(length_m)
        yield replace(
            nearer,
            t_s=(1 - share) * before.t_s + share * after.t_s,
            length_m=length_m,
            sigma_m=np.where(is_read, np.maximum(before.sigma_m, after.sigma_m), np.inf),
            flags=np.where(is_read, nearer.flags, nearer.flags | int(Flag.MISSING)),
        )
