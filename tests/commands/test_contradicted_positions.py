"""Positions that are wrong: left out, counted for each node, and without a trace in the shape."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by
from plan_edits import SHORT_REST, replaced
from roll import roll
from tensegraph import load
from tensegraph.io.positions import read_positions
from tensegraph.models.evaluation.metrics import node_rmse_m
from trial_edits import write_positions

SEEN = (2, 4, 9, 11)


def write_trial(path: Path) -> None:
    """The first seconds of an example, with positions of four nodes: one absurd, two exchanged, one frozen in turn."""
    table = '\n[[position]]\nfile = "positions.csv"\n'
    roll(path, 2.4, lambda text: replaced(text, SHORT_REST) + table)
    truth = read_positions(path / "truth.csv", 12)
    y = truth.node_position_m + 5e-4 * np.random.default_rng(1).standard_normal(truth.node_position_m.shape)
    t_s = truth.t_s
    y[(t_s > 0.3) & (t_s < 0.5), 9] = 1e3
    exchanged = (t_s > 0.7) & (t_s < 0.9)
    y[exchanged, 2], y[exchanged, 4] = y[exchanged, 4], y[exchanged, 2].copy()
    y[t_s > 1.4, 11] = [0.5, 0.5, 0.5]
    write_positions(path / "positions.csv", t_s, y, SEEN)


@pytest.mark.parametrize("live", [["--live"], []])
def test_wrong_positions_are_left_out_and_counted(tmp_path, live) -> None:
    write_trial(tmp_path / "roll")
    result = printed_by("reconstruct", "roll", *live, "--figures", "none", "--out", "told", cwd=tmp_path)
    assert "position of node 9: contradicted" in result
    rows = tomllib.loads((tmp_path / "told" / "run.toml").read_text())["rows"]
    causes = ("contradicted", "filled in")  # what stays the same is taken as filled in after some samples
    left_out = {node: sum(rows.get(f"position of node {node}: {cause}", 0) for cause in causes) for node in SEEN}
    assert left_out == {2: 9, 4: 9, 9: 9, 11: pytest.approx(48, abs=2)}
    truth = read_positions(tmp_path / "roll" / "truth.csv", 12)
    assert node_rmse_m(load(tmp_path / "told"), truth.t_s, truth.node_position_m) < 0.004
