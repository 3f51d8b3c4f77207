"""What has happened in a live session so far, and which frames are too late to be estimated."""

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..io.trial_directory import Reading
from ..models.structure.shape import Shape
from ..models.values.readings import BoardReading, TendonLengths
from .feeds import Source

LATE_S = 0.1
"""Frames later than this are skipped, until the newest: five of them at 50 Hz, or the smoother's lag."""
VERY_LATE_S = 10.0
"""A smoother that cannot make up for the taring in this time never will."""
LATENCIES = 30_000
"""Frames that the latency is the median of: ten minutes at 50 Hz."""
ARRIVALS = 101
"""Rows of a board over which its rate is measured: two seconds at 50 Hz."""


@dataclass(slots=True)
class Activity:
    """What has happened so far: for the panel, and for run.toml."""

    boards: int
    """How many there are."""
    started_s: float = field(default_factory=time.perf_counter)
    """By `time.perf_counter`, as all times here."""
    rows: int = 0
    """Of all boards."""
    arrivals_s: list[deque[float]] = field(default_factory=list)
    """Of each board, its latest arrivals."""
    frames: int = 0
    skipped_frames: int = 0
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    """From the last byte that a frame needed to its shape."""
    shape: Shape | None = None
    """The newest."""

    def __post_init__(self) -> None:
        self.arrivals_s = [deque(maxlen=ARRIVALS) for _ in range(self.boards)]

    def count(self, reading: Reading, late_s: float) -> None:
        """Count a reading that came `late_s` ago."""
        self.rows += 1
        if isinstance(reading, BoardReading):
            self.arrivals_s[reading.board].append(time.perf_counter() - late_s)

    def rate_hz(self, board: int) -> float:
        """Return the rate of a board's latest rows; 0 of a board that has been silent for a second."""
        latest = self.arrivals_s[board]
        if len(latest) < 2 or self.age_s(board) > 1:
            return 0.0
        return (len(latest) - 1) / max(latest[-1] - latest[0], 1e-6)

    def age_s(self, board: int) -> float:
        """Return how long ago a board's newest row came."""
        latest = self.arrivals_s[board]
        return time.perf_counter() - latest[-1] if latest else np.inf

    def latency_ms(self) -> tuple[float, float]:
        """Return the latency's median and 99th percentile; nan before the first shape."""
        if not self.latency_s:
            return np.nan, np.nan
        median, p99 = np.quantile(np.array(self.latency_s), (0.5, 0.99))
        return 1e3 * float(median), 1e3 * float(p99)


class NewestFrames:
    """Passes frames on; once they are late, skips to the newest, and counts what it skipped.

    At first there is the time of the taring to make up for: until then only frames that are very late are skipped.
    """

    def __init__(self, source: Source, activity: Activity) -> None:
        self._source = source
        self._activity = activity
        self.caught_up = False

    def select(self, frames: Iterator[TendonLengths]) -> Iterator[TendonLengths]:
        """Yield the frames that are not skipped."""
        behind = False
        for frame in frames:
            waiting = self._source.waiting() > 0
            self.caught_up |= not waiting
            behind = waiting and (behind or self._source.late_s() > (LATE_S if self.caught_up else VERY_LATE_S))
            if behind:
                self._activity.skipped_frames += 1
            else:
                yield frame
