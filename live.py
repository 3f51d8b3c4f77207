"""A live session: boards, a replay or the twin in, shapes out as they come; and the recording of boards alone.

source -> rows -> (recorder) -> lengths -> newest frames -> shapes -> result, view; the panel watches.
"""

import gc
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from .io.figures import write_lengths_figure, write_shape_figure
from .io.recorder import Recorder, RecorderThread
from .io.replay import Replay, arrival_s
from .io.result import append_tables, result_directory, write_run
from .io.serial_link import LinkPlan, SerialLink
from .io.toml import read_toml
from .io.trial import Reading, open_trial
from .models.boards import Boards
from .models.errors import InputError, TensegraphError
from .models.link import LinkState, rebased
from .models.readings import BoardReading, TendonLengths
from .models.reconstruction import Reconstruction
from .models.sensor_model import SensorModel
from .models.settings import Settings
from .models.shape import Shape
from .models.stillness import Motion, StillnessWatch
from .models.structure import Structure
from .models.trial import TrialDescription, TrialTable, describe_trial
from .pipeline import Pipeline
from .report import versions
from .simulation import virtual_trial

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
PATIENCE_S = 6.0
"""How long boards are waited for: a Mega that is opened restarts, and says hello after two seconds."""
TARINGS = 10
"""So often the structure may move while it is to stand still."""


class Source(Protocol):
    """Where readings come from: boards, a replay, the twin."""

    def rows(self) -> Iterator[Reading]:
        """Yield readings as they come, until `stop`."""
        ...

    def waiting(self) -> int:
        """Return how many readings have come and were not yet yielded."""
        ...

    def late_s(self) -> float:
        """Return how long ago the reading that was yielded last had come."""
        ...

    def stop(self) -> None:
        """Read no more; what has come is still yielded."""
        ...


@dataclass(frozen=True, slots=True)
class Rig:
    """What stands in the lab: a trial.toml without a trial."""

    path: Path
    toml: dict[str, Any]
    table: TrialTable
    description: TrialDescription

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a rig's description.

        Raises:
            InputError: naming file and key.
        """
        toml = _without_truth(read_toml(path))
        table, description = describe_trial(toml, str(path))
        if description.source != "counts":
            raise InputError(f"{path}: a rig has boards: expected [[board]], got [{description.source}]")
        return cls(path, toml, table, description)

    def plan(self, ports: list[str]) -> LinkPlan:
        """Return which boards to read on which ports; without ports, on the rig's own, or on all.

        Raises:
            InputError: when two boards have one id, or one has an id that none of ours can have.
        """
        ids: list[int] = []
        for b, board in enumerate(self.table.board):
            given = b if board.board_id is None else board.board_id
            if not str(given).isdecimal() or int(given) > 255 or int(given) in ids:
                raise InputError(
                    f"{self.path}: board[{b}].board_id: expected a number from 0 to 255, each once, got '{given}'"
                )
            ids.append(int(given))
        channels = tuple(len(board.tendon_of_channel) for board in self.table.board)
        return LinkPlan(tuple(ids), channels, tuple(ports or self.table.link.ports), self.table.link.baud)

    def metadata(self, name: str, state: LinkState) -> dict[str, Any]:
        """Return the trial.toml of a trial that begins now."""
        firmware = {port.board: port.hello.firmware for port in state.ports if port.hello is not None}
        boards = [
            table | ({"firmware": firmware[b]} if b in firmware else {}) for b, table in enumerate(self.toml["board"])
        ]
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        return self.toml | {"name": name, "recorded_utc": now, "board": boards}


def wait_for_boards(link: SerialLink, count: int, ports: str) -> int:
    """Wait until all boards are heard, or some for long enough; return how many.

    Raises:
        TensegraphError: when none is heard.
    """
    link.wait_until_it_reads()
    until_s = time.perf_counter() + PATIENCE_S
    heard: set[int] = set()
    while len(heard) < count and time.perf_counter() < until_s:
        time.sleep(0.05)
        link.waiting()
        heard = {port.board for port in link.state.ports if port.board is not None}
    if not heard:
        reasons = [f"{port.port}: {port.complaint or 'silent'}" for port in link.state.ports]
        raise TensegraphError(f"no board answers on {'; '.join(reasons) or ports}: see tensegraph ports")
    return len(heard)


def tare(
    link: SerialLink, rig: Rig, settings: Settings, model: SensorModel, say: Callable[[str], None]
) -> tuple[float, list[BoardReading], Motion | None]:
    """Wait for a time in which the structure stands still, as long as the rig's rest.

    Returns:
        When that time began, by `time.perf_counter`; its rows, counted from there; and what motion there was.

    Raises:
        TensegraphError: when it does not stand still.
    """
    d = rig.description
    for _ in range(TARINGS):
        origin_s, rows = time.perf_counter(), list[BoardReading]()
        boards = Boards(d, settings.clock)
        watch = StillnessWatch(model.gauge, d.natural_resistance_ohm, d.structure.natural_length_m)
        if d.rest_seconds == 0:
            return origin_s, rows, None
        for raw in link.rows():
            if raw.host_s >= origin_s:
                rows.append(rebased(raw, origin_s))
                if (reading := boards.reading(rows[-1])) is not None:
                    watch.add(reading)
                if rows[-1].host_s > d.rest_seconds:
                    break
        motion = watch.motion()
        if motion.still:
            say(f"tared: {motion}")
            return origin_s, rows, motion
        say(f"it moved: {motion}; once more")
    raise TensegraphError(f"the structure did not stand still for {d.rest_seconds:g} s: {motion}")


@dataclass(frozen=True, slots=True)
class Feed:
    """A source that has begun: a trial, as it comes."""

    source: Source
    rows: Iterator[Reading]
    """The trial's readings, as they come."""
    description: TrialDescription
    name: str
    origin: str
    """Where the readings come from, for people."""
    state: Callable[[], LinkState]
    """Of ports and recording, now."""
    taring: str = ""
    """What motion there was while the sensors were tared."""


@contextmanager
def boards_feed(
    rig: Rig, ports: list[str], record: Path | None, settings: Settings, model: SensorModel, people: "People"
) -> Iterator[Feed]:
    """Give the rows of a rig's boards, recorded if a path is given, once the structure has stood still.

    Raises:
        TensegraphError: when no board answers, or the structure does not stand still.
    """
    plan = rig.plan(ports)
    with SerialLink(plan) as link:
        people.say("looking for boards ...")
        heard = wait_for_boards(link, len(plan.board_ids), ", ".join(plan.ports) or "any USB serial port")
        if heard < len(plan.board_ids):
            people.say(f"{heard} of {len(plan.board_ids)} boards answered: going on, the others may come later")
        if rig.description.rest_seconds > 0:
            people.ask_for_rest(rig.description.rest_seconds)
        origin_s, tared, motion = tare(link, rig, settings, model, people.say)
        name = record.resolve().name if record else "live"
        link.begin(origin_s, record, rig.metadata(name, link.state))
        source = TrialOfBoards(link, origin_s, tared)
        yield Feed(
            source,
            source.rows(),
            rig.description,
            name,
            f"the boards of {rig.path}",
            lambda: link.state,
            str(motion or ""),
        )


@contextmanager
def replay_feed(path: Path, speed: float, record: Path | None) -> Iterator[Feed]:
    """Give the readings of a recorded trial at its own pace, or so many times faster; recorded again if asked to.

    Raises:
        InputError: when the trial can not be read, or the recording not be written.
    """
    trial = open_trial(path)
    source = Replay(trial.readings(), speed)
    feed = Feed(source, source.rows(), trial.description, trial.name, f"{path}, replayed", LinkState)
    with _recorded(feed, trial.toml, record) as recorded:
        yield recorded


@contextmanager
def twin_feed(plan: Path, speed: float, record: Path | None) -> Iterator[Feed]:
    """Give the readings that a plan's twin would, at their pace, and without the truth.

    Raises:
        TensegraphError: when the plan can not be simulated, or the recording not be written.
    """
    trial = virtual_trial(plan)
    source = Replay(trial.readings, speed)
    _, description = describe_trial(_without_truth(trial.metadata), str(plan))
    feed = Feed(source, source.rows(), description, plan.stem, f"the twin of {plan}", LinkState)
    with _recorded(feed, trial.metadata, record) as recorded:
        yield recorded


@contextmanager
def _recorded(feed: Feed, metadata: Mapping[str, Any], record: Path | None) -> Iterator[Feed]:
    """Give the same feed, recorded on the way if there is a path."""
    if record is None:
        yield feed
        return
    if feed.description.source != "counts":
        raise InputError(f"{feed.origin}: holds {feed.description.source}: only rows of boards can be recorded again")
    named = _without_truth(metadata) | {"name": record.resolve().name}
    with RecorderThread(Recorder(record, named, with_boot=True)) as recorder:

        def state() -> LinkState:
            return LinkState(recorded_rows=recorder.rows, recording_error=recorder.error)

        yield replace(feed, rows=_added(feed.rows, recorder), state=state)


def _without_truth(metadata: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in metadata.items() if key != "truth"}


def _added(readings: Iterator[Reading], recorder: RecorderThread) -> Iterator[Reading]:
    for reading in readings:
        assert isinstance(reading, BoardReading), "the recorder takes rows of boards"
        recorder.add(reading)
        yield reading


class People(Protocol):
    """Who stands beside the rig."""

    def say(self, text: str) -> None:
        """Tell them something."""
        ...

    def ask_for_rest(self, seconds: float) -> None:
        """Have them leave the structure alone; return when they have."""
        ...


class TrialOfBoards:
    """The rows of a trial that begins with those it was tared on, counted from its origin."""

    def __init__(self, link: SerialLink, origin_s: float, tared: list[BoardReading]) -> None:
        self._link, self._origin_s, self._tared = link, origin_s, deque(tared)
        self._latest_s = -1e-6
        self.stop = link.stop

    def rows(self) -> Iterator[BoardReading]:
        """Yield rows until `stop`."""
        while self._tared:
            row = self._tared.popleft()
            self._latest_s = row.host_s
            yield row
        for raw in self._link.rows():
            row = rebased(raw, self._origin_s)
            if row.host_s > self._latest_s:
                self._latest_s = row.host_s
                yield row

    def waiting(self) -> int:
        """Return how many rows have come and were not yet yielded."""
        return len(self._tared) + self._link.waiting()

    def late_s(self) -> float:
        """Return how long ago the row that was yielded last had come."""
        return time.perf_counter() - self._origin_s - self._latest_s


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

    def __init__(self, source: Source, activity: "Activity") -> None:
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
        self._structure, self._probability = structure, settings.probability
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
        write_lengths_figure(kept, title, self._directory / "lengths.png")
        write_shape_figure(kept, self._probability, title, self._directory / "shape.png")
        write_run(run, self._directory)

    def _write_chunk(self) -> None:
        if self._chunk:
            append_tables(Reconstruction.of(self._structure, self._chunk), self._probability, self._directory)
            self._chunk.clear()


class Session:
    """Shapes from a source, as they come."""

    def __init__(self, feed: "Feed", pipeline: Pipeline, seconds: float) -> None:
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

    def as_table(self) -> dict[str, Any]:
        """Return run.toml."""
        p, state = self.activity, self._feed.state()
        median_ms, p99_ms = p.latency_ms()
        boards = self.pipeline.boards
        return {
            "trial": self._feed.name,
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
