"""Positions and ranges told wrongly as a whole: another frame, scale, clock or unit, as a user types it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from command_line import run
from tensegraph import Settings, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.positions import read_positions
from tensegraph.pipeline import Pipeline

pytestmark = pytest.mark.usefixtures("undrawn")

ROLL = Path(__file__).parents[2] / "examples" / "roll_02"
END_S = 2.6
ANOTHER_CLOCK_S = 1e9
SEEN = (2, 4, 9, 11)
BEACON_M = np.array([2.1, -2.0, 1.5])
TABLES = f"""
[[position]]
file = "wrong.csv"

[[position]]
file = "late.csv"

[[range]]
file = "ranges.csv"
beacon_position_m = [{BEACON_M.tolist()}]
"""


def write_trial(path: Path, wrong_m: np.ndarray) -> None:
    """The first seconds of an example, with wrong positions, others of another clock, and ranges in mm.

    Args:
        path: of the trial.
        wrong_m: (3, 4) the map from true positions to those that are told.
    """
    shutil.copytree(ROLL, path)
    truth = read_positions(ROLL / "truth.csv", 12)
    for name in ("board0.csv", "board1.csv", "imu0.csv", "truth.csv", "contacts.csv"):
        header, *rows = (path / name).read_text().splitlines()
        (path / name).write_text("\n".join([header, *(row for row in rows if float(row.split(",")[0]) < END_S)]) + "\n")
    seen = [(t_s, node, truth.node_position_m[k, node]) for k, t_s in enumerate(truth.t_s) for node in SEEN]
    for name, late_s in (("wrong", 0), ("late", 3600)):
        told = [(t_s + late_s, node, *(wrong_m[:, :3] @ x + wrong_m[:, 3])) for t_s, node, x in seen if t_s < END_S]
        rows = [f"{t_s:.4f},{node},{x:.5f},{y:.5f},{z:.5f}" for t_s, node, x, y, z in told]
        (path / f"{name}.csv").write_text("\n".join(["t_s,node,x_m,y_m,z_m", *rows]) + "\n")
    ranges = [f"{t_s:.4f},0,{node},{1e3 * np.linalg.norm(x - BEACON_M):.3f}" for t_s, node, x in seen if t_s < END_S]
    (path / "ranges.csv").write_text("\n".join(["t_s,beacon,node,range_m", *ranges]) + "\n")
    (path / "trial.toml").write_text((path / "trial.toml").read_text() + TABLES)


@pytest.mark.parametrize(
    ("wrong_m", "options"),
    [
        (np.column_stack([np.eye(3), [0.5, 0, 0]]), ["--live"]),
        (np.column_stack([1.05 * np.eye(3), np.zeros(3)]), []),
    ],
    ids=["shifted", "scaled"],
)
def test_positions_of_another_frame_are_doubted_and_do_no_harm(tmp_path, wrong_m, options) -> None:
    write_trial(tmp_path / "roll", wrong_m)
    result = run("reconstruct", "roll", *options, "--figures", "none", "--out", "told", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    summary = " ".join(result.stdout.replace("│", " ").split())
    assert "doubt positions" in summary
    assert "position 0 no reading used: all" in summary
    assert "position 1 no reading used: none is of the time of the frames" in summary
    assert "its first is at 3600.00 s" in summary
    assert "range 0 no reading used: distances are 1000 times those expected" in summary
    doubts = [row.split(",")[-1] for row in (tmp_path / "told" / "status.csv").read_text().splitlines()]
    assert set(doubts[1:]) == {"positions"}
    shape, truth = (read_positions(path, 12) for path in (tmp_path / "told" / "shape.csv", tmp_path / "roll/truth.csv"))
    true_m = truth.node_position_m[np.searchsorted(truth.t_s, shape.t_s - 0.01)]
    assert np.sqrt(np.mean(np.sum((shape.node_position_m - true_m) ** 2, axis=2))) < 0.004


def test_readings_of_another_clock_than_that_of_the_boards_are_in_none_of_its_frames(tmp_path) -> None:
    write_trial(tmp_path / "roll", np.column_stack([np.eye(3), np.zeros(3)]))
    for board in (tmp_path / "roll").glob("board?.csv"):
        header, *rows = board.read_text().splitlines()
        cells = [row.split(",", 1) for row in rows]
        later = [f"{ANOTHER_CLOCK_S + float(host_s):.6f},{others}" for host_s, others in cells]
        board.write_text("\n".join([header, *later]) + "\n")
    trial = open_trial(tmp_path / "roll")
    frames = list(Pipeline(trial.description, Settings(), read_sensor_model()).lengths(trial.readings()))
    assert frames[-1].t_s > ANOTHER_CLOCK_S
    assert not any(frame.aids for frame in frames)
