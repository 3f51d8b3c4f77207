"""The output directories of commands."""

from collections.abc import Sequence
from pathlib import Path

from ..io.input_files import real_path
from ..io.whole import check_replaceable
from ..models.values.errors import TensegraphError


def result_paths(
    sources: Sequence[Path], out: Path | None, default: Path, markers: tuple[str, ...], suffix: str = ""
) -> list[Path]:
    """Return the output directory of each source, after a check, before any work, that it can be written.

    Args:
        sources: directories with different names.
        out: for one source, its output directory; for several, the directory in which each gets its own.
        default: the directory in which each gets its own if `out` is None.
        markers: see `check_replaceable`.
        suffix: added to each name in `default`, so that one result does not replace another.

    Raises:
        TensegraphError: see `distinct_names` and `check_replaceable`.
    """
    names = distinct_names(sources)
    if out is None:
        paths = [default / f"{name}{suffix}" for name in names]
    else:
        paths = [out] if len(sources) == 1 else [out / name for name in names]
    for path in paths:
        check_replaceable(path, markers)
    return paths


def distinct_names(sources: Sequence[Path]) -> list[str]:
    """Return the names of directories.

    Raises:
        TensegraphError: when two are the same, because outputs are named after them.
    """
    names = [real_path(source).name for source in sources]
    for name in {name for name in names if names.count(name) > 1}:
        raise TensegraphError(f"two of these are named {name}: take them one by one, each with its --out")
    return names
