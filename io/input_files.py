"""Input files before they are opened: a file that never ends, or waits for ever, is refused."""

import os
import stat
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import TextIO

from ..models.values.errors import InputError, reason_of

LONGEST_LINE = 1 << 20
"""Number of characters of a line above which a file is not read on; a row of a thousand numbers has 20 000."""
LARGEST_TOML_BYTES = 1 << 20
"""Size above which a TOML or YAML file is not read, as its keys may take seconds; they have some kilobytes."""
BAGS_BEGIN = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
"""How the files of bags begin, by the ends of their names."""


def real_path(path: Path) -> Path:
    """Return where a path leads, as `Path.resolve`, which before Python 3.13 raises RuntimeError at a loop of links."""
    return Path(os.path.realpath(path))


def check_regular(path: Path, largest_bytes: int | None = None) -> None:
    """Check that a path leads to a regular file; opening a pipe would wait for ever, reading a device may never end.

    Args:
        path: of a file to read.
        largest_bytes: its largest size; None if it is read in parts.

    Raises:
        InputError: when there is no file, or another kind of one, or a larger one.
    """
    try:
        found = path.stat()
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:  # a ValueError for a name with a zero byte
        raise InputError(f"{path}: cannot be read: {reason_of(error)}") from error
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: expected a file, got {_kind(found.st_mode)}")
    if largest_bytes is not None and found.st_size > largest_bytes:
        raise InputError(f"{path}: expected at most {largest_bytes >> 20} MiB, got {found.st_size >> 20} MiB")


def lines_of(file: TextIO, path: Path) -> Iterator[str]:
    """Yield the lines of an open file, each with its end.

    Raises:
        InputError: for a line that is too long to be one, and for a file that the system cannot read.
    """
    for row in count(1):
        try:
            line = file.readline(LONGEST_LINE + 1)
        except OSError as error:
            raise InputError(f"{path}: row {row}: cannot be read: {reason_of(error)}") from error
        if not line:
            return
        if len(line) > LONGEST_LINE:
            raise InputError(f"{path}: row {row}: expected at most {LONGEST_LINE} characters in a line")
        yield line


def check_beginning(path: Path) -> None:
    """Check that a file begins as its name says, before all of it is read for another purpose than its contents.

    Raises:
        InputError: for a table without a first line, see `lines_of`, and a file of a bag that is none.
    """
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", errors="replace", newline="") as file:
            next(lines_of(file, path), None)
    if begins := BAGS_BEGIN.get(path.suffix):
        with path.open("rb") as bag:
            if bag.read(len(begins)) != begins:
                raise InputError(f"{path}: cannot be read as a bag: it does not begin as one")


def line_count(path: Path) -> int:
    """Return about how many lines of a file have ended, by whichever line end; it is read in parts."""
    with path.open("rb") as file:
        parts = iter(lambda: file.read(LONGEST_LINE), b"")
        return sum(max(part.count(b"\n"), part.count(b"\r")) for part in parts)


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a directory"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device or a socket"
