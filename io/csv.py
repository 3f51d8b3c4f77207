"""Comma-separated numbers with a header, row by row, with errors that name file, row and column."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice, pairwise
from pathlib import Path

from ..models.values.errors import InputError, reason_of
from ..models.values.units import beyond, largest
from .input_files import check_regular, lines_of

INFINITE = ("inf", "+inf", "-inf")
"""Cells of an infinite value, as which MATLAB writes the resistance of an open circuit."""
LONGEST_SHOWN = 60
"""Number of characters of a cell that an error shows."""
LONGEST_READING_STEP_S = 0.5
"""Time between all of the first rows of resistance, of an inertial sensor, or of the lengths of a robot that other
sensors follow, above which stamps are not in seconds, or tell nothing: strips would begin anew with each row, see
`FrontEndSettings.settle_after_s`."""
FIRST_ROWS = 6
"""Number of these rows."""


@dataclass(frozen=True, slots=True)
class CsvHead:
    """The beginning of a CSV file."""

    pairs: dict[str, str]
    """Names and values in the comment lines before the header."""
    columns: list[str]
    """Names of the columns."""
    row: int
    """Row of the header, or of the first values if the file has no header; the first row of the file is 1."""
    first_row: int
    """Row of the first values."""


@dataclass(slots=True)
class CsvFile:
    """A file of numbers. Rows are counted like the lines in an editor: the first line of the file is row 1.

    Iterating gives the values of each row in the order of `columns`. A last line without a line end, as after a power
    cut, is left out and counted; blank lines at the end are left out. Lines before the header that begin with # hold
    `name = value` pairs.

    Raises:
        InputError: for a missing file or column, a column that stands twice, a wrong number of fields, or a cell that
            is not a finite number.
    """

    path: Path
    columns: Sequence[str]
    """Names of the columns that the file must have."""
    optional: Sequence[str] = ()
    """Names of the columns that may be absent; their values are nan then."""
    blank: Sequence[str] = ()
    """Columns in which a cell may be blank or nan."""
    words: Mapping[str, Callable[[str], float]] = field(default_factory=dict)
    """Columns whose cells are not finite numbers, each with a function that converts a cell to a number, or raises a
    ValueError."""
    infinite: Sequence[str] = ()
    """Columns in which an infinite value is a missing one."""
    numbered: bool = False
    """Whether the file has no header; its columns are then named 1, 2, ..."""
    half_lines: int = field(default=0, init=False)
    """Number of lines left out because they had no line end."""
    unused: list[str] = field(default_factory=list, init=False)
    """Names of further columns, which say nothing; known with the first row."""

    def head(self) -> CsvHead:
        """Return the comment lines and the header."""
        pairs: dict[str, str] = {}
        check_regular(self.path)
        try:
            with self.path.open(encoding="utf-8-sig", newline="") as file:
                for row, line in enumerate(lines_of(file, self.path), start=1):
                    if not line.startswith("#"):
                        names = [name.strip().strip('"') for name in line.split(",")]  # R quotes names
                        if self.numbered:
                            return CsvHead(pairs, [str(k + 1) for k in range(len(names))], row, first_row=row)
                        return CsvHead(pairs, names, row, first_row=row + 1)
                    name, _, value = line.lstrip("#").partition("=")
                    pairs[name.strip()] = value.strip()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: cannot be read: {reason_of(error)}") from error
        raise InputError(f"{self.path}: is empty: expected a header with {', '.join(self.columns)}")

    def place(self, index: int) -> str:
        """Return where a row of values is, the first of which has the index 0."""
        return f"{self.path}: row {self.head().first_row + index}"

    def __iter__(self) -> Iterator[list[float]]:
        head = self.head()
        header = head.columns
        for name in self.columns:
            if name not in header:
                got = ", ".join(header)[:80]
                if len(header) == 1 and len(self.columns) > 1:
                    raise InputError(f"{self.path}: row {head.row}: expected columns with commas between, got {got}")
                raise InputError(f"{self.path}: row {head.row}: column '{name}' is missing: got {got}")
        names = (*self.columns, *self.optional)
        for name in names:
            if header.count(name) > 1:
                raise InputError(f"{self.path}: row {head.row}: column '{name}': expected once, got it twice or more")
        self.unused = [name for name in header if name and name not in names]
        index = [header.index(name) if name in header else None for name in names]
        may_be_blank = frozenset(self.blank)
        limits = [largest(name) for name in names]
        blank_row: int | None = None
        with self.path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
            for row, line in enumerate(
                islice(lines_of(file, self.path), head.first_row - 1, None), start=head.first_row
            ):
                if not line.endswith(("\n", "\r")):
                    self.half_lines += 1
                    return
                if line.isspace() and len(header) > 1:
                    blank_row = blank_row or row
                    continue
                if blank_row:
                    raise InputError(f"{self.path}: row {blank_row}: expected {len(header)} fields, got a blank line")
                cells = line.rstrip("\r\n").split(",")
                if len(cells) != len(header):
                    hint = ": is a decimal point a comma?" if len(cells) > len(header) else ""
                    raise InputError(f"{self.path}: row {row}: expected {len(header)} fields, got {len(cells)}{hint}")
                yield [
                    math.nan if i is None else self._number(cells[i], row, name, name in may_be_blank, limit)
                    for i, name, limit in zip(index, names, limits, strict=True)
                ]

    def _number(self, cell: str, row: int, column: str, may_be_blank: bool, limit: float) -> float:
        if column in self.words:
            try:
                value = self.words[column](cell.strip().strip('"'))
            except ValueError as error:
                raise InputError(f"{self.path}: row {row}, column {column}: {error}, got '{_shown(cell)}'") from error
            if abs(value) <= limit or not math.isfinite(value):
                return value
            raise InputError(f"{self.path}: row {row}, column {column}: {beyond(value, limit)}")
        try:
            value = float(cell) if cell.strip() or not may_be_blank else math.nan
        except ValueError:
            value = math.inf
        if "_" in cell:  # 1_000 is a number to Python alone
            value = math.inf
        if abs(value) <= limit or (may_be_blank and math.isnan(value)):
            return value
        if math.isfinite(value):
            raise InputError(f"{self.path}: row {row}, column {column}: {beyond(value, limit)}")
        if column in self.infinite and cell.strip().lower() in INFINITE:
            return math.nan
        raise InputError(f"{self.path}: row {row}, column {column}: expected a finite number, got '{_shown(cell)}'")


def _shown(cell: str) -> str:
    """Return a cell as an error shows it: its beginning, where it is long."""
    text = cell.strip()
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def in_seconds(rows: Iterator[list[float]], path: Path) -> Iterator[list[float]]:
    """Return the rows of readings that come many times a second, each of which begins with its stamp.

    Args:
        rows: of the file.
        path: of the file, for the error text.

    Raises:
        InputError: where the first `FIRST_ROWS` rows are all too far apart: their stamps are in another unit.
    """
    first = list(islice(rows, FIRST_ROWS))
    step_s = min((after[0] - before[0] for before, after in pairwise(first)), default=math.inf)
    if len(first) == FIRST_ROWS and step_s > LONGEST_READING_STEP_S:
        raise InputError(
            f"{path}: column t_s: expected rows at most {LONGEST_READING_STEP_S:g} s apart, got {step_s:g} s and more "
            f"between the first {FIRST_ROWS}: is the unit right?"
        )
    return chain(first, rows)
