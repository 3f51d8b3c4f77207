"""The counts of a live session, and the choice of frames that are too late to be estimated."""

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
"""Delay above which frames are skipped up to the newest: five frames at 50 Hz, the same as the lag of the smoother."""
VERY_LATE_S = 10.0
"""The same delay at the start, when frames from the time of the taring still wait. If the delay is longer, the smoother
is too slow to catch up."""
LATENCIES = 30_000
"""Number of latest frames in the statistics of the latency: ten minutes at 50 Hz."""
ARRIVALS = 101
"""Number of latest rows of a board from which its rate is computed: two seconds at 50 Hz."""


@dataclass(slots=True)
class Activity:
    """The counts of a session so far, for the panel and for run.toml."""

    boards: int
    """Number of boards."""
    started_s: float = field(default_factory=time.perf_counter)
    """Time at which the session started, on the clock of `time.perf_counter` like all times here."""
    rows: int = 0
    """Number of readings, of all boards together."""
    arrivals_s: list[deque[float]] = field(default_factory=list)
    """Arrival times of the latest rows of each board."""
    frames: int = 0
    skipped_frames: int = 0
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    """Latency of the latest frames: time from the last byte that a frame needs to its shape."""
    shape: Shape | None = None
    """The newest shape; None before the first."""

    def __post_init__(self) -> None:
        self.arrivals_s = [deque(maxlen=ARRIVALS) for _ in range(self.boards)]

    def count(self, reading: Reading, late_s: float) -> None:
        """Count a reading that arrived `late_s` ago."""
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
        """Return how long ago the newest row of a board arrived."""
        latest = self.arrivals_s[board]
        return time.perf_counter() - latest[-1] if latest else np.inf

    def latency_ms(self) -> tuple[float, float]:
        """Return the latency's median and 99th percentile; nan before the first shape."""
        if not self.latency_s:
            return np.nan, np.nan
        median, p99 = np.quantile(np.array(self.latency_s), (0.5, 0.99))
        return 1e3 * float(median), 1e3 * float(p99)


class NewestFrames:
    """Passes frames on; when they are late, skips to the newest frame and counts the skipped ones.

    At the start, frames from the time of the taring still wait. Until these are estimated, only frames later than
    `VERY_LATE_S` are skipped.
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
