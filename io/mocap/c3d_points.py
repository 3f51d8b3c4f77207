"""A program that reads the points of a C3D file: `python c3d_points.py FILE.c3d POINTS.npz`.

ezc3d ends the process that reads some damaged files (signal 11), so that it gets one of its own.
"""

import struct
import sys
from itertools import count
from pathlib import Path

import numpy as np

MOST_MEMORY_BYTES = 4 << 30
"""Largest memory of this program: an hour of fifty markers takes half of it. A damaged file may ask for more."""

MIPS = b"\x56"
"""Fourth byte of the parameters in a file of a processor that writes the high byte first."""


def main(file: str, points: str) -> None:
    """Write points, residuals, labels, units, rate and first frame of a C3D file as arrays."""
    import ezc3d

    _limit_memory()
    read = ezc3d.c3d(file)
    told, got = _frames_told(Path(file)), read["data"]["points"].shape[2]
    if got < told:
        raise ValueError(f"expected the {told} frames of its header, got {got}: was the copy cut short?")
    about = read["parameters"]["POINT"]
    labels = list(about["LABELS"]["value"])
    for number in count(2):  # each holds 255 of them
        more = about.get(f"LABELS{number}")
        if more is None:
            break
        labels += more["value"]
    np.savez(
        points,
        point=read["data"]["points"],
        residual=read["data"]["meta_points"]["residuals"][0],
        label=np.array(labels, dtype=np.str_),
        unit=np.array(about.get("UNITS", {"value": []})["value"], dtype=np.str_),
        rate_hz=np.array(about["RATE"]["value"], dtype=np.float64),
        first_frame=read["header"]["points"]["first_frame"],
    )


def _frames_told(path: Path) -> int:
    """Return the number of frames in the header, of which ezc3d leaves out those that the file lacks.

    The header holds 16 bits for the last frame; of a longer recording it has fewer frames than there are.
    """
    with path.open("rb") as start:
        header = start.read(512)
        start.seek((header[0] - 1) * 512 + 3)
        order = ">" if start.read(1) == MIPS else "<"
    first, last = struct.unpack_from(f"{order}2H", header, 6)
    return int(last - first + 1)


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # on Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:  # ezc3d raises what its C++ throws: OSError, ValueError, RuntimeError and others
        sys.exit(" ".join(f"{error}".split()))
