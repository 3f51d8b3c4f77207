"""The counts of a live session, and the choice of frames that are too late to be estimated."""

import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from ..models.structure.shape import Shape
from ..models.values.aids import AidReading, ImuReading
from ..models.values.readings import BoardReading, Reading, TendonLengths
from .feeds import Source
from .rig import SILENT_S

LATE_S = 0.1
"""Delay above which frames are skipped up to the newest: five frames at 50 Hz. A machine that keeps up is never so
late: of the 1498 shapes of press_01, replayed on two cores that had other work too, the latest came after 27 ms."""
SHOWN_S = 1.0
"""Longest time without a shape: where even skipping does not help, a late shape is better than none."""
LATENCIES = 30_000
"""Number of latest frames in the statistics of the latency: ten minutes at 50 Hz."""
ARRIVALS = 101
"""Number of latest readings of a board or sensor from which its rate is computed: two seconds at 50 Hz."""


class Arrivals:
    """When the readings of one board or one inertial sensor arrived, on the clock of `time.perf_counter`."""

    def __init__(self) -> None:
        self.count = 0
        """Number of readings."""
        self._counted_s = -np.inf
        """When the newest reading was counted, which is late when much else waits."""
        self._latest_s: deque[float] = deque(maxlen=ARRIVALS)

    def add(self, arrival_s: float) -> None:
        """Add a reading."""
        self.count += 1
        self._counted_s = time.perf_counter()
        self._latest_s.append(arrival_s)

    def rate_hz(self) -> float:
        """Return the rate at which the latest readings arrived; 0 after a second of silence."""
        if len(self._latest_s) < 2 or self.is_silent():
            return 0.0
        return (len(self._latest_s) - 1) / max(self._latest_s[-1] - self._latest_s[0], 1e-6)

    def is_silent(self) -> bool:
        """Return whether nothing has come for `SILENT_S`; readings that only wait to be estimated have come."""
        return time.perf_counter() - self._counted_s > SILENT_S

    def age_s(self) -> float:
        """Return how long ago the newest reading arrived; inf before the first."""
        return time.perf_counter() - self._latest_s[-1] if self._latest_s else np.inf


@dataclass(slots=True)
class Activity:
    """The counts of a session so far, for the panel and for run.toml."""

    boards: list[Arrivals]
    """Of each board's rows."""
    imus: list[Arrivals]
    """Of each inertial sensor's samples."""
    started_s: float = field(default_factory=time.perf_counter)
    """Time at which the session started, on the clock of `time.perf_counter` like all times here."""
    frames: int = 0
    skipped_frames: int = 0
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    """Latency of the latest frames: time from the last byte that a frame needs to its shape."""
    shape: Shape | None = None
    """The newest shape; None before the first."""
    states: Counter[str] = field(default_factory=Counter)
    """Number of shapes of each status, with the reason of a doubt."""

    @classmethod
    def of(cls, boards: int, imus: int) -> Self:
        """Return the counts of a session that begins.

        Args:
            boards: number of boards.
            imus: number of inertial sensors.
        """
        return cls([Arrivals() for _ in range(boards)], [Arrivals() for _ in range(imus)])

    def count(self, reading: Reading, late_s: float) -> None:
        """Count a reading that arrived `late_s` ago."""
        if isinstance(reading, BoardReading):
            self.boards[reading.board].add(time.perf_counter() - late_s)
        elif isinstance(reading, ImuReading):
            self.imus[reading.imu].add(time.perf_counter() - late_s)

    def show(self, shape: Shape) -> None:
        """Take on the newest shape."""
        self.frames += 1
        self.shape = shape
        self.states[f"{shape.status}" + (f" ({shape.doubt})" if shape.doubt else "")] += 1

    def states_so_far(self) -> str:
        """Return the share of each status in the shapes so far, the most frequent first."""
        return ", ".join(f"{state} {count / self.frames:.1%}" for state, count in self.states.most_common())

    def latency_ms(self) -> tuple[float, float]:
        """Return the latency's median and 99th percentile; nan before the first shape."""
        if not self.latency_s:
            return np.nan, np.nan
        median, p99 = np.quantile(np.array(self.latency_s), (0.5, 0.99))
        return 1e3 * float(median), 1e3 * float(p99)


class NewestFrames:
    """Passes frames on; when they are late, skips to the newest frame and counts the skipped ones.

    The readings of other sensors in skipped frames, such as rates of turn, are those of the next frame.

    Frames from the time of the taring, which had arrived before the first was estimated, are never skipped, nor is the
    last frame of a source that has ended, which is the newest.
    """

    def __init__(self, source: Source, activity: Activity) -> None:
        self._source = source
        self._activity = activity
        self._passed_s = time.perf_counter()
        self.started = False
        """Whether the frames that waited for the taring have been estimated."""

    def select(self, frames: Iterator[TendonLengths]) -> Iterator[TendonLengths]:
        """Yield the frames that are not skipped."""
        behind = False
        aids: tuple[AidReading, ...] = ()
        for frame in frames:
            waiting = self._source.waiting() > 0
            self.started |= frame.t_s > self._source.tared_until_s
            behind = waiting and self.started and (behind or self._source.late_s() > LATE_S)
            if time.perf_counter() - self._passed_s > SHOWN_S:
                behind = False
            if aids:
                frame = replace(frame, aids=(*aids, *frame.aids))
            aids = frame.aids if behind else ()
            if behind:
                self._activity.skipped_frames += 1
            else:
                yield frame
                self._passed_s = time.perf_counter()
        if behind:
            self._activity.skipped_frames -= 1
            yield frame
