"""Where a live session's readings come from: a rig's boards once the structure stood still, a replay, or the twin."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, Self

from ..commands.simulate import virtual_trial
from ..io.boards.process import LinkPlan, SerialLink
from ..io.boards.recorder import Recorder, RecorderThread
from ..io.replay import Replay
from ..io.toml import read_toml
from ..io.trial_directory import Reading, open_trial
from ..models.sensor.sensor_model import SensorModel
from ..models.sensor.stillness import RestMotion, StillnessWatch
from ..models.settings import Settings
from ..models.trial_description import TrialDescription, TrialTable, describe_trial
from ..models.values.errors import InputError, TensegraphError
from ..models.values.link import LinkState, PortState, rebased
from ..models.values.readings import BoardReading

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
        reasons = [f"{port.port}: {_silence(port)}" for port in link.state.ports]
        raise TensegraphError(f"no board answers on {'; '.join(reasons) or ports}: see tensegraph ports")
    return len(heard)


def _silence(port: PortState) -> str:
    """Return why no board was heard on a port."""
    if port.complaint or not port.counts.garbage + port.counts.bad_crc:
        return port.complaint or "silent"
    return "sends nothing that can be read: is its rate [link] baud?"


def tare(
    link: SerialLink, rig: Rig, settings: Settings, model: SensorModel, say: Callable[[str], None]
) -> tuple[float, list[BoardReading], RestMotion | None]:
    """Wait for a time in which the structure stands still, as long as the rig's rest.

    Returns:
        When that time began, by `time.perf_counter`; its rows, counted from there; and what motion there was.

    Raises:
        TensegraphError: when it does not stand still.
    """
    d = rig.description
    for _ in range(TARINGS):
        origin_s, rows = time.perf_counter(), list[BoardReading]()
        boards = d.boards(settings.clock)
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
    trial: Path | None
    """Where the same readings are to be found afterwards, if anywhere."""
    taring: str = ""
    """What motion there was while the sensors were tared."""


class People(Protocol):
    """Who stands beside the rig."""

    def say(self, text: str) -> None:
        """Tell them something."""
        ...

    def ask_for_rest(self, seconds: float) -> None:
        """Have them leave the structure alone; return when they have."""
        ...


@contextmanager
def boards_feed(
    rig: Rig, ports: list[str], record: Path | None, settings: Settings, model: SensorModel, people: People
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
            record,
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
    feed = Feed(source, source.rows(), trial.description, trial.name, f"{path}, replayed", LinkState, path)
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
    feed = Feed(source, source.rows(), description, plan.stem, f"the twin of {plan}", LinkState, record)
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
