"""C3D, by ezc3d, which the extra `mocap` installs."""

from pathlib import Path
from typing import Any

import numpy as np

from ...models.values.errors import InputError
from ...models.values.extras import needs_extra
from ...models.values.marker_tracks import MarkerTracks
from ..input_files import check_regular
from .marker_rows import marker_tracks, metres_per, positive_number

MAGIC = 0x50
"""Second byte of every C3D file."""


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
        import ezc3d
    try:
        file = ezc3d.c3d(str(path))
    except Exception as error:  # ezc3d raises what its C++ throws: OSError, ValueError, RuntimeError and others
        raise InputError(f"{path}: cannot be read as C3D: {' '.join(str(error).split())}") from error
    return _tracks(file, path)


def _tracks(file: Any, path: Path) -> MarkerTracks:
    points, residual = file["data"]["points"], file["data"]["meta_points"]["residuals"][0]
    about = file["parameters"]["POINT"]
    if points.shape[1] == 0 or points.shape[2] < 2:
        raise InputError(f"{path}: expected points in two frames or more, got {points.shape[1]} in {points.shape[2]}")
    units, rate = about.get("UNITS", {"value": []})["value"], about["RATE"]["value"]
    metres = metres_per(units[0].strip() if units else "", f"{path}: POINT:UNITS")
    rate_hz = positive_number(str(rate[0] if len(rate) else ""), f"{path}: POINT:RATE")
    names = [name.strip() for name in about["LABELS"]["value"]][: points.shape[1]]
    names += [f"point {k + 1}" for k in range(len(names), points.shape[1])]
    seen = (residual >= 0)[..., None]
    position_m = np.where(seen, metres * np.moveaxis(points[:3], 0, -1), np.nan).swapaxes(0, 1)
    first = int(file["header"]["points"]["first_frame"])
    return marker_tracks(path, (first + np.arange(len(position_m))) / rate_hz, names, position_m)
