"""A program that reads the points of a C3D file: `python c3d_points.py FILE.c3d POINTS.npz`.

ezc3d ends the process that reads some damaged files (signal 11), so that it gets one of its own.
"""

import sys
from itertools import count

import numpy as np

MOST_MEMORY_BYTES = 4 << 30
"""Largest memory of this program: an hour of fifty markers takes half of it. A damaged file may ask for more."""


def main(file: str, points: str) -> None:
    """Write points, residuals, labels, units, rate and first frame of a C3D file as arrays."""
    import ezc3d

    _limit_memory()
    read = ezc3d.c3d(file)
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
