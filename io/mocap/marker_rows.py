"""Tables of marker positions in text: their cells, their lengths' unit, and errors that name row and column."""

import csv
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...models.values.errors import InputError, reason_of
from ...models.values.tracks import MarkerTracks
from ...models.values.units import LARGEST, beyond
from ..input_files import check_regular, lines_of

METRES = {"m": 1.0, "meters": 1.0, "cm": 0.01, "centimeters": 0.01, "mm": 0.001, "millimeters": 0.001}
"""Length of each unit that the programs write."""

LONGEST_FRAME_S = 1.0
"""Longest mean time between two frames: no motion capture is as slow."""


@dataclass(frozen=True, slots=True)
class MarkerColumns:
    """One marker of a table."""

    name: str
    xyz: tuple[int, int, int]
    """Columns of its coordinates, counted from 0."""


def read_cells(path: Path, delimiter: str) -> list[list[str]]:
    """Return the cells of each line of a file, without blanks around them.

    Raises:
        InputError: for a file that cannot be read.
    """
    check_regular(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [[cell.strip() for cell in row] for row in csv.reader(lines_of(file, path), delimiter=delimiter)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {reason_of(error)}") from error
    if rows and len(rows[0]) == 1 and ";" in rows[0][0]:
        raise InputError(f"{path}: row 1: expected commas between cells, got semicolons")
    return rows


def metres_per(unit: str, where: str) -> float:
    """Return the length of a unit.

    Raises:
        InputError: for a unit that is none.
    """
    if unit.lower() not in METRES:
        raise InputError(f"{where}: expected a unit of length, {', '.join(METRES)}, got '{unit}'")
    return METRES[unit.lower()]


def positive_number(cell: str, where: str) -> float:
    """Return a number above zero, such as a rate.

    Raises:
        InputError: for a cell that is none.
    """
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"{where}: expected a number above 0, got '{cell}'")
    return value


@dataclass(frozen=True, slots=True)
class MarkerRows:
    """The rows of a table of positions, below its header."""

    path: Path
    rows: Sequence[Sequence[str]]
    """Cells of each row; a row may have blank cells more than the header."""
    first_row: int
    """Number of the first of them in the file, counted from 1."""
    width: int
    """Number of columns."""
    markers: Sequence[MarkerColumns]
    metres: float
    """Length of one unit of the positions."""

    def tracks(self, time_column: int | None, seconds: float = 1.0, first: float = 0.0) -> MarkerTracks:
        """Return the positions; nan where a cell is blank.

        Args:
            time_column: column of the times, or of the numbers of the frames; None where rows follow each other at one
                rate.
            seconds: what one unit of this column lasts, or the time from row to row.
            first: value of this column at time zero.

        Raises:
            InputError: for no marker, fewer than two rows, a wrong number of cells, a cell that is no number, or a time
                that is not later than the one before.
        """
        if not self.markers:
            raise InputError(f"{self.path}: row {self.first_row - 1}: holds no marker with columns X, Y, Z")
        if len(self.rows) < 2:
            raise InputError(f"{self.path}: expected at least two rows of positions, got {len(self.rows)}")
        columns = np.array([marker.xyz for marker in self.markers])
        t_s, position_m = np.empty(len(self.rows)), np.empty((len(self.rows), *columns.shape))
        for index, row in enumerate(self.rows):
            self._check_width(row, index)
            count = index if time_column is None else self._number(row, index, time_column, blank=False)
            t_s[index] = seconds * (count - first)
            position_m[index] = [[self._number(row, index, column) for column in xyz] for xyz in columns.tolist()]
        if time_column is not None:
            self._check_rising(t_s, time_column)
        return marker_tracks(self.path, t_s, [marker.name for marker in self.markers], self.metres * position_m)

    def _check_rising(self, t_s: NDArray[np.float64], time_column: int) -> None:
        for index in np.flatnonzero(np.diff(t_s) <= 0)[:1]:
            here = self._here(index + 1, time_column)
            got = self.rows[index + 1][time_column]
            raise InputError(f"{here}: expected more than {self.rows[index][time_column]}, got {got}")

    def _check_width(self, row: Sequence[str], index: int) -> None:
        if len(row) < self.width or any(row[self.width :]):
            raise InputError(f"{self.path}: row {self.first_row + index}: expected {self.width} cells, got {len(row)}")

    def _number(self, row: Sequence[str], index: int, column: int, *, blank: bool = True) -> float:
        cell = row[column]
        try:
            value = float(cell) if cell or not blank else math.nan
        except ValueError:
            value = math.inf
        if math.isfinite(value) or (blank and math.isnan(value)):
            return value
        raise InputError(f"{self._here(index, column)}: expected a finite number, got '{cell}'")

    def _here(self, index: int, column: int) -> str:
        return f"{self.path}: row {self.first_row + index}, column {column + 1}"


def marker_tracks(
    path: Path, t_s: NDArray[np.float64], names: Sequence[str], position_m: NDArray[np.float64]
) -> MarkerTracks:
    """Return (times, markers, 3) positions of markers at increasing times, of whatever names.

    Programs write a marker that was hidden as 0, 0, 0, too: it is nan where the marker is elsewhere in other frames.

    Raises:
        InputError: for times or positions that are in another unit.
    """
    check_frames(path, t_s)
    at_zero = (position_m == 0).all(axis=-1)
    is_elsewhere = (np.isfinite(position_m).all(axis=-1) & ~at_zero).any(axis=0)
    position_m = np.where((at_zero & is_elsewhere)[..., None], np.nan, position_m)
    most_m = np.nanmax(np.abs(position_m), initial=0.0)
    if most_m > LARGEST["m"]:
        raise InputError(f"{path}: positions in metres: {beyond(float(most_m), LARGEST['m'])}")
    return MarkerTracks(t_s, different_names(names), position_m)


def check_frames(path: Path, t_s: NDArray[np.float64]) -> None:
    """Check that (times,) frames are so close that positions between them are known.

    Raises:
        InputError: for times that are in another unit.
    """
    step_s = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
    if step_s > LONGEST_FRAME_S or abs(t_s[0]) > LARGEST["s"]:
        got = f"{step_s:.3g} s from {t_s[0]:.3g} s on"
        raise InputError(f"{path}: expected frames at most {LONGEST_FRAME_S:g} s apart, got {got}: is the unit right?")


def different_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that all differ: a second marker of one name has (2) behind it, and so on."""
    seen = Counter[str]()
    different = []
    for name in names:
        seen[name] += 1
        different.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(different)


def coordinate_columns(axes: Sequence[str], names: Sequence[str]) -> list[MarkerColumns]:
    """Return the markers of the columns X, Y, Z that stand side by side.

    Args:
        axes: the axis of each column, such as X; those of other quantities differ.
        names: the marker of each column, or blank beside the first of the three.
    """
    return [
        MarkerColumns(names[column], (column, column + 1, column + 2))
        for column in range(min(len(axes) - 2, len(names)))
        if list(axes[column : column + 3]) == ["X", "Y", "Z"] and names[column]
    ]
