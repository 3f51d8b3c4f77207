"""The sources of readings of a live session: the boards of a rig after taring, a replay, or the twin."""

import heapq
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, takewhile
from math import inf
from pathlib import Path
from typing import Any, Protocol

from ..io.boards.process import SerialLink
from ..io.boards.recorder import Recorder, RecorderThread, as_recorded
from ..io.plan_file import plan_files, read_plan
from ..io.provenance import sha256_of, simulation_provenance
from ..io.replay import Replay
from ..io.trial_directory import open_trial
from ..io.whole import remove_directory
from ..models.plug_ins import PlugIn
from ..models.settings import Settings
from ..models.trial_description import TrialDescription, describe_trial
from ..models.twin.virtual_trial import simulate as simulate_plan
from ..models.values.errors import InputError, TensegraphError, naming
from ..models.values.link import LinkReading, LinkState, rebased
from ..models.values.readings import BoardReading, Reading, RecordedReading, arrival_s
from ..pipeline import AnySensorModel
from .rig import Rig, TaringRows, tare, wait_for_boards, without_truth


class Source(Protocol):
    """A source of readings: boards, a replay or the twin."""

    tared_until_s: float
    """Time of the newest reading that had arrived, while the sensors were tared, before the first was yielded."""

    def rows(self) -> Iterator[Reading]:
        """Yield readings as they arrive, until `stop`."""
        ...

    def waiting(self) -> int:
        """Return how many readings have arrived and were not yet yielded."""
        ...

    def late_s(self) -> float:
        """Return how long ago the reading that was yielded last had arrived."""
        ...

    def stop(self) -> None:
        """Stop reading; readings that have arrived are still yielded."""
        ...


@dataclass(frozen=True, slots=True)
class Feed:
    """A trial that has begun, with the source of its readings."""

    source: Source
    rows: Iterator[Reading]
    """Readings of the trial, as they arrive."""
    description: TrialDescription
    """Everything that is known of the trial before its first reading."""
    name: str
    """Name of the trial."""
    path: Path
    """The file or the directory of the source: that of a trial, the rig, or the plan."""
    origin: str
    """Description of the source, for the screen."""
    state: Callable[[], LinkState]
    """Function that returns the present state of ports and recording."""
    inputs: Mapping[str, str]
    """SHA-256 of the files from which the session was begun: those of a trial, the rig, or the plan."""
    trial: Path | None
    """Directory in which the same readings can be found afterwards; None if they are not recorded."""
    plug_ins: tuple[PlugIn, ...] = ()
    """What of other packages reads the trial that is replayed."""
    taring: str = ""
    """Description of the motion while the sensors were tared; empty without taring."""


class Operator(Protocol):
    """The person at the rig."""

    def say(self, text: str) -> None:
        """Show a message to the operator."""
        ...

    def ask_for_rest(self, seconds: float) -> None:
        """Ask the operator not to touch the structure for some seconds; return when the operator agrees."""
        ...


@contextmanager
def boards_feed(
    rig: Rig,
    ports: Sequence[str],
    record: Path | None,
    settings: Settings,
    model: AnySensorModel,
    operator: Operator,
    seconds: float = inf,
    *,
    only_records: bool = False,
) -> Iterator[Feed]:
    """Give the rows of the boards of a rig after taring, recorded if a path is given.

    Args:
        rig: description of structure, sensors and boards.
        ports: see `Rig.plan`.
        record: trial directory to record into; None for none.
        settings: those of the clocks are used.
        model: sensor model, from whose gauge motion during taring is computed; see `tare`.
        operator: who is asked not to touch the structure.
        seconds: duration from the start of the taring, after which the rows end even if the boards are silent.
        only_records: whether the rows end when the recording does.

    Raises:
        TensegraphError: when no board answers, or the structure does not stand still.
    """
    plan = rig.plan(ports, settings.clock)
    with SerialLink(plan) as link:
        operator.say("looking for boards ...")
        wait_for_boards(link, len(plan.board_ids), ", ".join(plan.ports) or "any USB serial port", operator.say)
        if rig.description.rest_seconds > 0:
            operator.ask_for_rest(rig.description.rest_seconds)
        taring = tare(link, rig, settings, model, operator.say)
        name = record.resolve().name if record else "live"
        link.begin(taring.origin_s, record, rig.metadata(name, link.state), only_records=only_records)
        source = TrialOfBoards(link, taring, seconds)
        yield Feed(
            source=source,
            rows=source.rows(),
            description=rig.description,
            name=name,
            path=rig.path,
            origin=f"the boards of {rig.path}",
            state=lambda: link.state,
            inputs={f"rig {rig.path.name}": sha256_of(rig.path)},  # no file of a trial has such a name
            trial=record,
            taring=str(taring.motion or ""),
        )


@contextmanager
def replay_feed(path: Path, speed: float, record: Path | None, seconds: float = inf) -> Iterator[Feed]:
    """Give the readings of a recorded trial, `speed` times faster than real time, recorded again if a path is given.

    Readings that arrived more than `seconds` after the first one are left out.

    Raises:
        InputError: when the trial cannot be read, or the recording cannot be written.
    """
    trial = open_trial(path)
    source = Replay(_first(seconds, trial.readings()), speed)
    feed = Feed(
        source=source,
        rows=source.rows(),
        description=trial.description,
        name=trial.name,
        path=path,
        origin=f"{path}, replayed",
        state=LinkState,
        inputs=trial.hashes(),
        trial=path,
        plug_ins=trial.plug_ins,
    )
    with _recorded(feed, trial.toml, record) as recorded:
        yield recorded


@contextmanager
def twin_feed(
    plan: Path,
    speed: float,
    record: Path | None,
    progress: Callable[[float], None],
    seconds: float = inf,
) -> Iterator[Feed]:
    """Give the readings of the simulation of a plan, `speed` times faster than real time, without the truth.

    They have the digits of a trial's files, so that a recording of them gives the same shapes.

    Args:
        plan: its file; all of it is simulated first.
        speed: relative to real time.
        record: trial directory to record into; None for none.
        progress: called now and then with the share of the simulation that is done.
        seconds: readings that arrive later than this after the first one are left out.

    Raises:
        TensegraphError: when the plan cannot be simulated, or the recording cannot be written.
    """
    parsed = read_plan(plan)
    with naming(plan):
        trial = simulate_plan(parsed, simulation_provenance(plan, parsed.seed), progress)
    readings = map(as_recorded, heapq.merge(trial.carried, trial.readings, key=arrival_s))
    source = Replay(_first(seconds, readings), speed)
    _, description = describe_trial(without_truth(trial.metadata), str(plan))
    feed = Feed(
        source=source,
        rows=source.rows(),
        description=description,
        name=plan.stem,
        path=plan,
        origin=f"the twin of {plan}",
        state=LinkState,
        inputs={f"plan {file.name}": sha256_of(file) for file in plan_files(plan)},
        trial=record,
    )
    with _recorded(feed, trial.metadata, record) as recorded:
        yield recorded


@contextmanager
def _recorded(feed: Feed, metadata: Mapping[str, Any], record: Path | None) -> Iterator[Feed]:
    """Give the same feed, whose rows are recorded if a path is given; half a recording is removed after a refusal."""
    if record is None:
        yield feed
        return
    if feed.description.source != "counts":
        raise InputError(f"{feed.path}: holds {feed.description.source}: only rows of boards can be recorded again")
    if feed.description.factors:
        raise InputError(f"{feed.path}: has [[factor]], whose readings cannot be recorded again")
    named = without_truth(metadata) | {"name": record.resolve().name}
    recorder = RecorderThread(Recorder(record, named, with_boot=True))
    rows = _RecordedRows(feed.rows, recorder)
    try:
        with recorder:
            yield replace(
                feed,
                rows=iter(rows),
                state=lambda: LinkState(recorded_rows=recorder.rows, recording_error=recorder.error),
            )
    except TensegraphError:
        if not rows.have_ended:
            remove_directory(record)
        raise


class _RecordedRows:
    """Readings that are recorded before they are yielded."""

    def __init__(self, readings: Iterator[Reading], recorder: RecorderThread) -> None:
        self._readings = readings
        self._recorder = recorder
        self.have_ended = False

    def __iter__(self) -> Iterator[Reading]:
        for reading in self._readings:
            assert isinstance(reading, RecordedReading), "the source is counts"
            self._recorder.add(reading)
            yield reading
        self.have_ended = True


def _first(seconds: float, readings: Iterable[Reading]) -> Iterator[Reading]:
    """Return the readings that arrived at most so many seconds after the first one, whose stamp may be any.

    The first one is read at once, so that files without any are refused before a recording begins.
    """
    readings = iter(readings)
    first = next(readings, None)
    if first is None:
        return iter(())
    end_s = arrival_s(first) + seconds
    return chain([first], takewhile(lambda reading: arrival_s(reading) <= end_s, readings))


class TrialOfBoards:
    """What boards send in a trial of so many seconds, starting with the taring, with times from the trial's origin."""

    def __init__(self, link: SerialLink, taring: TaringRows, seconds: float) -> None:
        self._link = link
        self._origin_s = taring.origin_s
        self._end_s = taring.origin_s + seconds
        self._tared = deque(taring.rows)
        self._latest_s = 0.0
        self.tared_until_s = max((arrival_s(row) for row in taring.rows), default=-inf)
        self.stop = link.stop

    def rows(self) -> Iterator[LinkReading]:
        """Yield rows and samples until `stop`, or until the seconds are over."""
        while self._tared:
            yield self._seen(self._tared.popleft())
        for raw in chain(self._link.rows(self._end_s), self._last_rows()):
            if arrival_s(raw) >= self._origin_s:
                yield self._seen(rebased(raw, self._origin_s))

    def _last_rows(self) -> Iterator[LinkReading]:
        """Stop, and yield what had arrived by then, as the recording has it too."""
        self._link.stop()
        yield from self._link.rows()

    def _seen(self, reading: LinkReading) -> LinkReading:
        """Return a reading, having noted when it arrived, which is told of rows alone."""
        if isinstance(reading, BoardReading):
            self._latest_s = reading.host_s
        return reading

    def waiting(self) -> int:
        """Return how many rows have arrived and were not yet yielded."""
        self._link.receive()
        return len(self._tared) + self._link.waiting()

    def late_s(self) -> float:
        """Return how long ago the row that was yielded last had arrived."""
        return time.perf_counter() - self._origin_s - self._latest_s
