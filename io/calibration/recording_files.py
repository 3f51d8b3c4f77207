"""Calibration recordings: a folder of CSV files, each of one sensor on a test rig."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from ...models.calibration.recordings import Recording
from ...models.calibration.strip_rig import RESISTANCE_OHM, TIME_S, StripRig
from ...models.sensor.stretching import SETTLING_S
from ...models.values.errors import InputError
from ...models.values.units import OTHER_UNIT
from ..csv import CsvFile
from ..provenance import sha256_of
from ..toml import read_as

MOST_STRAIN = 5.0
"""Strain beyond that of every rubber strip, as of one that is told in per cent."""
FEWEST_ROWS = 5
"""Least number of rows in the first 10 s of a recording, in which its strip is tared."""
LONGEST_PAUSE_S = 60.0
"""Longest time between two rows, over which strain is interpolated: pauses of 30 s change nothing, one of half an hour
made the curve of rates twice as wrong."""
BURST_SHARE = 0.1
"""Share of the steps between stamps that are short in a recording whose stamps come in bursts."""
BURST_RATIO = 0.1
"""Ratio of a short step to the mean one; at the rig of `examples/cb_silicone_rig.toml` it is 0.7."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordingFolder:
    """The contents of a folder of recordings."""

    recordings: list[Recording]
    """The usable recordings, sorted by name."""
    sha256: dict[str, str]
    """SHA-256 of the file of each recording, by file name."""
    left_out: list[str]
    """One line for each file that cannot be used: which, where and why."""


def read_rig(path: Path | None) -> StripRig:
    """Return the rig described in a TOML file, or the default; see `read_as`."""
    return read_as(StripRig, path, "is no key of a rig: expected columns, units, gauge_length_mm, ...")


def rig_text(rig: StripRig) -> str:
    """Return the TOML text from which `read_rig` reads the same rig."""
    return tomli_w.dumps(asdict(rig, dict_factory=lambda pairs: {k: v for k, v in pairs if v is not None}))


def read_recordings(folder: Path, rig: StripRig) -> RecordingFolder:
    """Return all recordings of a folder, and why the others cannot be used.

    Raises:
        InputError: when the folder has no usable recording.
    """
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".csv") if folder.is_dir() else []
    if not paths:
        raise InputError(f"{folder}: holds no recordings: expected files *.csv")
    found = RecordingFolder([], {}, [])
    for path in paths:
        try:
            found.recordings.append(read_recording(path, rig))
            found.sha256[path.name] = sha256_of(path)
        except InputError as error:
            found.left_out.append(str(error))
    if not found.recordings:
        others = f" (and {len(paths) - 1} more)" if len(paths) > 1 else ""
        raise InputError(f"{found.left_out[0]}{others}")
    return found


def read_recording(path: Path, rig: StripRig) -> Recording:
    """Return one recording.

    Strain is interpolated to the stamps of the resistance, where both are known.

    Raises:
        InputError: when the file does not have the form that the rig describes, its stamps do not increase, or it is
            too short.
    """
    file = CsvFile(path, [str(name) for name in rig.needed_columns], numbered=rig.numbered)
    head = file.head()
    header_ohm = _header_resistance(path, head.pairs) if rig.natural_resistance_ohm == "header" else None
    rows = _rows_in_time(file, head.first_row)
    t_s = rows[:, 0] * TIME_S[rig.units.time]
    strain_t_s = rows[:, 2] * TIME_S[rig.units.time]
    resistance_ohm = _running_mean(np.abs(rows[:, 1]), rig.average) * RESISTANCE_OHM[rig.units.resistance]
    for row in np.flatnonzero(resistance_ohm <= 0):
        raise InputError(
            f"{path}: row {row + head.first_row}, column {file.columns[1]}: expected a resistance above zero, got 0"
        )
    strain = np.interp(t_s, strain_t_s, rows[:, 3] * rig.strain_scale)
    both = (t_s >= strain_t_s[0]) & (t_s <= strain_t_s[-1])
    duration_s = float(np.ptp(t_s[both])) if both.any() else 0.0
    if duration_s < 3 * SETTLING_S:
        raise InputError(f"{path}: expected at least {3 * SETTLING_S:g} s of resistance and strain, got {duration_s:g}")
    t_s = t_s[both]
    _check_stamps(path, t_s)
    strain = strain[both]
    if (most := np.abs(strain).max()) > MOST_STRAIN:
        raise InputError(f"{path}: expected strain up to {MOST_STRAIN:g}, got {most:g}: is the unit right?")
    resistance_ohm = resistance_ohm[both]
    if np.ptp(resistance_ohm) == 0:
        where = f"{path}: column {file.columns[1]}"
        raise InputError(f"{where}: expected a resistance that changes, got {resistance_ohm[0]:g} ohm in all rows")
    natural_ohm = header_ohm or rig.natural_resistance_ohm
    if natural_ohm == "start":
        natural_ohm = float(np.mean(resistance_ohm[t_s - t_s[0] <= 1.0]))
    assert not isinstance(natural_ohm, str)
    times = float(np.median(resistance_ohm)) / natural_ohm
    if not 1 / OTHER_UNIT < times < OTHER_UNIT:
        raise InputError(
            f"{path}: column {file.columns[1]}: expected about the natural resistance of {natural_ohm:g} ohm, got "
            f"{times:.3g} times that: is the unit right?"
        )
    change = resistance_ohm / natural_ohm - 1
    return Recording(path.stem, t_s, np.abs(strain) if rig.magnitude else strain, change)


def _rows_in_time(file: CsvFile, first_row: int) -> NDArray[np.float64]:
    """Return (rows, 4): time and resistance, time and strain, both times increasing.

    Args:
        file: of a recording.
        first_row: the number of its first row of values, for errors.
    """
    rows = np.array(list(file))
    if len(rows) < 2:
        raise InputError(f"{file.path}: expected at least two rows, got {len(rows)}")
    for column in (0, 2):
        for row in np.flatnonzero(np.diff(rows[:, column]) <= 0)[:1]:
            where = f"{file.path}: row {row + 1 + first_row}, column {file.columns[column]}"
            raise InputError(f"{where}: expected a later stamp than {rows[row, column]}, got {rows[row + 1, column]}")
    return rows


def _check_stamps(path: Path, t_s: NDArray[np.float64]) -> None:
    """Raise InputError for hardly any rows at the start, or stamps in bursts, as of a computer that reads a buffer."""
    at_start = int((t_s - t_s[0] < SETTLING_S).sum())
    if at_start < FEWEST_ROWS:
        raise InputError(
            f"{path}: expected {FEWEST_ROWS} rows or more in the first {SETTLING_S:g} s, got {at_start}: "
            "is the unit of time right?"
        )
    steps_s = np.diff(t_s)
    for row in np.flatnonzero(steps_s > LONGEST_PAUSE_S)[:1]:
        raise InputError(
            f"{path}: expected at most {LONGEST_PAUSE_S:g} s between two rows, got {steps_s[row]:.3g} s after t = "
            f"{t_s[row]:.6g} s: make two files of it"
        )
    if np.quantile(steps_s, BURST_SHARE) < BURST_RATIO * steps_s.mean():
        raise InputError(
            f"{path}: expected stamps of when each resistance was measured, got bursts: a tenth of the steps is below "
            f"{np.quantile(steps_s, BURST_SHARE):.2g} s, their mean is {steps_s.mean():.2g} s"
        )


def _header_resistance(path: Path, pairs: dict[str, str]) -> float:
    try:
        natural_ohm = float(pairs["natural_resistance_ohm"])
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: row 1: expected '# natural_resistance_ohm = NUMBER'") from error
    if not (np.isfinite(natural_ohm) and natural_ohm > 0):
        raise InputError(f"{path}: row 1: natural_resistance_ohm: expected a number above zero, got {natural_ohm}")
    return natural_ohm


def _running_mean(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the mean of each value and the ones before it, `count` in all where there are as many."""
    total = np.cumsum(np.concatenate([[0.0], values]))
    end = np.arange(1, len(values) + 1)
    start = np.maximum(end - count, 0)
    return np.asarray((total[end] - total[start]) / (end - start))
