"""A rig: reading its description, waiting for its boards, and taring its sensors while the structure stands still."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from ..io.boards.hub import LinkPlan
from ..io.boards.port import UNREADABLE
from ..io.boards.process import SerialLink
from ..io.model_file import read_sensor_model
from ..io.structures.structure_file import with_structure_file
from ..io.toml import read_toml
from ..models.sensor.clock import ClockSettings
from ..models.sensor.gauge import StaticGauge
from ..models.sensor.sensor_model import SensorModel
from ..models.sensor.stillness import SHORTEST_S, RestMotion, StillnessWatch
from ..models.settings import Settings
from ..models.trial_description import TrialDescription, describe_trial
from ..models.trial_tables import TrialTable
from ..models.values.errors import InputError, TensegraphError
from ..models.values.link import LinkReading, LinkState, PortState, rebased
from ..models.values.readings import BoardReading, arrival_s
from ..pipeline import AnySensorModel

PATIENCE_S = 6.0
"""Longest time to wait for boards. An Arduino Mega restarts when its port is opened, and sends hello after 2 s."""
SILENT_S = 1.0
"""Time after its newest reading from which a board or sensor counts as silent."""
TARINGS = 10
"""Largest number of attempts at taring, each of which fails if the structure moves."""


@dataclass(frozen=True, slots=True)
class Rig:
    """The description of structure, sensors and boards in a lab, in the form of trial.toml."""

    path: Path
    """Path of the file with the description."""
    toml: dict[str, Any]
    """Contents of the file as parsed, without the truth."""
    table: TrialTable
    """Contents of the file, validated."""
    description: TrialDescription
    """Structure, sensors and boards that the file describes."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a rig's description.

        Raises:
            InputError: naming file and key.
        """
        toml = with_structure_file(without_truth(read_toml(path)), path)
        table, description = describe_trial(toml, str(path))
        _check_sources(table, path)
        if description.source != "counts":
            raise InputError(f"{path}: a rig has boards: expected [[board]], got [{description.source}]")
        if 0 < description.rest_seconds < SHORTEST_S:
            raise InputError(
                f"{path}: [rest] seconds: too short to judge whether the structure stands still: expected 0 or at "
                f"least {SHORTEST_S:g}, got {description.rest_seconds:g}"
            )
        return cls(path=path, toml=toml, table=table, description=description)

    def plan(self, ports: Sequence[str], clock: ClockSettings) -> LinkPlan:
        """Return the boards to read and their ports; if `ports` is empty, those of the rig, or all USB serial ports.

        Args:
            ports: names of serial ports.
            clock: settings of the boards' clocks.

        Raises:
            InputError: when two boards have the same id, or an id is not a number from 0 to 255.
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
            imus=tuple((imu.board, imu.sensor) for imu in self.table.imu if imu.board is not None),
            clock=clock,
        )

    def metadata(self, name: str, state: LinkState) -> dict[str, Any]:
        """Return the contents of trial.toml for a trial that begins now."""
        firmware = {port.board: port.hello.firmware for port in state.ports if port.hello is not None}
        boards = [
            table | ({"firmware": firmware[b]} if b in firmware else {}) for b, table in enumerate(self.toml["board"])
        ]
        imus = [{"file": f"imu{number}.csv"} | table for number, table in enumerate(self.toml.get("imu", ()))]
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        described = {"name": name, "recorded_utc": now, "board": boards}
        return self.toml | described | ({"imu": imus} if imus else {})


def _check_sources(table: TrialTable, path: Path) -> None:
    """Refuse sensors whose readings come from no board."""
    for number, imu in enumerate(table.imu):
        if imu.board is None:
            raise InputError(f"{path}: imu[{number}].board: is missing: a rig reads its inertial sensors from boards")
    for kind in ("range", "position", "motor", "factor"):
        if getattr(table, kind):
            raise InputError(f"{path}: [[{kind}]]: comes from no board: expected a rig without it")


def wait_for_boards(link: SerialLink, count: int, ports: str, say: Callable[[str], None]) -> None:
    """Wait until all boards have answered, at most for `PATIENCE_S`; tell how many did, and why others did not.

    Raises:
        TensegraphError: when no board answers.
    """
    link.wait_until_it_reads()
    until_s = time.perf_counter() + PATIENCE_S
    heard: set[int] = set()
    while len(heard) < count and time.perf_counter() < until_s:
        time.sleep(0.05)
        link.receive()
        heard = {port.board for port in link.state.ports if port.board is not None}
    silent = [port for port in link.state.ports if port.board is None]
    reasons = "; ".join(f"{port.port or 'a port without a name'}: {_reason_of_silence(port)}" for port in silent)
    if not heard:
        raise TensegraphError(f"no board answers on {reasons or ports}: see tensegraph ports")
    if len(heard) < count:
        say(
            f"{len(heard)} of {count} boards answered{f' ({reasons})' * bool(reasons)}: going on, others may come later"
        )


def _reason_of_silence(port: PortState) -> str:
    """Return the reason why no board answered on a port."""
    if port.complaint or not port.counts.garbage + port.counts.bad_crc:
        return port.complaint or "silent"
    return UNREADABLE


@dataclass(frozen=True, slots=True)
class TaringRows:
    """The rows of the time in which the structure stood still, from which the sensors are tared."""

    origin_s: float
    """Start of that time, on the clock of `time.perf_counter`."""
    rows: list[LinkReading]
    """The rows, and the samples of inertial sensors, with times from `origin_s`."""
    motion: RestMotion | None
    """Remaining motion of the tendons; None when the rig has no rest."""


def tare(
    link: SerialLink, rig: Rig, settings: Settings, model: AnySensorModel, say: Callable[[str], None]
) -> TaringRows:
    """Wait until the structure has stood still for the rest time of the rig.

    Args:
        link: connection to the boards.
        rig: description of the boards.
        settings: those of the clocks are used.
        model: sensor model, from whose gauge motion is computed.
        say: shows a message to the operator.

    Raises:
        TensegraphError: when it does not stand still, the boards fall silent, or too few readings arrive to judge.
    """
    rest_s = rig.description.rest_seconds
    if rest_s == 0:
        return TaringRows(time.perf_counter(), [], None)
    gauge = _gauge(model)
    for _ in range(TARINGS):
        origin_s = time.perf_counter()
        rows, motion = _rows_and_motion(link, origin_s, rig.description, settings, gauge)
        if motion.still:
            say(f"tared: {motion}")
            heard = {row.board for row in rows if isinstance(row, BoardReading)}
            for board in sorted(set(range(len(rig.table.board))) - heard):
                say(f"board {board}: no row meanwhile: its sensors are not tared, and their lengths less certain")
            return TaringRows(origin_s, rows, motion)
        say(f"it moved: {motion}; once more")
    raise TensegraphError(f"the structure did not stand still for {rest_s:g} s: {motion}")


def _gauge(model: AnySensorModel) -> StaticGauge:
    """Return the gauge of a sensor model; for one of another package, which has none, that of the model in ours."""
    return (model if isinstance(model, SensorModel) else read_sensor_model()).gauge


def _rows_and_motion(
    link: SerialLink, origin_s: float, trial: TrialDescription, settings: Settings, gauge: StaticGauge
) -> tuple[list[LinkReading], RestMotion]:
    """Return the readings of the rest, with times from its start `origin_s`, and the motion that rows show.

    Raises:
        TensegraphError: when the boards fall silent, or too few readings arrive to judge.
    """
    rows: list[LinkReading] = []
    newest_s = 0.0
    boards = trial.boards(settings.clock)
    watch = StillnessWatch(gauge, trial.natural_resistance_ohm, trial.structure.natural_length_m)
    for raw in link.rows(origin_s + trial.rest_seconds + SILENT_S):
        if arrival_s(raw) < origin_s:
            continue
        row = rebased(raw, origin_s)
        rows.append(row)
        if not isinstance(row, BoardReading):
            continue
        reading = boards.reading(row)
        if reading is not None:
            watch.add(reading)
        newest_s = row.host_s
        if newest_s > trial.rest_seconds:
            return rows, watch.motion()
    raise TensegraphError(
        f"the boards fell silent {newest_s:.1f} s after the start of the taring, which takes {trial.rest_seconds:g} s: "
        "see tensegraph ports"
    )


def without_truth(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return the contents of trial.toml without [truth], which is for evaluation only."""
    return {key: value for key, value in metadata.items() if key != "truth"}
