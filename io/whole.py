"""Files and directories that are there whole or not at all: written aside, on the disk, then moved into place.

What is written aside is in a hidden directory beside its place, so that a move is a renaming within one disk. All modes
follow the umask.
"""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..models.values.errors import InputError


@contextmanager
def written_whole(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Give for each path one of the same name to write to; all take their places when the block ends without an error.

    Args:
        paths: of files or directories with one parent, in the order in which they take their places. What stands
            there is replaced: `check_vacant` or `check_replaceable` come before any work.

    Raises:
        InputError: when something cannot be written.
    """
    places = [Path(os.path.abspath(path)) for path in paths]  # a name for `.` too
    aside = places[0].with_name(f".{places[0].name}-{secrets.token_hex(4)}")
    try:
        aside.mkdir(parents=True)
        written = tuple(aside / place.name for place in places)
        yield written
        for inside, place in zip(written, places, strict=True):
            _sync_all(inside)
            _replace(place, inside)
        _sync(aside.parent)
    except OSError as error:
        raise InputError(f"{paths[-1]}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def check_vacant(path: Path) -> None:
    """Refuse, before any work, to write over anything, or where nothing can be written.

    Raises:
        InputError: when something stands at `path`, or its directory cannot be written to.
    """
    if path.exists():
        raise InputError(f"{path}: exists: expected a new name for the trial")
    check_writable(path)


def check_replaceable(path: Path, marker: str) -> None:
    """Refuse, before any work, to replace anything but an earlier result, or to write where nothing can be written.

    Args:
        path: of a directory of results.
        marker: the file by which an earlier one of the same kind is known.

    Raises:
        InputError: when something else stands at `path`, or its directory cannot be written to.
    """
    if path.exists() and not (path.is_dir() and ((path / marker).is_file() or not any(path.iterdir()))):
        raise InputError(f"{path}: exists and is no earlier result: expected a new name, or a directory with {marker}")
    check_writable(path)


def check_writable(path: Path) -> None:
    """Refuse, before any work, a path that cannot be made, by the first of its parents that is there.

    Raises:
        InputError: when that one is no directory, or cannot be written to.
    """
    parent = next(parent for parent in Path(os.path.abspath(path)).parents if parent.exists())
    if not parent.is_dir():
        raise InputError(f"{path}: cannot be written: {parent} is not a directory")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: no permission to write in {parent}")


def _replace(path: Path, written: Path) -> None:
    """Move what was written into its place; an earlier one goes aside first, and is removed with it."""
    if path.is_dir():
        path.rename(written.with_name(f"{written.name}-earlier"))
    written.replace(path)


def _sync_all(path: Path) -> None:
    """Have a file, or a directory and all in it, written to the disk itself."""
    for part in path.rglob("*") if path.is_dir() else ():
        _sync(part)
    _sync(path)


def _sync(path: Path) -> None:
    if os.name == "nt" and path.is_dir():  # Windows keeps directories by itself, and opens none
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
