"""A real three-bar robot that crawls and rolls, from nothing but lengths: `three_bar.py RECORDING [--sigma-mm 1]`.

The recording is `simulators/configs/5d_processed_data.json` of github.com/nchen9191/tensegrity_diff_physics_public,
branch `lite`: for 33 s, the six end caps of the three-bar robot of Rutgers and Yale, tracked by an RGB-D camera. Motors
wind six of its nine tendons. Distances between tracked end caps, with white noise, become the lengths of a trial
without anchors; the tracks are its truth, exact to some millimetres.

Mechanics are not used: how far the motors have wound the tendons is not in the recording, so that forces are unknown.
Nine tendons and three rods are 12 lengths for 12 coordinates of the shape, but a prism that can be prestressed has one
motion that they do not see.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import tomli_w
import typer
from numpy.typing import NDArray

from tensegraph import open_trial, reconstruct
from tensegraph.models.evaluation.evaluation import Evaluation
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.structure.floor import Floor
from tensegraph.models.values.errors import InputError, TensegraphError
from tensegraph.models.values.rotations import best_rotation

END_CAPS = [f"rod_{rod}_end_pt{end}" for rod in ("01", "23", "45") for end in (1, 2)]
"""Keys of the nodes, in their order."""
UNIT_M = 0.1
"""The recording is in decimetres."""
RODS = [[0, 1], [2, 3], [4, 5]]
TENDONS = [[3, 5], [1, 3], [1, 5], [0, 2], [0, 4], [2, 4], [2, 5], [0, 3], [1, 4]]
"""Six that motors wind, around both ends, and three along the rods, as in `simulators/configs` of the same source."""
ROD_M = 0.325
"""Between the centres of the end caps."""
CAP_RADIUS_M = 0.0175
TAUT_M = 0.02
"""Told as natural length: tendons that are wound are shorter than they are long, and never bent."""
GAP_S = 0.5
"""Time without rows at which the tracks end."""
NEAR_M = 0.01
"""Height above the floor below which a tracked end cap stands on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Tracked end caps."""

    t_s: NDArray[np.float64]
    """(rows,) from 0."""
    node_position_m: NDArray[np.float64]
    """(rows, 6, 3)"""

    @property
    def length_m(self) -> NDArray[np.float64]:
        """(rows, 9) distances between the ends of the tendons."""
        first, second = np.array(TENDONS).T
        return np.linalg.norm(self.node_position_m[:, first] - self.node_position_m[:, second], axis=2)

    @property
    def floor(self) -> Floor:
        """The plane of the end caps that stand: least squares over the three lowest of each row that are near it."""
        x = self.node_position_m
        lowest = np.take_along_axis(x, np.argsort(x[:, :, 2], axis=1)[:, :3, None], axis=1).reshape(-1, 3)
        columns = np.column_stack([lowest[:, :2], np.ones(len(lowest))])
        plane = np.array([0.0, 0.0, np.median(lowest[:, 2])])
        for _ in range(10):
            near = np.abs(lowest[:, 2] - columns @ plane) < NEAR_M
            plane = np.linalg.lstsq(columns[near], lowest[near, 2])[0]
        normal = np.array([-plane[0], -plane[1], 1.0])
        return Floor(float(plane[2] / np.linalg.norm(normal)), normal / np.linalg.norm(normal))


def read_tracks(path: Path) -> Tracks:
    """Return the tracks of a recording, up to its first gap.

    The rows are stamped on arrival, in bursts, while what moves between two rows does not depend on their stamps: they
    are taken to be equally far apart.

    Raises:
        InputError: for a file that is not such a recording.
    """
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}") from error
    if not isinstance(rows, list) or len(rows) < 3:
        raise InputError(f"{path}: expected a list of at least 3 rows")
    stamp_s = np.concatenate([_numbers(path, number, row, "time", 1) for number, row in enumerate(rows)])
    gaps = np.flatnonzero(np.diff(stamp_s) > GAP_S)
    count = int(gaps[0]) + 1 if len(gaps) else len(rows)
    if count < 3:
        raise InputError(f"{path}: row {count}: expected no gap above {GAP_S} s in the first 3 rows")
    caps = [[_numbers(path, number, row, key, 3) for key in END_CAPS] for number, row in enumerate(rows[:count])]
    return Tracks(np.linspace(0, stamp_s[count - 1] - stamp_s[0], count), UNIT_M * np.array(caps))


def _numbers(path: Path, number: int, row: Any, key: str, size: int) -> NDArray[np.float64]:
    """Return (size,) the numbers of a key in a row."""
    try:
        values = np.array(row[key], dtype=np.float64).reshape(size)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: row {number}, {key}: expected {size} numbers") from error
    if not np.isfinite(values).all():
        raise InputError(f"{path}: row {number}, {key}: expected finite numbers, got {values.tolist()}")
    return values


def write_trial(tracks: Tracks, directory: Path, sigma_m: float, *, on_floor: bool, seed: int = 1) -> None:
    """Write a trial of lengths.

    Args:
        tracks: the tracked end caps.
        directory: of the trial, which is made.
        sigma_m: standard deviation of the white noise that is added to each length.
        on_floor: whether the robot stands on the floor; else the truth is its shape where it fits the rest shape best.
        seed: of the noise.
    """
    directory.mkdir(parents=True)
    x = tracks.node_position_m
    table: dict[str, Any] = {
        "kind": "crawl",
        "provenance": "measured: tracked end caps of a three-bar robot, distances with white noise as lengths",
        "structure": {
            "rods": RODS,
            "tendons": TENDONS,
            "rod_length_m": ROD_M,
            "natural_length_m": TAUT_M,
            "anchors": [],
            "anchor_position_m": [],
        },
        "rest": {"seconds": float(tracks.t_s[1]), "node_position_m": x[0].tolist()},
        "lengths": {"file": "lengths.csv"},
        "truth": {"file": "truth.csv"},
    }
    if on_floor:
        floor = tracks.floor
        table["ground"] = {"height_m": floor.height_m, "normal": floor.normal.tolist(), "cap_radius_m": CAP_RADIUS_M}
        table["truth"]["contacts"] = "contacts.csv"
        stands = np.abs(floor.clearance_m(x)) < NEAR_M
        _write_csv(directory / "contacts.csv", tracks.t_s, [f"c{n}" for n in range(6)], stands)
    else:
        x = fitted_to_first(x)
    length_m = tracks.length_m + np.random.default_rng(seed).normal(0, sigma_m, tracks.length_m.shape)
    names = [f"l{e}_m" for e in range(9)] + [f"s{e}_m" for e in range(9)]
    _write_csv(directory / "lengths.csv", tracks.t_s, names, np.hstack([length_m, np.full_like(length_m, sigma_m)]))
    names = [f"n{n}_{axis}_m" for n in range(6) for axis in "xyz"]
    _write_csv(directory / "truth.csv", tracks.t_s, names, x.reshape(len(x), -1))
    (directory / "trial.toml").write_text(tomli_w.dumps(table), encoding="utf-8")


def fitted_to_first(node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (rows, nodes, 3) shapes, each where it fits the first one best."""
    centroid_m = node_position_m.mean(axis=1, keepdims=True)
    centred = node_position_m - centroid_m
    turn = best_rotation(centred, np.broadcast_to(centred[0], centred.shape))
    return centred @ np.swapaxes(turn, 1, 2) + centroid_m[0]


def _write_csv(path: Path, t_s: NDArray[np.float64], names: list[str], values: NDArray[Any]) -> None:
    header = ",".join(["t_s", *names])
    np.savetxt(path, np.column_stack([t_s, values]), fmt="%.6f", delimiter=",", header=header, comments="")


def evaluated(directory: Path, method: str) -> tuple[Evaluation, str]:
    """Reconstruct a trial; return its evaluation, and the share of each status with its reason."""
    trial = open_trial(directory)
    shapes = reconstruct(trial, method)
    positions, rest_m = trial.truth(), trial.description.rest_position_m
    assert positions is not None, "the trial is written with its truth"
    assert rest_m is not None, "the trial is written with its rest shape"
    evaluation = evaluate(rest_m, shapes, trial.truth_of(positions))
    states = [str(s) + (f" ({d})" if d else "") for s, d in zip(shapes.status, shapes.doubts, strict=True)]
    told = ", ".join(f"{state} {states.count(state) / len(states):.0%}" for state in sorted(set(states)))
    return evaluation, told


def table(recording: Path, sigma_m: float) -> Iterator[str]:
    """Yield the rows of a Markdown table, one for each frame of reference and method."""
    tracks = read_tracks(recording)
    yield "| in | | shape, mm | of held | nodes, mm | tilt | heading | drift | contacts | in 68 % | in 95 % | status |"
    yield "|---" * 12 + "|"
    with TemporaryDirectory() as folder:
        for place in ("its own frame", "the world"):
            directory = Path(folder) / place.replace(" ", "_")
            write_trial(tracks, directory, sigma_m, on_floor=place == "the world")
            for method in ("live", "batch"):
                yield f"| {place} | {method} | {row(*evaluated(directory, method))} |"


def row(evaluation: Evaluation, told: str) -> str:
    """Return the cells of one row; of the pose, where the truth is in the world."""
    pose = evaluation.pose
    assert pose is not None, "the structure has no anchors"
    cells = [f"{1e3 * pose.shape_rmse_m:.1f}", f"{pose.shape_rmse_m / pose.held_rmse_m:.3f}"]
    cells.append(f"{1e3 * evaluation.absolute.nodes.rmse_m:.0f}")
    if pose.contacts:
        cells += [f"{pose.tilt_rms_deg:.1f}°", f"{pose.heading_error_deg:.0f}°", f"{pose.drift_share:.1%}"]
        cells.append(f"{pose.contacts.precision:.0%} / {pose.contacts.recall:.0%}")
    else:
        cells += ["-"] * 4
    consistency = evaluation.consistency
    return " | ".join([*cells, f"{consistency.coverage_68:.0%}", f"{consistency.coverage_95:.0%}", told])


def main(
    recording: Annotated[Path, typer.Argument(help="The JSON file of the tracks.")],
    sigma_mm: Annotated[float, typer.Option(min=0.01, help="Noise of the lengths.")] = 1.0,
    trial: Annotated[Path | None, typer.Option(help="Directory to which the trial in the world is written.")] = None,
) -> None:
    """Print the table."""
    try:
        if trial is not None:
            write_trial(read_tracks(recording), trial, 1e-3 * sigma_mm, on_floor=True)
        for line in table(recording, 1e-3 * sigma_mm):
            typer.echo(line)
    except (TensegraphError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from error


if __name__ == "__main__":
    typer.run(main)
