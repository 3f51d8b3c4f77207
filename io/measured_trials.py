"""What a comparison has measured on each trial: one file a trial, so that nothing that was finished is lost."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..models.evaluation.comparison import FrameErrors, Measured
from .provenance import FINGERPRINT
from .whole import written_whole

ABOUT = "about"
"""Name of the array that holds, as JSON, everything that is no array."""


def write_measured(measured: Sequence[Measured], made_from: str | None, path: Path) -> None:
    """Write what was measured on one trial, completely or not at all.

    Args:
        measured: one of each method.
        made_from: fingerprint of all that it was made from; None is never equal to another.
        path: of the file, *.npz.

    Raises:
        InputError: when it cannot be written.
    """
    methods = {m.method: {"trial": m.trial, "frames": m.frames, "seconds": m.seconds, "note": m.note} for m in measured}
    arrays: dict[str, Any] = {ABOUT: np.array(json.dumps({FINGERPRINT: made_from, "methods": methods}))}
    for m in measured:
        for field in fields(FrameErrors) if m.errors else ():
            values = getattr(m.errors, field.name)
            if values is not None:
                arrays[f"{m.method}: {field.name}"] = values
    with written_whole(path) as (inside,):
        np.savez(inside, **arrays)


def read_measured(path: Path, made_from: str | None) -> list[Measured] | None:
    """Return what was measured on a trial; None if that was something else, or nothing, or the file is damaged."""
    if made_from is None or not path.is_file():
        return None
    try:
        about = _about(path)
        if about[FINGERPRINT] != made_from:
            return None
        return [m for method in about["methods"] for m in measured_by(method, [path])]
    except Exception:  # of many kinds, by zipfile, zlib and numpy, for another file, half of one, or a changed byte
        return None


def measured_methods(path: Path) -> list[str]:
    """Return the methods in the file of a trial."""
    return list(_about(path)["methods"])


def measured_by(method: str, paths: Sequence[Path]) -> Iterator[Measured]:
    """Yield what was measured by one method on each trial that has it."""
    names = [field.name for field in fields(FrameErrors)]
    for path in paths:
        about = _about(path)["methods"].get(method)
        if about is None:
            continue
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            values: dict[str, Any] = {name: arrays.get(f"{method}: {name}") for name in names}
        errors = _checked(FrameErrors(**values)) if values["nees"] is not None else None
        yield Measured(method=method, errors=errors, **about)


def _checked(errors: FrameErrors) -> FrameErrors:
    """Return errors as they were stored; raise ValueError where their arrays have other shapes or types."""
    frames, nodes = errors.nees.shape
    faces = errors.face_error_m.shape[1]
    expected = {
        "node_error_m": ((frames, nodes, 3), np.float64),
        "face_error_m": ((frames, faces, 3), np.float64),
        "nees": ((frames, nodes), np.float64),
        "node_sigma_m": ((frames, nodes), np.float64),
        "wrong_branch": ((frames,), np.bool_),
    }
    for name, (shape, kind) in expected.items():
        values = getattr(errors, name)
        if (values is not None or name != "wrong_branch") and (values.shape != shape or values.dtype != kind):
            raise ValueError(f"{name}: expected {kind.__name__} of the shape {shape}")
    return errors


def _about(path: Path) -> dict[str, Any]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        about: dict[str, Any] = json.loads(str(arrays[ABOUT]))
    return about
