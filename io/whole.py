"""Writing files and directories completely or not at all.

New files are first written to a hidden directory beside their destination, then flushed to the disk, then renamed into
place. The directory is on the same file system, so that renaming is a single step. File modes follow the umask.
"""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..models.values.errors import InputError

DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of the system that only writing can cause."""


@contextmanager
def written_whole(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Give a temporary path of the same name for each path; all are moved into place if the block succeeds.

    If moving one of them fails, everything that stood at the paths before is moved back.

    Args:
        paths: of files or directories in one parent directory, in the order in which they are moved into place. What
            stands there is replaced, so `check_vacant` or `check_replaceable` must be called before.

    Raises:
        InputError: when the disk is full, or the paths cannot be created, flushed or moved. Other errors of the block
            are passed on as they are.
    """
    places = [Path(os.path.abspath(path)) for path in paths]  # gives `.` a name as well
    aside = places[0].with_name(f".{places[0].name}-{secrets.token_hex(4)}")
    with _cannot_be_written(paths[-1]):
        aside.mkdir(parents=True)
    try:
        written = tuple(aside / place.name for place in places)
        try:
            yield written
        except OSError as error:
            if error.errno not in DISK_FULL:
                raise
            raise InputError(f"{paths[-1]}: cannot be written: {error.strerror}") from error
        with _cannot_be_written(paths[-1]):
            for inside in written:
                _sync_all(inside)
            _move(written, places)
            _sync(aside.parent)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def check_vacant(path: Path) -> None:
    """Check, before any work, that nothing stands at a path and that it can be written.

    Raises:
        InputError: when something stands at `path`, or its directory cannot be written to.
    """
    if path.exists():
        raise InputError(f"{path}: exists: expected a new name for the trial")
    check_writable(path)


def check_replaceable(path: Path, marker: str) -> None:
    """Check, before any work, that a path is vacant or holds an earlier result, and that it can be written.

    Args:
        path: of a directory of results.
        marker: name of the file that every earlier result of the same kind contains.

    Raises:
        InputError: when something else stands at `path`, or its directory cannot be written to.
    """
    if path.exists() and not (path.is_dir() and ((path / marker).is_file() or not any(path.iterdir()))):
        raise InputError(f"{path}: exists and is no earlier result: expected a new name, or a directory with {marker}")
    check_writable(path)


def check_writable(path: Path) -> None:
    """Check, before any work, that a path can be created, from the nearest of its parents that exists.

    Raises:
        InputError: when that parent is not a directory, or cannot be written to.
    """
    parent = next(parent for parent in Path(os.path.abspath(path)).parents if parent.exists())
    if not parent.is_dir():
        raise InputError(f"{path}: cannot be written: {parent} is not a directory")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: no permission to write in {parent}")


@contextmanager
def _cannot_be_written(path: Path) -> Iterator[None]:
    """Turn an error of the system into an InputError that names a path."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _move(written: Sequence[Path], places: Sequence[Path]) -> None:
    """Move what was written into place; on an error, move back what stood there before.

    What stood there is kept in a second hidden directory, which stays if moving back fails too.
    """
    aside = written[0].parent
    earlier = aside.with_name(f"{aside.name}-earlier")
    earlier.mkdir()
    try:
        with ExitStack() as undo:
            for inside, place in zip(written, places, strict=True):
                kept = earlier / place.name
                if place.is_dir():
                    place.rename(kept)
                    undo.callback(kept.rename, place)
                elif place.exists():  # copied, so that at every moment there is a file
                    shutil.copy2(place, kept)
                    undo.callback(kept.replace, place)
                inside.replace(place)
                undo.callback(place.rename, inside)
            undo.pop_all()
            shutil.rmtree(earlier, ignore_errors=True)
    finally:
        with suppress(OSError):
            earlier.rmdir()


def _sync_all(path: Path) -> None:
    """Flush a file, or a directory and everything in it, to the disk."""
    for part in path.rglob("*") if path.is_dir() else ():
        _sync(part)
    _sync(path)


def _sync(path: Path) -> None:
    if os.name == "nt" and path.is_dir():  # Windows cannot open a directory, and flushes it by itself
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
