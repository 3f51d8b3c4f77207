"""Lengths of tendons from a file of another kind, as the reader of another package reads it.

A reader is a function `read(path, tendons)` of the path of the file and the numbers of the tendons that have a sensor.
It returns rows: t_s, the length of each of these tendons in metres (nan where it is not told), and after them, if it
knows them, their standard deviations in metres. Its entry point, of the group `tensegraph.readers`, has the name of the
suffix without its dot.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ...models.plug_ins import PlugIn, errors_of_plug_in, plug_ins
from ...models.values.errors import InputError
from .lengths_bag import SUFFIXES_OF_BAGS, is_bag

Reader = Callable[[Path, Sequence[int]], Iterable[Sequence[float]]]
OWN_SUFFIXES = ("csv", *(suffix.removeprefix(".") for suffix in SUFFIXES_OF_BAGS))


def reader_of(path: Path) -> PlugIn | None:
    """Return the plug-in that reads files with the suffix of a path; None where none does.

    Raises:
        InputError: when two packages bring one.
    """
    return None if is_bag(path) else plug_ins("readers", OWN_SUFFIXES).get(path.suffix.removeprefix("."))


class ReadLengths:
    """The rows of a file as a reader reads them.

    Raises:
        InputError: for a reader that cannot be imported, a file that it cannot read, or a row of another form; the text
            names file, row and reader.
    """

    def __init__(self, path: Path, plug_in: PlugIn, tendons: Sequence[int]) -> None:
        self.path = path
        self._plug_in = plug_in
        self._tendons = tendons
        self._read: Reader = plug_in.load()

    def place(self, index: int) -> str:
        """Return where a row is, the first of which has the index 0."""
        return f"{self.path}: row {index + 1}"

    def __iter__(self) -> Iterator[list[float]]:
        index = 0
        with errors_of_plug_in(lambda: f"{self.path}: after row {index}: {self._plug_in} cannot read it"):
            for index, row in enumerate(self._read(self.path, self._tendons)):
                yield self._checked(np.asarray(row, dtype=np.float64), index)

    def _checked(self, row: np.ndarray, index: int) -> list[float]:
        count = len(self._tendons)
        if row.shape not in ((1 + count,), (1 + 2 * count,)):
            expected = f"t_s and {count} lengths, with or without {count} sigmas"
            raise InputError(f"{self.place(index)}: expected {expected}, got {row.size} numbers from {self._plug_in}")
        if not np.isfinite(row[0]) or np.isinf(row).any():
            raise InputError(f"{self.place(index)}: expected a finite t_s, and no inf, from {self._plug_in}")
        return [float(value) for value in row]
