"""Positions and ranges told wrongly as a whole: another frame, scale, clock or unit, as a user types it."""

from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by
from pipelines import pipeline_of
from plan_edits import SHORT_REST, replaced
from roll import roll
from tensegraph import load, open_trial
from tensegraph.io.positions import read_positions
from tensegraph.models.evaluation.metrics import node_rmse_m
from trial_edits import rewritten, stamped, write_positions

pytestmark = pytest.mark.usefixtures("undrawn")

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
    roll(path, 1.6, lambda text: replaced(text, SHORT_REST) + TABLES)
    truth = read_positions(path / "truth.csv", 12)
    for name, late_s in (("wrong", 0), ("late", 3600)):
        told_m = truth.node_position_m @ wrong_m[:, :3].T + wrong_m[:, 3]
        write_positions(path / f"{name}.csv", truth.t_s + late_s, told_m, SEEN)
    range_mm = 1e3 * np.linalg.norm(truth.node_position_m - BEACON_M, axis=2)
    ranges = [f"{t_s:.4f},0,{node},{range_mm[k, node]:.3f}" for k, t_s in enumerate(truth.t_s) for node in SEEN]
    (path / "ranges.csv").write_text("\n".join(["t_s,beacon,node,range_m", *ranges]) + "\n")


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
    result = printed_by("reconstruct", "roll", *options, "--figures", "none", "--out", "told", cwd=tmp_path)
    summary = " ".join(result.replace("│", " ").split())
    assert "doubt positions" in summary
    assert "position 0 no reading used: all" in summary
    assert "position 1 no reading used: none is of the time of the frames" in summary
    assert "its first is at 3600.00 s" in summary
    assert "range 0 no reading used: distances are 1000 times those expected" in summary
    doubts = [row.split(",")[-1] for row in (tmp_path / "told" / "status.csv").read_text().splitlines()]
    assert set(doubts[1:]) == {"positions"}
    truth = read_positions(tmp_path / "roll" / "truth.csv", 12)
    assert node_rmse_m(load(tmp_path / "told"), truth.t_s, truth.node_position_m) < 0.004


def test_readings_of_another_clock_than_that_of_the_boards_are_in_none_of_its_frames(tmp_path) -> None:
    write_trial(tmp_path / "roll", np.column_stack([np.eye(3), np.zeros(3)]))
    for board in (tmp_path / "roll").glob("board?.csv"):
        rewritten(board, stamped(lambda host_s: ANOTHER_CLOCK_S + host_s))
    trial = open_trial(tmp_path / "roll")
    frames = list(pipeline_of(trial.description).lengths(trial.readings()))
    assert frames[-1].t_s > ANOTHER_CLOCK_S
    assert not any(frame.aids for frame in frames)
