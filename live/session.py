"""A live session: readings in, shapes out as they come, into a result that grows with them.

rows -> lengths -> newest frames -> shapes -> result, view; the panel watches.
"""

import gc
import signal
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..io.figures.shape_figures import write_figures
from ..io.provenance import relative_path, versions
from ..io.replay import arrival_s
from ..io.result import result_directory, write_run, write_tables
from ..io.trial_directory import Reading
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.shape import Shape
from ..models.structure.structure import Structure
from ..models.values.readings import BoardReading, TendonLengths
from ..pipeline import Pipeline
from .feeds import Feed, Source

LATE_S = 0.1
"""Frames later than this are skipped, until the newest: five of them at 50 Hz, or the smoother's lag."""
VERY_LATE_S = 10.0
"""A smoother that can not make up for the taring in this time never will."""
CHUNK = 5
"""Frames that are written to the result at once, which takes 3 ms; 25 of them would hold the next frame up by 12 ms."""
FIGURE_FRAMES = 2000
"""Frames that the figures show at most; of a longer session they show every second, fourth, ... one."""
LATENCIES = 30_000
"""Frames that the latency is the median of: ten minutes at 50 Hz."""


@dataclass(slots=True)
class Activity:
    """What has happened so far: for the panel, and for run.toml."""

    boards: int
    started_s: float = field(default_factory=time.perf_counter)
    rows: int = 0
    arrivals_s: list[deque[float]] = field(default_factory=list)
    """Of each board, the latest arrivals by `time.perf_counter`."""
    frames: int = 0
    skipped_frames: int = 0
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    """From the last byte that a frame needed to its shape."""
    shape: Shape | None = None
    """The newest."""

    def __post_init__(self) -> None:
        self.arrivals_s = [deque(maxlen=101) for _ in range(self.boards)]

    def count(self, reading: Reading, late_s: float) -> None:
        """Count a reading that came so long ago."""
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
        """Return median and 99th percentile."""
        if not self.latency_s:
            return np.nan, np.nan
        median, p99 = np.quantile(np.array(self.latency_s), (0.5, 0.99))
        return 1e3 * float(median), 1e3 * float(p99)


class NewestFrames:
    """Passes frames on; once they are late, skips to the newest, and counts what it skipped.

    At first there is the time of the taring to make up for: until then only frames that are very late are skipped.
    """

    def __init__(self, source: Source, activity: Activity) -> None:
        self._source, self._activity = source, activity
        self.caught_up = False

    def of(self, frames: Iterator[TendonLengths]) -> Iterator[TendonLengths]:
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


class LiveResult:
    """A result directory that grows with the session, in bounded memory; whole when the block ends."""

    def __init__(self, path: Path, structure: Structure, settings: Settings) -> None:
        self._structure, self._settings = structure, settings
        self._directory_of, self._chunk = result_directory(path), list[Shape]()
        self._kept, self._every, self._frames = list[Shape](), 1, 0

    def __enter__(self) -> Self:
        self._directory = self._directory_of.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._directory_of.__exit__(kind, error, traceback)

    def add(self, shape: Shape) -> None:
        """Take one shape in."""
        self._chunk.append(shape)
        if len(self._chunk) == CHUNK:
            self._write_chunk()
        if self._frames % self._every == 0:
            self._kept.append(shape)
        self._frames += 1
        if len(self._kept) > FIGURE_FRAMES:
            del self._kept[1::2]
            self._every *= 2

    def finish(self, title: str, run: Mapping[str, Any]) -> None:
        """Write what is left, the figures, and run.toml.

        Raises:
            InputError: when there was no frame.
        """
        kept = Reconstruction.of(self._structure, self._kept)
        self._write_chunk()
        write_figures(kept, self._settings, title, self._directory)
        write_run(run, self._directory)

    def _write_chunk(self) -> None:
        if self._chunk:
            write_tables(Reconstruction.of(self._structure, self._chunk), self._settings.probability, self._directory)
            self._chunk.clear()


class Session:
    """Shapes from a source, as they come."""

    def __init__(self, feed: Feed, pipeline: Pipeline, seconds: float) -> None:
        self.pipeline, self.activity = pipeline, Activity(len(pipeline.trial.tendons_of_board))
        self._feed, self._seconds, self._ended = feed, seconds, False

    def shapes(self) -> Iterator[Shape]:
        """Yield shapes until the source ends or is stopped."""
        gc.freeze()  # to look through all that is there by now would hold up some frame by 75 ms
        activity = self.activity
        newest = NewestFrames(self._feed.source, activity)
        for shape in self.pipeline.shapes(newest.of(self.pipeline.lengths(self._counted_rows())), "live"):
            if newest.caught_up and not self._ended:  # frames that waited for the taring, or the end, tell nothing
                activity.latency_s.append(self._feed.source.late_s())
            activity.frames += 1
            activity.shape = shape
            yield shape

    def _counted_rows(self) -> Iterator[Reading]:
        for reading in self._feed.rows:
            self.activity.count(reading, self._feed.source.late_s())
            yield reading
            if arrival_s(reading) > self._seconds:
                self._feed.source.stop()
        self._ended = True

    def as_table(self, path: Path) -> dict[str, Any]:
        """Return run.toml.

        Args:
            path: of the result directory, from which the trial is found again.
        """
        p, state = self.activity, self._feed.state()
        median_ms, p99_ms = p.latency_ms()
        boards = self.pipeline.boards
        return {
            "trial": self._feed.name,
            **({"trial_path": relative_path(path, self._feed.trial)} if self._feed.trial else {}),
            "source": self._feed.origin,
            "method": "live",
            "rest_shape": self.pipeline.rest.source,
            "frames": p.frames,
            "skipped_frames": p.skipped_frames,
            "skipped_rows": state.skipped_rows,
            "recorded_rows": state.recorded_rows,
            "versions": versions(),
            "boards": [asdict(counts) for counts in boards.counts] if boards else [],
            "ports": {port.port: asdict(port.counts) for port in state.ports},
            "taring": self._feed.taring,
            "latency": {"median_ms": round(median_ms, 3), "p99_ms": round(p99_ms, 3)} if p.latency_s else {},
            "settings": asdict(self.pipeline.settings),
        }


@contextmanager
def stopped_by_signals(source: Source) -> Iterator[None]:
    """Let Ctrl-C or a termination stop the source, so that the session ends whole; the second one ends it at once."""
    numbers = signal.SIGINT, signal.SIGTERM
    earlier = {number: signal.getsignal(number) for number in numbers}

    def stop(*_: object) -> None:
        for number, handler in earlier.items():
            signal.signal(number, handler)
        source.stop()

    for number in numbers:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)
