"""What no result may hold, whatever the files were that it was made from."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tensegraph import Reconstruction, Status, TensegraphError, load, open_trial

MAY_BE_BLANK = {
    "lengths.csv": ("length_m", "sigma_m", "innovation_sigma_m", "mode", "flags"),
    "status.csv": ("status", "other_log_ratio", "doubt"),
    "estimated_loads.csv": ("fx_n", "fy_n", "fz_n", "sigma_n", "observable"),
    "sensor_drift.csv": ("drift", "sigma"),
}
"""Columns of words, and those that say with nan or inf that something was not measured."""
STRETCHED = 4.0
"""Ratio of a tendon's length to its natural length that no strip survives."""
BENT = 0.101
"""Share of its length by which a rod of a shape that is `ok` differs from what it is."""


def insane(place: Path) -> str | None:
    """Return what is wrong with what a command wrote beside its inputs, or None."""
    try:
        return next(_problems(place), None)
    except (TensegraphError, ValueError) as error:
        return f"what it wrote cannot be read: {error}"


def _problems(place: Path) -> Iterator[str]:
    out = place / "out"
    if (out / "shape.csv").exists():
        yield from _problems_of_result(out)
    if (out / "trial.toml").exists():
        open_trial(out)
        yield from _problems_of_tables(out)
    if (out / "evaluation.json").exists():
        json.loads((out / "evaluation.json").read_text(), parse_constant=_no_number)
    for file in place.glob("out.toml"):
        tomllib.loads(file.read_text())
    if (place / "out.npz").exists():
        yield from _problems_of_arrays(place / "out.npz")


def _no_number(word: str) -> float:
    raise ValueError(f"evaluation.json holds {word}")


def _problems_of_result(out: Path) -> Iterator[str]:
    yield from _problems_of_tables(out)
    r = load(out)
    if (np.diff(r.t_s) <= 0).any():
        yield "times do not increase"
    ok = np.array([status == Status.OK for status in r.status])
    if ok.any():
        yield from _problems_of_shapes(r, ok)


def _problems_of_shapes(r: Reconstruction, ok: NDArray[np.bool_]) -> Iterator[str]:
    """Yield what no shape can be that is said to be `ok`."""
    x, s = r.node_position_m[ok], r.structure
    rod_m = np.linalg.norm(np.diff(x[:, s.rods], axis=2)[:, :, 0], axis=-1)
    if (np.abs(rod_m / s.rod_length_m - 1) > BENT).any():
        yield f"ok with a rod of {np.abs(rod_m / s.rod_length_m - 1).max():.2f} off its length"
    stretch = s.tendon_length_m(x) / s.natural_length_m
    if stretch.max() > STRETCHED:
        yield f"ok with a tendon {stretch.max():.2f} times its natural length"
    if r.loads is not None and np.nanmax(np.abs(r.loads.force_n)) > 1e6:
        yield f"a load of {np.nanmax(np.abs(r.loads.force_n)):.3g} N"


def _problems_of_tables(directory: Path) -> Iterator[str]:
    for path in directory.glob("*.csv"):
        header, *rows = [line.split(",") for line in path.read_text().splitlines()]
        for column, name in enumerate(header):
            cells = [row[column] for row in rows]
            if name not in MAY_BE_BLANK.get(path.name, ()) and not np.isfinite(np.array(cells, dtype=float)).all():
                yield f"{path.name}: {name} is not finite"


def _problems_of_arrays(path: Path) -> Iterator[str]:
    with np.load(path) as arrays:
        for name in ("t_s", "node_position_m", "node_covariance_m2"):
            if not np.isfinite(arrays[name]).all():
                yield f"{path.name}: {name} is not finite"
