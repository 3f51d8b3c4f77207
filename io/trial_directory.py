"""A trial directory: its description, and its measurements as an iterator of readings."""

import hashlib
import heapq
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..models.evaluation.truth import (
    Fault,
    MarkedNode,
    TrueContacts,
    TrueLoads,
    Truth,
    known_faults,
    marked_nodes,
)
from ..models.plug_ins import PlugIn
from ..models.trial_description import TrialDescription, describe_trial
from ..models.trial_tables import TrialTable
from ..models.values.aids import AidReading
from ..models.values.errors import InputError, printable
from ..models.values.readings import (
    BENDING,
    STRETCHING,
    BoardReading,
    Flag,
    Reading,
    ResistanceReading,
    TendonLengths,
    arrival_s,
    is_impossible_length,
)
from ..models.values.stamps import is_later
from ..models.values.tables import SMALLEST_SIGMA
from ..models.values.tracks import MarkerTracks, StampedPositions
from .aid_files import (
    IMU_COLUMNS,
    MOTOR_COLUMNS,
    POSITION_COLUMNS,
    RANGE_COLUMNS,
    imu_readings,
    natural_length_readings,
    position_readings,
    range_readings,
)
from .csv import CsvFile, in_seconds
from .input_files import line_count
from .length_files.lengths_bag import LengthsBag, is_bag
from .length_files.lengths_reader import ReadLengths, reader_of
from .mocap.truth_file import read_truth
from .positions import read_contacts, read_forces
from .provenance import sha256_of
from .result import RUN_FILE
from .structures.structure_file import with_structure_file
from .toml import read_toml

LONGEST_STEP_S = 600.0
"""Time from the first row to the second above which stamps are not in seconds, and between the first rows of two boards
above which they are of two clocks."""
MOST_SHORTENED = 4.0
"""Natural length over length above which all tendons cannot be bent at once."""
LARGEST_SIGMA_SHARE = 0.5
"""Sigma over length from which a length says nothing."""


@dataclass(slots=True, eq=False)
class Trial:
    """An opened trial."""

    path: Path
    """Directory of the trial."""
    name: str
    """Name from trial.toml, or else of the directory."""
    description: TrialDescription
    """Everything that is known before the first measurement."""
    table: TrialTable
    """Contents of trial.toml, validated."""
    toml: dict[str, Any]
    """Contents of trial.toml as parsed."""
    dropped_rows: int = field(default=0, init=False)
    """Number of rows of resistance or lengths that were left out because their stamp was not later than the last,
    in the latest `readings`."""
    _opened: list[CsvFile] = field(default_factory=list, init=False)

    @property
    def half_lines(self) -> int:
        """Number of last lines that had no line end and were left out, of the files of the latest `readings`."""
        return sum(file.half_lines for file in self._opened)

    @property
    def ignored_columns(self) -> dict[str, list[str]]:
        """Names of the columns that say nothing, of each file of the latest `readings` that has some."""
        return {file.path.name: file.unused for file in self._opened if file.unused}

    def readings(self) -> Iterator[Reading]:
        """Yield the measurements in order of arrival; each call reads the files from the start.

        Raises:
            InputError: at the first row that cannot be read, or when there is none.
        """
        self.dropped_rows = 0
        self._opened.clear()
        sources: dict[str, Callable[[], Iterator[Reading]]]
        sources = {"counts": self._rows, "resistance": self._resistances, "lengths": self._lengths}
        tendons = _counted(sources[self.description.source](), self)
        motors = [
            natural_length_readings(self._csv(motor.file, MOTOR_COLUMNS), number, self.description)
            for number, motor in enumerate(self.table.motor)
        ]  # first, so that lengths of the same instant find them
        yield from heapq.merge(*motors, tendons, *self._aids(), key=arrival_s)

    def files(self) -> list[str]:
        """Return the names of the files with measurements.

        Raises:
            InputError: for an inertial sensor whose file is not named.
        """
        stand_in = self.table.resistance or self.table.lengths
        tendons = [stand_in.file] if stand_in else [board.file for board in self.table.board]
        others = [other.file for other in self.table.range] + [other.file for other in self.table.position]
        motors = [motor.file for motor in self.table.motor]
        factors = [factor["file"] for factor in self.table.factor if factor.get("file") is not None]
        return tendons + self._imu_files() + others + motors + factors

    def _imu_files(self) -> list[str]:
        files: list[str] = []
        for number, imu in enumerate(self.table.imu):
            if imu.file is None:
                raise InputError(f"{self.path / 'trial.toml'}: imu[{number}].file: is missing")
            files.append(imu.file)
        return files

    @property
    def reader(self) -> PlugIn | None:
        """What of another package reads the file of lengths; None where it is a CSV file or a bag, or there is none."""
        return reader_of(self.path / self.table.lengths.file) if self.table.lengths else None

    @property
    def plug_ins(self) -> tuple[PlugIn, ...]:
        """What of other packages reads the trial: the reader of its lengths, and its factors.

        Raises:
            InputError: for a factor that no package brings.
        """
        factors = tuple(factor.plug_in() for factor in self.description.factors)
        return factors if self.reader is None else (self.reader, *factors)

    def row_count(self) -> int:
        """Return the approximate number of readings, for a progress bar."""
        bag = self._bag()
        others = [self.path / str(factor["file"]) for factor in self.table.factor if "file" in factor]
        tables = [name for name in self.files() if self.path / name not in [*others, *([bag.path] if bag else [])]]
        rows = sum(max(line_count(self.path / name) - 1, 0) for name in tables)
        return rows + (bag.message_count() if bag else 0)

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of every input: files of measurements, and trial.toml without [truth]."""
        inputs = {key: value for key, value in self.toml.items() if key != "truth"}
        return {"trial.toml": _sha256_of_table(inputs)} | {name: sha256_of(self.path / name) for name in self.files()}

    def truth_hashes(self) -> dict[str, str]:
        """Return the SHA-256 of [truth] in trial.toml, and of each file that it names and that is there."""
        truth = self.table.truth
        if truth is None:
            return {}
        named = [name for name in (truth.file, truth.loads, truth.contacts) if name and (self.path / name).is_file()]
        return {"[truth]": _sha256_of_table(self.toml["truth"])} | {name: sha256_of(self.path / name) for name in named}

    def truth(self) -> StampedPositions | None:
        """Return the true positions, if the trial has them. Evaluation only.

        Raises:
            InputError: when they cannot be read, or are of motion capture, which only an estimate gives clock and axes.
        """
        recorded = self.recorded_truth()
        if isinstance(recorded, MarkerTracks):
            raise InputError(f"{self.path}: truth is motion capture: `tensegraph evaluate` lays it onto the result")
        return recorded

    def recorded_truth(self) -> StampedPositions | MarkerTracks | None:
        """Return the true positions, or the motion capture that tells them, if the trial has it. Evaluation only."""
        if self.table.truth is None or self.table.truth.file is None:
            return None
        return read_truth(self.path / self.table.truth.file, self.description.structure.node_count)

    def marked_nodes(self) -> tuple[MarkedNode, ...]:
        """Return which marker of a motion capture is which node, as far as trial.toml tells it. Evaluation only."""
        if self.table.truth is None:
            return ()
        return marked_nodes(self.table.truth, self.description.structure, str(self.path / "trial.toml"))

    def true_loads(self) -> TrueLoads | None:
        """Return the true external forces, if the trial has them. Evaluation only."""
        if self.table.truth is None or self.table.truth.loads is None:
            return None
        return read_forces(self.path / self.table.truth.loads, self.description.structure.node_count)

    def true_contacts(self) -> TrueContacts | None:
        """Return which nodes the floor is known to carry, if the trial tells it. Evaluation only."""
        if self.table.truth is None or self.table.truth.contacts is None:
            return None
        t_s, standing = read_contacts(self.path / self.table.truth.contacts, self.description.structure.node_count)
        return TrueContacts(t_s, standing > 0.5)

    def faults(self) -> tuple[Fault, ...]:
        """Return the true faults, if the trial has them. Evaluation only."""
        if self.table.truth is None:
            return ()
        return known_faults(self.table.truth, self.description, str(self.path / "trial.toml"))

    def truth_of(self, positions: StampedPositions, loads: TrueLoads | None = None) -> Truth:
        """Return true positions and loads, with the rest and the faults of the trial. Evaluation only."""
        positions = positions.without_coinciding()
        read_again = replace(self)  # with counts of its own
        return Truth(
            t_s=positions.t_s,
            node_position_m=positions.node_position_m,
            rest_seconds=self.description.rest_seconds,
            start_s=next((arrival_s(reading) for reading in read_again.readings()), None),
            faults=self.faults(),
            loads=loads,
            contacts=self.true_contacts(),
        )

    def _aids(self) -> list[Iterator[AidReading]]:
        """Return the readings of each sensor beside the tendons."""
        table, trial = self.table, self.description
        imus = [self._csv(name, IMU_COLUMNS) for name in self._imu_files()]
        ranges = [self._csv(recording.file, RANGE_COLUMNS) for recording in table.range]
        positions = [self._csv(recording.file, POSITION_COLUMNS) for recording in table.position]
        return [
            *(imu_readings(file, number) for number, file in enumerate(imus)),
            *(range_readings(file, number, trial) for number, file in enumerate(ranges)),
            *(position_readings(file, number, trial) for number, file in enumerate(positions)),
        ]

    def _csv(
        self,
        name: str,
        columns: Sequence[str],
        *,
        optional: Sequence[str] = (),
        blank: Sequence[str] = (),
        infinite: Sequence[str] = (),
    ) -> CsvFile:
        """Return a file of measurements, whose half lines count."""
        file = CsvFile(self.path / name, columns, optional, blank, infinite=infinite)
        self._opened.append(file)
        return file

    def _rows(self) -> Iterator[BoardReading]:
        boards = [self._board(b) for b in range(len(self.table.board))]
        first = [list(islice(board, 1)) for board in boards]
        first_s = [row.host_s for rows in first for row in rows]
        if first_s and max(first_s) - min(first_s) > LONGEST_STEP_S:
            files = " and ".join(board.file for board in self.table.board)
            raise InputError(
                f"{self.path}: {files}: expected first rows at most {LONGEST_STEP_S:g} s apart, got "
                f"{max(first_s) - min(first_s):.6g} s: is host_s of one clock in all, and is its unit right?"
            )
        return heapq.merge(*map(chain, first, boards), key=lambda row: row.host_s)

    def _board(self, board: int) -> Iterator[BoardReading]:
        channels = len(self.table.board[board].tendon_of_channel)
        columns = ["host_s", "seq", "device_us", *(f"adc{c}" for c in range(channels))]
        file = self._csv(self.table.board[board].file, columns, optional=["boot"])
        for number, (host_s, *integers, boot) in enumerate(file, start=file.head().first_row):
            for name, value in zip(columns[1:], integers, strict=True):
                if value != int(value):
                    raise InputError(f"{file.path}: row {number}, column {name}: expected an integer, got {value}")
            seq, device_us, *counts = (int(value) for value in integers)
            yield BoardReading(
                board=board,
                host_s=host_s,
                seq=seq,
                device_us=device_us,
                counts=np.array(counts),
                boot=0 if np.isnan(boot) else int(boot),
            )

    def _resistances(self) -> Iterator[ResistanceReading]:
        assert self.table.resistance is not None
        tendons = self.description.structure.sensed_tendons
        columns = [f"r{e}_ohm" for e in tendons]
        file = self._csv(self.table.resistance.file, ["t_s", *columns], blank=columns, infinite=columns)
        for row in in_seconds(self._forward(file), file.path):
            resistance_ohm = np.array(row[1:])
            possible = ~(resistance_ohm <= 0)
            yield ResistanceReading(
                source=0,
                t_s=row[0],
                arrival_s=row[0],
                tendon=tendons,
                resistance_ohm=np.where(possible, resistance_ohm, np.nan),
                sigma_ohm=np.zeros(len(tendons)),
                flags=np.where(possible, 0, int(Flag.OUT_OF_RANGE)),
            )

    def _lengths(self) -> Iterator[TendonLengths]:
        assert self.table.lengths is not None, "lengths are told"
        natural_m = self.description.structure.natural_length_m
        sensed = self.description.structure.sensed_tendons
        rows = self._bag() or self._read_lengths() or self._lengths_csv()
        in_time = self._forward(rows)
        if self.description.has_aids and not self.description.structure.is_held:  # there are frames between rows
            in_time = in_seconds(in_time, self.path / self.table.lengths.file)
        is_checked = False
        for index, row in enumerate(in_time):
            length_m, sigma_m = np.full((2, len(natural_m)), np.nan)
            length_m[sensed] = row[1 : 1 + len(sensed)]
            if len(row) > 1 + len(sensed):
                sigma_m[sensed] = row[1 + len(sensed) :]
            told = np.isfinite(length_m)
            if told.any() and not is_checked:
                is_checked = True
                self._check_first(rows.place(index), length_m[told], sigma_m[told], natural_m[told])
            possible = ~(sigma_m < SMALLEST_SIGMA)
            mode = np.where(length_m < natural_m, BENDING, STRETCHING)
            flags = np.where(np.isnan(length_m), int(Flag.MISSING), np.where(possible, 0, int(Flag.OUT_OF_RANGE)))
            yield TendonLengths(
                t_s=row[0],
                length_m=np.where(possible, length_m, np.nan),
                sigma_m=sigma_m,
                mode=mode,
                flags=flags,
                of_strips=self.table.lengths.strips,
            )

    def _check_first(
        self, place: str, length_m: NDArray[np.float64], sigma_m: NDArray[np.float64], natural_m: NDArray[np.float64]
    ) -> None:
        """Check the unit of the lengths that the first row tells, and of their sigmas, nan where none is told.

        Raises:
            InputError: when no length is like its natural one, or every sigma is about as large as that.
        """
        short = length_m < natural_m / MOST_SHORTENED
        if (short | is_impossible_length(length_m, natural_m)).all():
            raise InputError(
                f"{place}: expected lengths like the natural ones, {np.median(natural_m):.3g} m, got "
                f"{np.median(length_m):.3g} m: is the unit right, and is it the length and not its change?"
            )
        if (sigma_m > LARGEST_SIGMA_SHARE * length_m).all():
            raise InputError(
                f"{place}: expected sigmas below half of the lengths, {np.median(length_m):.3g} m, got "
                f"{np.median(sigma_m):.3g} m: is the unit right?"
            )

    def _lengths_csv(self) -> CsvFile:
        """Return t_s, then the lengths of the tendons that have a sensor, then their sigmas."""
        assert self.table.lengths is not None
        sensed = self.description.structure.sensed_tendons
        columns = [f"l{e}_m" for e in sensed]
        sigmas = [f"s{e}_m" for e in sensed]
        return self._csv(self.table.lengths.file, ["t_s", *columns], optional=sigmas, blank=[*columns, *sigmas])

    def _bag(self) -> LengthsBag | None:
        """Return the bag that holds the lengths; None where another file does.

        Raises:
            InputError: see `LengthsBag`; and for the topic of what is no bag.
        """
        table = self.table.lengths
        if table is None:
            return None
        if is_bag(self.path / table.file):
            return LengthsBag(self.path / table.file, table.topic, self.description.structure.sensed_tendons.tolist())
        if table.topic is not None:
            raise InputError(
                f"{self.path / 'trial.toml'}: lengths.topic: goes with a bag: expected none with {table.file}"
            )
        return None

    def _read_lengths(self) -> ReadLengths | None:
        """Return the file of lengths as a reader of another package reads it; None without one."""
        reader = self.reader
        if self.table.lengths is None or reader is None:
            return None
        sensed = self.description.structure.sensed_tendons.tolist()
        return ReadLengths(self.path / self.table.lengths.file, reader, sensed)

    def _forward(self, rows: CsvFile | LengthsBag | ReadLengths) -> Iterator[list[float]]:
        """Yield the rows that are later than all rows before, see `is_later`; count the others."""
        latest_s = -np.inf
        for index, row in enumerate(rows):
            if is_later(row[0], latest_s):
                if index == 1 and row[0] - latest_s > LONGEST_STEP_S:
                    raise InputError(
                        f"{rows.place(index)}, column t_s: expected at most {LONGEST_STEP_S:g} s after "
                        f"{latest_s:g}, got {row[0]:g}: is the unit right?"
                    )
                latest_s = row[0]
                yield row
            else:
                self.dropped_rows += 1


def _sha256_of_table(table: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(table, sort_keys=True, default=str).encode()).hexdigest()


def _counted(readings: Iterator[Reading], trial: Trial) -> Iterator[Reading]:
    """Yield the readings of tendons, of which there is at least one."""
    count = 0
    for reading in readings:
        count += 1
        yield reading
    if count == 0:
        raise InputError(f"{trial.path}: holds no readings: expected at least one row in {', '.join(trial.files())}")


def read_description(path: str | Path) -> TrialDescription:
    """Return what trial.toml, or rig.toml, tells of a trial before its first reading: for `stream`.

    Args:
        path: of the file, or of a trial directory.

    Raises:
        InputError: when it cannot be read, or does not describe a trial.
    """
    path = Path(path)
    return _described(path / "trial.toml" if path.is_dir() else path)[2]


def _described(path: Path) -> tuple[dict[str, Any], TrialTable, TrialDescription]:
    """Return the contents of trial.toml as parsed, and validated, and the description that they give."""
    toml = with_structure_file(read_toml(path), path)
    return toml, *describe_trial(toml, str(path))


def open_trial(path: str | Path) -> Trial:
    """Open a trial directory; its measurements are read when they are iterated.

    Raises:
        InputError: when there is no trial.toml, or it does not describe a trial.
    """
    path = Path(path)
    if path.is_file():
        raise InputError(f"{path}: expected a trial directory, got a file")
    if (path / RUN_FILE).is_file() and not (path / "trial.toml").exists():
        raise InputError(f"{path}: expected a trial directory, got a result")
    toml, table, description = _described(path / "trial.toml")
    name = printable(table.name or path.resolve().name)
    trial = Trial(path=path, name=name, description=description, table=table, toml=toml)
    for name in trial.files():
        if not (path / name).exists():
            raise InputError(f"{path / name}: no such file")
    return trial
