"""Writing files and directories completely or not at all.

New files are first written to a hidden directory beside their destination, then flushed to the disk, then renamed into
place. The directory is on the same file system, so that renaming is a single step. Nobody else may enter it; the modes
of what is written follow the umask. A run that is killed leaves the hidden directory, which the next run removes.
"""

import errno
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..models.values.errors import InputError
from .input_files import real_path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

WRITTEN_NAMES = frozenset(
    [
        *("run.toml", "shape.csv", "ellipsoids.csv", "lengths.csv", "status.csv", "other_shape.csv"),
        *("sensor_drift.csv", "estimated_loads.csv", "contacts.csv", "track.csv", "slips.csv", "latency.csv"),
        "evaluation.json",
        *("lengths.png", "shape.png", "sensor_drift.png", "track.png", "heights.png", "errors.png", "loads.png"),
        *("lengths.pdf", "shape.pdf", "sensor_drift.pdf", "track.pdf"),
        *("curves.png", "losses.png", "predictions.png", "sweep.png"),
    ]
)
"""Names of the files that commands write into directories of results; others in them are the user's, and stay there."""
SIMULATED = re.compile(
    r"(trial|simulation)\.toml|(truth|loads|contacts)\.csv|(board|imu|ranges|positions|natural_length)\d+\.csv"
)
"""Names of the files that `simulate` writes into the directory of a trial; others in it are the user's, too."""
SIMULATION_FILE = "simulation.toml"
"""File in a trial directory that tells what it was simulated from; a trial without it is never replaced."""
DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of the system that only writing can cause."""


@contextmanager
def written_whole(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Give a temporary path of the same name for each path; all are moved into place if the block succeeds.

    If moving one of them fails, everything that stood at the paths before is moved back. Directories above them that
    were made for them are removed again where nothing is written.

    Args:
        paths: of files or directories in one parent directory, in the order in which they are moved into place. What
            stands there is replaced, so `check_vacant` or `check_replaceable` must be called before.

    Raises:
        InputError: when a pipe or a device stands at one of the paths, the disk is full, or the paths cannot be
            created, flushed or moved. Other errors of the block are passed on as they are.
    """
    # A link stays a link, and what is written has the link's name, whose end tells its format. This gives `.` a name.
    places = {os.path.basename(os.path.abspath(path)): Path(os.path.realpath(path)) for path in paths}
    first = next(iter(places.values()))
    aside = first.with_name(f".{first.name}-{secrets.token_hex(4)}")
    for path in paths:  # what stands there is copied first, and a device may be read for ever
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise InputError(f"{path}: exists and is neither a file nor a directory: expected a new name")
    with _cannot_be_written(paths[-1]):
        _remove_left_over(places)
        missing = [parent for parent in aside.parents if not parent.exists()]
        aside.parent.mkdir(parents=True, exist_ok=True)
        aside.mkdir(mode=0o700)
    lock: int | None = None
    try:
        with _cannot_be_written(paths[-1]):
            lock = _locked(aside)
        written = tuple(aside / name for name in places)
        try:
            yield written
        except OSError as error:
            if error.errno not in DISK_FULL:
                raise
            raise InputError(f"{paths[-1]}: cannot be written: {error.strerror}") from error
        with _cannot_be_written(paths[-1]):
            for inside in written:
                _sync_all(inside)
            _move(written, list(places.values()))
            _sync(aside.parent)
    finally:
        try:
            if lock is not None:
                os.close(lock)  # first: removing a directory needs a descriptor, and there may be no other one
        finally:
            remove_directory(aside)
            for parent in missing:
                with suppress(OSError):  # it holds what was written
                    parent.rmdir()


def _remove_left_over(places: Mapping[str, Path]) -> None:
    """Remove the hidden directories of runs that were killed; what they had moved aside is moved back.

    Args:
        places: where what is written goes, by the names that it has in a hidden directory.
    """
    first = next(iter(places.values()))
    parent = first.parent
    own = re.compile(rf"\.{re.escape(first.name)}-[0-9a-f]{{8}}(-earlier)?")
    for aside in [path for path in parent.iterdir() if own.fullmatch(path.name)] if parent.is_dir() else ():
        if _in_use(aside.with_name(aside.name.removesuffix("-earlier"))):
            continue
        for name, place in places.items() if aside.name.endswith("-earlier") else ():
            if (aside / name).exists() and not place.exists():
                (aside / name).rename(place)
            _keep_others(aside / name, place)
        remove_directory(aside)


def remove_directory(directory: Path) -> None:
    """Remove a directory as far as that is possible, with one descriptor, where `rmtree` needs several."""
    with suppress(OSError):
        for path in sorted(directory.rglob("*"), reverse=True):  # what is in a directory before it
            with suppress(OSError):
                if path.is_dir() and not path.is_symlink():
                    path.rmdir()
                else:
                    path.unlink()
        directory.rmdir()


def _locked(directory: Path) -> int | None:
    """Lock a directory until its descriptor is closed or the process ends, however it ends; None without locks."""
    if fcntl is None:
        return None
    descriptor = os.open(directory, os.O_RDONLY)
    with suppress(OSError):  # some network file systems have no locks
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return descriptor


def _in_use(directory: Path) -> bool:
    """Return whether a process has locked a directory, or that cannot be known."""
    if fcntl is None or not directory.exists():
        return fcntl is None
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def check_vacant(path: Path) -> None:
    """Check, before any work, that nothing stands at a path and that it can be written.

    Raises:
        InputError: when something stands at `path`, or its directory cannot be written to.
    """
    if path.exists():
        raise InputError(f"{path}: exists: expected a new name")
    check_writable(path)


def check_replaceable(path: Path, markers: tuple[str, ...]) -> None:
    """Check, before any work, that a path is vacant or holds an earlier result, and that it can be written.

    Args:
        path: of a directory of results.
        markers: names of files that every earlier result of the same kind contains.

    Raises:
        InputError: when something else stands at `path`, it contains the working directory or is a mount point, or it
            or its directory cannot be written to.
    """
    is_earlier = all((path / marker).is_file() for marker in markers)
    if path.exists() and not (is_earlier or (path.is_dir() and not any(path.iterdir()))):
        known = " and ".join(markers)
        raise InputError(f"{path}: exists and is no earlier result: expected a new name, or a directory with {known}")
    if Path.cwd().is_relative_to(real_path(path)):  # a shell would stay in the directory that is moved away
        raise InputError(f"{path}: is the working directory, or contains it: expected another place")
    if path.is_mount():
        raise InputError(f"{path}: is a mount point, which cannot be replaced: expected a directory in it")
    if path.is_dir() and not os.access(path, os.W_OK):  # or it cannot be moved away
        raise InputError(f"{path}: cannot be written: no permission to write in it")
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
    with _cannot_be_written(path), suppress(FileNotFoundError):  # a link to itself, or too long a name
        path.stat()


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
                kept = earlier / inside.name
                if place.is_dir():
                    place.rename(kept)
                    undo.callback(kept.rename, place)
                elif place.exists():  # copied, so that at every moment there is a file
                    shutil.copy2(place, kept)
                    undo.callback(kept.unlink, missing_ok=True)
                _put(inside, place)
                if kept.is_file():
                    undo.callback(kept.replace, place)
                undo.callback(place.rename, inside)
            undo.pop_all()
        for inside, place in zip(written, places, strict=True):
            _keep_others(earlier / inside.name, place)
        remove_directory(earlier)
    finally:
        with suppress(OSError):
            earlier.rmdir()


def _put(inside: Path, place: Path) -> None:
    """Move a file or a directory into place.

    Raises:
        InputError: when the place is on another file system, to which nothing can be moved in one step.
    """
    try:
        inside.replace(place)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        expected = f"expected a link within that of {inside.parent.parent}, or no link"
        raise InputError(f"{place}: cannot be written through a link of another file system: {expected}") from error


def _keep_others(earlier: Path, place: Path) -> None:
    """Move what no command has written from an earlier directory, if it is one, into the one that replaces it."""
    if not earlier.is_dir():
        return
    is_simulated = (earlier / SIMULATION_FILE).is_file()
    for path in sorted(earlier.iterdir()):
        is_ours = SIMULATED.fullmatch(path.name) if is_simulated else path.name in WRITTEN_NAMES
        if not is_ours and not (place / path.name).exists():
            path.rename(place / path.name)


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
