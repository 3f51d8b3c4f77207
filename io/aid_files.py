"""The files of what a robot carries beside its strips: inertial sensors, ranges, positions, and motors."""

from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..models.trial_description import TrialDescription
from ..models.values.aids import DECIMALS, ImuReading, PositionReading, RangeReading
from ..models.values.errors import InputError
from ..models.values.readings import NaturalLengthReading, OtherReading
from ..models.values.units import OTHER_UNIT
from .csv import FIRST_ROWS, CsvFile, in_seconds

IMU_COLUMNS = ("t_s", "gx_rad_per_s", "gy_rad_per_s", "gz_rad_per_s", "ax_m_per_s2", "ay_m_per_s2", "az_m_per_s2")
RANGE_COLUMNS = ("t_s", "beacon", "node", "range_m")
POSITION_COLUMNS = ("t_s", "node", "x_m", "y_m", "z_m")
MOTOR_COLUMNS = ("t_s", "tendon", "natural_length_m", "sigma_m")
AID_COLUMNS = {"imu": IMU_COLUMNS, "range": RANGE_COLUMNS, "position": POSITION_COLUMNS, "motor": MOTOR_COLUMNS}
"""The columns of each kind of file."""
WOUND_UP = 0.9
"""Natural length of a tendon that a motor has wound up before the first row, over that at rest, at least."""


def imu_readings(file: CsvFile, imu: int) -> Iterator[ImuReading]:
    """Yield the samples of one inertial sensor, from a file with `IMU_COLUMNS`.

    Raises:
        InputError: at the first row that cannot be read, or whose stamp is not later than the last; and for stamps in
            another unit.
    """
    for t_s, *values in in_seconds((row for _, row in _forward(file)), file.path):
        yield ImuReading(imu, t_s, np.array(values[:3]), np.array(values[3:]))


def range_readings(file: CsvFile, recording: int, trial: TrialDescription) -> Iterator[RangeReading]:
    """Yield the ranges of one recording, from a file with `RANGE_COLUMNS`.

    Raises:
        InputError: see `imu_readings`; and for a beacon or a node that does not exist, or a range that is not positive.
    """
    beacon_position_m = trial.beacon_position_m[recording]
    for row, (t_s, beacon, node, range_m) in _forward(file, strictly=False):
        here = f"{file.path}: row {row}"
        _check_number(here, "beacon", beacon, len(beacon_position_m))
        _check_number(here, "node", node, trial.structure.node_count)
        if range_m <= 0:
            raise InputError(f"{here}, column range_m: expected a positive distance, got {range_m}")
        yield RangeReading(t_s, beacon_position_m[int(beacon)], (recording, int(beacon), int(node)), range_m)


def position_readings(file: CsvFile, recording: int, trial: TrialDescription) -> Iterator[PositionReading]:
    """Yield the positions of one recording, from a file with `POSITION_COLUMNS`.

    Raises:
        InputError: see `imu_readings`; and for a node that does not exist.
    """
    for row, (t_s, node, *position_m) in _forward(file, strictly=False):
        _check_number(f"{file.path}: row {row}", "node", node, trial.structure.node_count)
        yield PositionReading(t_s, int(node), np.array(position_m), recording)


def natural_length_readings(file: CsvFile, recording: int, trial: TrialDescription) -> Iterator[NaturalLengthReading]:
    """Yield the natural lengths of one recording, from a file with `MOTOR_COLUMNS`.

    Raises:
        InputError: see `imu_readings`, where stamps count for each tendon; for a tendon that the recording's table does
            not name, for a length or a sigma that is not positive, and for lengths in another unit.
    """
    readings = _natural_lengths(file, trial.motors[recording].tendons)
    return _in_metres(readings, trial.structure.natural_length_m, file.path)


def _natural_lengths(file: CsvFile, tendons: Sequence[int]) -> Iterator[NaturalLengthReading]:
    latest_s: dict[int, float] = {}
    for row, (t_s, tendon, *values) in _forward(file, strictly=False):
        here = f"{file.path}: row {row}"
        if tendon not in tendons:
            expected = ", ".join(map(str, tendons))
            raise InputError(f"{here}, column tendon: expected one of {expected}, as trial.toml says, got {tendon:g}")
        if t_s == latest_s.get(int(tendon)):
            raise InputError(f"{here}, column t_s: expected a stamp later than {t_s}, the last of tendon {tendon:g}")
        for name, value in zip(MOTOR_COLUMNS[2:], values, strict=True):
            if value <= 0:
                raise InputError(f"{here}, column {name}: expected a positive number, got {value}")
        latest_s[int(tendon)] = t_s
        yield NaturalLengthReading(t_s, int(tendon), *values)


def _in_metres(
    readings: Iterator[NaturalLengthReading], natural_length_m: NDArray[np.float64], path: Path
) -> Iterator[NaturalLengthReading]:
    """Return natural lengths, whose zero may be any, but not so far away as another unit makes it look.

    Args:
        readings: of the file.
        natural_length_m: (tendons,) at rest.
        path: of the file, for the error text.

    Raises:
        InputError: when the first `FIRST_ROWS` rows are all about `OTHER_UNIT` times as long as at rest, or more.
    """
    first = list(islice(readings, FIRST_ROWS))
    if first and all(row.natural_length_m >= WOUND_UP * OTHER_UNIT * natural_length_m[row.tendon] for row in first):
        raise InputError(
            f"{path}: column natural_length_m: expected lengths like that of tendon {first[0].tendon} at rest, "
            f"{natural_length_m[first[0].tendon]:.3g} m, got {first[0].natural_length_m:.3g} m: is the unit right?"
        )
    return chain(first, readings)


def aid_row(reading: OtherReading) -> str:
    """Return the row of a reading in the file of its sensor, without the line's end."""
    match reading:
        case ImuReading():
            values = [*reading.rate_rad_per_s, *reading.specific_force_m_per_s2]
            cells = [f"{value:.{DECIMALS}f}" for value in values]
        case RangeReading():
            cells = [str(reading.pair[1]), str(reading.node), f"{reading.range_m:.3f}"]
        case NaturalLengthReading():
            cells = [str(reading.tendon), f"{reading.natural_length_m:.5f}", f"{reading.sigma_m:.6g}"]
        case PositionReading():
            cells = [str(reading.node), *(f"{value:.5f}" for value in reading.position_m)]
    stamp = f"{reading.t_s:.6f}".removesuffix("00")  # as it is told, to a microsecond: two stamps stay two
    return ",".join([stamp, *cells])


def _forward(file: CsvFile, *, strictly: bool = True) -> Iterator[tuple[int, list[float]]]:
    """Yield the number and the values of each row, whose stamps must increase, or at least not go back."""
    latest_s = -np.inf
    for row, values in enumerate(file, start=file.head().first_row):
        if values[0] < latest_s or (strictly and values[0] == latest_s):
            word = "later than" if strictly else "not before"
            raise InputError(f"{file.path}: row {row}, column t_s: expected a stamp {word} {latest_s}, got {values[0]}")
        latest_s = values[0]
        yield row, values


def _check_number(here: str, name: str, value: float, count: int) -> None:
    if value != int(value) or not 0 <= value < count:
        raise InputError(f"{here}, column {name}: expected an integer from 0 to {count - 1}, got {value:g}")
