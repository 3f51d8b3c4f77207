"""Where what a command writes goes."""

from collections.abc import Sequence
from pathlib import Path

from ..io.whole import check_replaceable
from ..models.values.errors import TensegraphError


def result_paths(sources: Sequence[Path], out: Path | None, default: Path, marker: str) -> list[Path]:
    """Return the directory for what comes of each source; refuse, before any work, what could not be written there.

    Args:
        sources: directories, named differently.
        out: of one source, its result; of several, the directory that holds theirs.
        default: the directory that holds them if `out` is None.
        marker: see `check_replaceable`.

    Raises:
        TensegraphError: see `distinct_names` and `check_replaceable`.
    """
    names = distinct_names(sources)
    paths = [out] if out and len(sources) == 1 else [(out or default) / name for name in names]
    for path in paths:
        check_replaceable(path, marker)
    return paths


def distinct_names(sources: Sequence[Path]) -> list[str]:
    """Return the directories' names.

    Raises:
        TensegraphError: when two are alike, since what comes of them is told apart by them.
    """
    names = [source.resolve().name for source in sources]
    for name in {name for name in names if names.count(name) > 1}:
        raise TensegraphError(f"two of these are named {name}: take them one by one, each with its --out")
    return names
