"""A rig: its description, whether its boards answer, and the time in which it stands still."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from ..io.boards.hub import LinkPlan
from ..io.boards.process import SerialLink
from ..io.toml import read_toml
from ..models.sensor.sensor_model import SensorModel
from ..models.sensor.stillness import SHORTEST_S, RestMotion, StillnessWatch
from ..models.settings import Settings
from ..models.trial_description import TrialDescription, TrialTable, describe_trial
from ..models.values.errors import InputError, TensegraphError
from ..models.values.link import LinkState, PortState, rebased
from ..models.values.readings import BoardReading

PATIENCE_S = 6.0
"""How long boards are waited for: a Mega that is opened restarts, and says hello after two seconds."""
TARINGS = 10
"""How many times the structure may move while it should stand still."""


@dataclass(frozen=True, slots=True)
class Rig:
    """What stands in the lab: a trial.toml without a trial."""

    path: Path
    """Of the file that describes it."""
    toml: dict[str, Any]
    """That file as parsed."""
    table: TrialTable
    """The same, checked."""
    description: TrialDescription
    """What it means."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a rig's description.

        Raises:
            InputError: naming file and key.
        """
        toml = without_truth(read_toml(path))
        table, description = describe_trial(toml, str(path))
        if description.source != "counts":
            raise InputError(f"{path}: a rig has boards: expected [[board]], got [{description.source}]")
        if 0 < description.rest_seconds < SHORTEST_S:
            raise InputError(
                f"{path}: [rest] seconds: too short to judge whether the structure stands still: expected 0 or at "
                f"least {SHORTEST_S:g}, got {description.rest_seconds:g}"
            )
        return cls(path=path, toml=toml, table=table, description=description)

    def plan(self, ports: Sequence[str]) -> LinkPlan:
        """Return which boards to read on which ports; without ports, on the rig's own, or on all.

        Raises:
            InputError: when two boards have one id, or an id is no number that fits in a byte.
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
        return LinkPlan(
            board_ids=tuple(ids),
            channels=channels,
            ports=tuple(ports or self.table.link.ports),
            baud=self.table.link.baud,
        )

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
        link.receive()
        heard = {port.board for port in link.state.ports if port.board is not None}
    if not heard:
        reasons = [f"{port.port}: {_reason_of_silence(port)}" for port in link.state.ports]
        raise TensegraphError(f"no board answers on {'; '.join(reasons) or ports}: see tensegraph ports")
    return len(heard)


def _reason_of_silence(port: PortState) -> str:
    """Return why no board was heard on a port."""
    if port.complaint or not port.counts.garbage + port.counts.bad_crc:
        return port.complaint or "silent"
    return "sends nothing that can be read: is its rate [link] baud?"


@dataclass(frozen=True, slots=True)
class TaringRows:
    """The rows from which the sensors are tared: those of the time in which the structure stood still."""

    origin_s: float
    """When that time began, by `time.perf_counter`."""
    rows: list[BoardReading]
    """Counted from there."""
    motion: RestMotion | None
    """How much tendons moved all the same; None when the rig has no rest."""


def tare(link: SerialLink, rig: Rig, settings: Settings, model: SensorModel, say: Callable[[str], None]) -> TaringRows:
    """Wait for a time in which the structure stands still, as long as the rig's rest.

    Args:
        link: to the boards.
        rig: their description.
        settings: of their clocks.
        model: of the sensors, by which motion is seen.
        say: tells the operator what is seen.

    Raises:
        TensegraphError: when it does not stand still.
    """
    rest_s = rig.description.rest_seconds
    if rest_s == 0:
        return TaringRows(time.perf_counter(), [], None)
    for _ in range(TARINGS):
        origin_s = time.perf_counter()
        rows, motion = _rows_and_motion(link, origin_s, rig.description, settings, model)
        if motion.still:
            say(f"tared: {motion}")
            return TaringRows(origin_s, rows, motion)
        say(f"it moved: {motion}; once more")
    raise TensegraphError(f"the structure did not stand still for {rest_s:g} s: {motion}")


def _rows_and_motion(
    link: SerialLink, origin_s: float, trial: TrialDescription, settings: Settings, model: SensorModel
) -> tuple[list[BoardReading], RestMotion]:
    """Return the rows of the rest that begins at `origin_s`, counted from there, and what motion they show."""
    rows: list[BoardReading] = []
    boards = trial.boards(settings.clock)
    watch = StillnessWatch(model.gauge, trial.natural_resistance_ohm, trial.structure.natural_length_m)
    for raw in link.rows():
        if raw.host_s < origin_s:
            continue
        rows.append(rebased(raw, origin_s))
        reading = boards.reading(rows[-1])
        if reading is not None:
            watch.add(reading)
        if rows[-1].host_s > trial.rest_seconds:
            break
    return rows, watch.motion()


def without_truth(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return a trial.toml without what is evaluation only."""
    return {key: value for key, value in metadata.items() if key != "truth"}
