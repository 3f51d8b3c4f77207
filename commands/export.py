"""`export`: writes a result in the format of another program."""

import os
from pathlib import Path
from typing import Any

from ..io.exports.formats import all_suffixes, check_file, export, format_of, paths_of
from ..io.reports.terminal import Terminal
from ..io.stored_result import load, read_run, settings_of
from ..models.values.errors import InputError


def export_result(path: Path, *, to: str | None, out: Path | None, at_s: float | None, terminal: Terminal) -> None:
    """Write a result in another format.

    Args:
        path: result directory.
        to: format; that of the suffix of `out` if None.
        out: path of the file; beside the result, with its name, if None.
        at_s: time of the frame, for the formats of one frame.
        terminal: for the paths of the files.

    Raises:
        InputError: see `export`; and when neither format nor path is given, or they do not agree.
    """
    run = read_run(path)
    out = _destination(path, to, out)
    for place in paths_of(out, format_of(out)):
        check_file(place)
    with terminal.stage(f"reading {path}"):
        result = load(path)
    settings = settings_of(run, path)
    with terminal.stage(f"writing {out}"):
        written = export(result, out, at_s=at_s, probability=settings.probability, about=_origin(run))
    for place in written:
        terminal.written(f"written to {place}")


def _destination(path: Path, to: str | None, out: Path | None) -> Path:
    suffixes = all_suffixes()
    if to is None and out is None:
        raise InputError(f"expected --to with one of {', '.join(suffixes)}, or --out with a name that ends like one")
    if to is not None and to not in suffixes:
        raise InputError(f"--to {to}: expected one of {', '.join(suffixes)}")
    if out is None:
        beside = path.parent if path.name not in ("", "..") else Path(os.path.abspath(path)).parent
        return beside / f"{path.resolve().name}{suffixes[str(to)]}"
    if to is not None and format_of(out) != to:
        raise InputError(f"--out {out}: expected a name that ends in {suffixes[to]} for --to {to}")
    return out


def _origin(run: dict[str, Any]) -> dict[str, str]:
    """Return what run.toml says of the trial, the method and the version, as far as it does."""
    origin = {name: str(run[name]) for name in ("trial", "method") if name in run}
    version = run.get("versions", {}).get("tensegraph")
    return origin | ({"tensegraph": str(version)} if version else {})
