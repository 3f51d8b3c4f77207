"""C3D, by ezc3d, which the extra `mocap` installs."""

import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.values.errors import InputError, needs_extra
from ...models.values.tracks import MarkerTracks
from ..input_files import check_regular
from .marker_rows import marker_tracks, metres_per, positive_number

MAGIC = 0x50
"""Second byte of every C3D file."""
LONGEST_READ_S = 30.0
"""Time after which the reader is taken to hang; an hour of fifty markers takes some seconds."""


def read_c3d(path: Path) -> MarkerTracks:
    """Return the points of a C3D file; those without a residual were hidden. Time is zero in frame 1.

    Raises:
        InputError: for a file that cannot be read or is no C3D, without ezc3d, or without points, rate or unit.
    """
    check_regular(path)
    with path.open("rb") as start:
        if start.read(2)[1:] != bytes([MAGIC]):
            raise InputError(f"{path}: is no C3D file: expected 0x50 as its second byte")
    with needs_extra(f"{path}: C3D", "mocap"):
        import_module("ezc3d")
    return _tracks(_read_apart(path), path)


def _read_apart(path: Path) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of `c3d_points`, which another process reads: a damaged file may end it."""
    with TemporaryDirectory() as folder:
        points = Path(folder) / "points.npz"
        command = [sys.executable, str(Path(__file__).with_name("c3d_points.py")), str(path.resolve()), str(points)]
        try:
            ended = subprocess.run(
                command, capture_output=True, text=True, errors="replace", check=False, timeout=LONGEST_READ_S
            )
        except subprocess.TimeoutExpired as error:
            raise InputError(f"{path}: cannot be read as C3D: no end after {LONGEST_READ_S:g} s") from error
        if ended.returncode != 0:
            crashed = f"the reader was ended by signal {-ended.returncode}" if ended.returncode < 0 else ""
            raise InputError(f"{path}: cannot be read as C3D: {crashed or ' '.join(ended.stderr.split())}")
        with np.load(points, allow_pickle=False) as arrays:
            return dict(arrays)


def _tracks(read: Mapping[str, NDArray[Any]], path: Path) -> MarkerTracks:
    points, residual, unit, rate = read["point"], read["residual"], read["unit"], read["rate_hz"]
    if points.shape[1] == 0 or points.shape[2] < 2:
        raise InputError(f"{path}: expected points in two frames or more, got {points.shape[1]} in {points.shape[2]}")
    metres = metres_per(str(unit[0]).strip() if len(unit) else "", f"{path}: POINT:UNITS")
    rate_hz = positive_number(str(rate[0] if len(rate) else ""), f"{path}: POINT:RATE")
    names = [str(name).strip() for name in read["label"]][: points.shape[1]]
    names += [f"point {k + 1}" for k in range(len(names), points.shape[1])]
    seen = (residual >= 0)[..., None]
    position_m = np.where(seen, metres * np.moveaxis(points[:3], 0, -1), np.nan).swapaxes(0, 1)
    first = int(read["first_frame"])
    return marker_tracks(path, (first + np.arange(len(position_m))) / rate_hz, names, position_m)
