"""Comma-separated numbers with a header, row by row, with errors that name file, row and column."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from ..models.values.errors import InputError


@dataclass(slots=True)
class CsvFile:
    """A file of numbers; rows are counted as an editor counts lines, the header being row 1.

    Iterating gives the values of each row in the order of `columns`. A last line without an end, as a power cut leaves
    it, is left out and counted. Lines before the header that begin with # hold `name = value` pairs.

    Raises:
        InputError: for a missing file or column, a wrong number of fields, or a cell that is not a finite number.
    """

    path: Path
    columns: Sequence[str]
    """Needed columns."""
    optional: Sequence[str] = ()
    """Columns that may be absent: nan then."""
    blank: Sequence[str] = ()
    """Columns in which a cell may be blank or nan."""
    words: Mapping[str, Callable[[str], float]] = field(default_factory=dict)
    """Columns of other cells than finite numbers, each with what makes a number of one, or raises a ValueError."""
    numbered: bool = False
    """Whether the file has no header: its columns are called 1, 2, ... then."""
    half_lines: int = field(default=0, init=False)
    """Lines that were left out because they had no end."""

    def head(self) -> tuple[dict[str, str], list[str]]:
        """Return the pairs before the header, and the header."""
        pairs: dict[str, str] = {}
        try:
            with self.path.open(encoding="utf-8-sig", newline="") as file:
                for line in file:
                    if not line.startswith("#"):
                        return pairs, [name.strip() for name in line.split(",")]
                    name, _, value = line.lstrip("#").partition("=")
                    pairs[name.strip()] = value.strip()
        except FileNotFoundError as error:
            raise InputError(f"{self.path}: no such file") from error
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: cannot be read: {error}") from error
        raise InputError(f"{self.path}: is empty: expected a header with {', '.join(self.columns)}")

    def __iter__(self) -> Iterator[list[float]]:
        pairs, header = self.head()
        first = len(pairs) + (1 if self.numbered else 2)
        if self.numbered:
            header = [str(k + 1) for k in range(len(header))]
        for name in self.columns:
            if name not in header:
                row = len(pairs) + 1
                raise InputError(f"{self.path}: row {row}: column '{name}' is missing: got {', '.join(header)[:80]}")
        index = [header.index(name) if name in header else None for name in (*self.columns, *self.optional)]
        names = (*self.columns, *self.optional)
        may_be_blank = frozenset(self.blank)
        with self.path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
            for row, line in enumerate(islice(file, first - 1, None), start=first):
                if not line.endswith("\n"):
                    self.half_lines += 1
                    return
                cells = line.rstrip("\r\n").split(",")
                if len(cells) != len(header):
                    raise InputError(f"{self.path}: row {row}: expected {len(header)} fields, got {len(cells)}")
                yield [
                    math.nan if i is None else self._number(cells[i], row, name, name in may_be_blank)
                    for i, name in zip(index, names, strict=True)
                ]

    def _number(self, cell: str, row: int, column: str, may_be_blank: bool) -> float:
        if column in self.words:
            try:
                return self.words[column](cell)
            except ValueError as error:
                raise InputError(f"{self.path}: row {row}, column {column}: {error}, got '{cell.strip()}'") from error
        try:
            value = float(cell) if cell.strip() or not may_be_blank else math.nan
        except ValueError:
            value = math.inf
        if math.isfinite(value) or (may_be_blank and math.isnan(value)):
            return value
        raise InputError(f"{self.path}: row {row}, column {column}: expected a finite number, got '{cell.strip()}'")
