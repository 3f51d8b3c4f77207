"""A live session: shapes are estimated as readings arrive, and appended to a result.

rows -> lengths -> newest frames -> shapes -> result and view; the panel shows the state.
"""

import gc
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, astuple, fields, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..io.provenance import relative_path, versions
from ..io.result import floor_table, result_directory, write_latencies, write_run, write_tables
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.shape import Shape
from ..models.structure.structure import Structure
from ..models.values.errors import InputError
from ..models.values.link import LinkState
from ..models.values.readings import Reading
from ..pipeline import Pipeline
from .activity import Activity, NewestFrames
from .feeds import Feed, Source
from .latency import Latency, Stopwatch

STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")
"""Names of the signals that end a session; Windows has no SIGHUP."""
CHUNK = 5
"""Number of frames that are written to the result together, in 3 ms; 25 would delay the next frame by 12 ms."""
FIGURE_FRAMES = 2000
"""Largest number of frames in the figures; of a longer session they show every second, fourth, ... frame."""


class LiveResult:
    """A result directory to which shapes are appended, in bounded memory; complete when the block ends.

    One that a full disk cannot take is removed at once, so that the recording has room, and takes no more shapes.

    Args:
        path: of the directory.
        structure: whose shapes are written.
        settings: of the run.
        say: function that is told when the disk is full.
    """

    def __init__(self, path: Path, structure: Structure, settings: Settings, say: Callable[[str], None]) -> None:
        self._say = say
        self._given_up: InputError | None = None
        self._structure = structure
        self._settings = settings
        self._opening = result_directory(path)
        self._chunk: list[Shape] = []
        self._latencies: list[Latency] = []
        self._drawn: list[Shape] = []
        self._draw_every = 1
        self._frames = 0

    def __enter__(self) -> Self:
        self._directory = self._opening.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._opening.__exit__(kind, error, traceback)

    def add(self, shape: Shape) -> None:
        """Add one shape to the tables, and to the figures if it is among those that they show."""
        if self._given_up is not None:
            return
        self._chunk.append(shape)
        if len(self._chunk) == CHUNK:
            try:
                self._write_chunk()
            except OSError as error:
                self._give_up(error)
                return
        if self._frames % self._draw_every == 0:
            self._drawn.append(shape)
        else:
            self._drawn[-1] = _with_slips_of(self._drawn[-1], shape)
        self._frames += 1
        if len(self._drawn) > FIGURE_FRAMES:
            for k in range(1, len(self._drawn), 2):
                self._drawn[k - 1] = _with_slips_of(self._drawn[k - 1], self._drawn[k])
            del self._drawn[1::2]
            self._draw_every *= 2

    def _give_up(self, error: OSError) -> None:
        """Remove what is written.

        Raises:
            OSError: when it is another error than that of a full disk.
        """
        try:
            self._opening.__exit__(type(error), error, error.__traceback__)
        except InputError as told:
            self._given_up = told
            self._say(f"{told}; the session goes on")
        else:
            raise error

    def add_latency(self, latency: Latency) -> None:
        """Add the latency of one shape to its table; it is written with the shapes."""
        if self._given_up is None:
            self._latencies.append(latency)

    def finish(self, title: str, run: Mapping[str, Any]) -> None:
        """Write the remaining shapes, the figures, and run.toml.

        Raises:
            InputError: when there was no frame, or the disk was full.
        """
        if self._given_up is not None:
            raise self._given_up
        from ..io.figures.shape_figures import write_figures  # matplotlib, which `record` does without

        drawn = Reconstruction.of(self._structure, self._drawn)
        self._write_chunk()
        write_figures(drawn, self._settings, title, self._directory)
        write_run(run, self._structure, self._directory)

    def _write_chunk(self) -> None:
        if self._chunk:
            write_tables(Reconstruction.of(self._structure, self._chunk), self._settings.probability, self._directory)
            self._chunk.clear()
        if self._latencies:
            columns = [field.name for field in fields(Latency)]
            write_latencies(columns, np.array([astuple(latency) for latency in self._latencies]), self._directory)
            self._latencies.clear()


def _with_slips_of(drawn: Shape, dropped: Shape) -> Shape:
    """Return a shape that figures show, with the slips of one after it that they do not, at their own times."""
    return replace(drawn, slips=(*drawn.slips, *dropped.slips)) if dropped.slips else drawn


class Session:
    """Estimates shapes as readings arrive from a source."""

    def __init__(self, feed: Feed, pipeline: Pipeline) -> None:
        self.pipeline = pipeline
        self.activity = Activity.of(len(pipeline.trial.tendons_of_board), len(pipeline.trial.imus))
        self.latency: Latency | None = None
        """Latency of the newest shape; None where it has no meaning: while it waited for the taring, or for the end."""
        self._feed = feed
        self._ended = False

    def shapes(self) -> Iterator[Shape]:
        """Yield shapes until the source ends or is stopped.

        Raises:
            TensegraphError: see `Pipeline.shapes`.
        """
        gc.freeze()  # exclude existing objects from garbage collection, which would delay a frame by 75 ms
        activity = self.activity
        newest = NewestFrames(self._feed.source, activity)
        stopwatch = Stopwatch(self._feed.source)
        frames = newest.select(self.pipeline.lengths(stopwatch.readings(self._counted_rows())))
        for shape in self.pipeline.shapes(stopwatch.frames(frames), "live"):
            latency = stopwatch.latency_of_shape(shape.t_s)
            self.latency = latency if newest.started and not self._ended else None
            if self.latency is not None:
                activity.latency_s.append(latency.latency_s)
            activity.show(shape)
            yield shape
            stopwatch.output()

    def _counted_rows(self) -> Iterator[Reading]:
        for reading in self._feed.rows:
            self.activity.count(reading, self._feed.source.late_s())
            yield reading
        self._ended = True

    def as_table(self, path: Path) -> dict[str, Any]:
        """Return run.toml.

        Args:
            path: result directory, to which the path of the trial is relative.
        """
        p = self.activity
        state = self._feed.state()
        median_ms, p99_ms = p.latency_ms()
        boards = self.pipeline.boards
        rows = self.pipeline.aid_counts() | self.pipeline.watch.factors.counts()
        return {
            "trial": self._feed.name,
            **({"trial_path": relative_path(path, self._feed.trial)} if self._feed.trial else {}),
            "source": self._feed.origin,
            "method": "live",
            **self.pipeline.rest.as_table(),
            "frames": p.frames,
            "skipped_frames": p.skipped_frames,
            "skipped_rows": state.skipped_rows,
            "recorded_rows": state.recorded_rows,
            **floor_table(p.shape.floor_normal if p.shape else None),
            "versions": versions(),
            "inputs": dict(self._feed.inputs),
            "boards": [asdict(counts) for counts in boards.counts] if boards else [],
            "imus": self._imus(state),
            "ports": {port.port: asdict(port.counts) for port in state.ports},
            "taring": self._feed.taring,
            "latency": {"median_ms": round(median_ms, 3), "p99_ms": round(p99_ms, 3)} if p.latency_s else {},
            **self.pipeline.aids.own_frames.as_table(),
            "rows": {name: n for name, n in rows.items() if n},
            "settings": asdict(self.pipeline.settings),
        }

    def _imus(self, state: LinkState) -> list[dict[str, int]]:
        """Return the counts of each inertial sensor; those of the link where a board reads it."""
        of_link = [asdict(counts) for counts in state.imus]
        gate = self.pipeline.aids.imu_gate
        return [
            (of_link[imu] if of_link else {})
            | {
                "samples": arrivals.count,
                "absurd_samples": int(gate.absurd[imu]),
                "stuck_samples": int(gate.stuck[imu]),
                "silent_frames": int(gate.silent_frames[imu]),
            }
            for imu, arrivals in enumerate(self.activity.imus)
        ]


@contextmanager
def stopped_by_signals(source: Source) -> Iterator[None]:
    """Let Ctrl-C, a termination or a terminal that is closed stop the source, so that the session ends in order.

    A second one ends it at once, as Ctrl-C ends a program, so that nothing unfinished is left; but not that of a closed
    terminal: shell and system may both send it, or it follows Ctrl-C while figures are drawn. What asks a process to go
    on in the background (`nohup`) still does.
    """
    numbers = [getattr(signal, name) for name in STOPPING if hasattr(signal, name)]
    earlier = {number: signal.getsignal(number) for number in numbers}
    earlier = {number: handler for number, handler in earlier.items() if handler is not signal.SIG_IGN}

    def stop(*_: object) -> None:
        earlier.update({number: signal.SIG_IGN for number in earlier if signal.Signals(number).name == "SIGHUP"})
        for number, handler in earlier.items():
            is_termination = signal.Signals(number).name == "SIGTERM"
            signal.signal(number, signal.default_int_handler if is_termination else handler)
        source.stop()

    for number in earlier:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)
