"""Positions that are wrong: left out, counted for each node, and without a trace in the shape."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from command_line import run
from tensegraph.io.positions import read_positions

ROLL = Path(__file__).parents[2] / "examples" / "roll_02"
END_S = 3.2
SEEN = (2, 4, 9, 11)


def write_trial(path: Path) -> None:
    """The first seconds of an example, with positions of four nodes: one absurd, two exchanged, one frozen in turn."""
    shutil.copytree(ROLL, path)
    truth = read_positions(ROLL / "truth.csv", 12)
    for name in ("board0.csv", "board1.csv", "imu0.csv", "truth.csv", "contacts.csv"):
        header, *rows = (path / name).read_text().splitlines()
        (path / name).write_text("\n".join([header, *(row for row in rows if float(row.split(",")[0]) < END_S)]) + "\n")
    y = truth.node_position_m + 5e-4 * np.random.default_rng(1).standard_normal(truth.node_position_m.shape)
    t_s = truth.t_s
    y[(t_s > 0.5) & (t_s < 0.7), 9] = 1e3
    exchanged = (t_s > 0.9) & (t_s < 1.1)
    y[exchanged, 2], y[exchanged, 4] = y[exchanged, 4], y[exchanged, 2].copy()
    y[t_s > 2.2, 11] = [0.5, 0.5, 0.5]
    rows = [
        f"{t:.4f},{node},{','.join(f'{value:.5f}' for value in y[k, node])}"
        for k, t in enumerate(t_s)
        for node in SEEN
        if t < END_S
    ]
    (path / "positions.csv").write_text("\n".join(["t_s,node,x_m,y_m,z_m", *rows]) + "\n")
    (path / "trial.toml").write_text((path / "trial.toml").read_text() + '\n[[position]]\nfile = "positions.csv"\n')


@pytest.mark.parametrize("live", [["--live"], []])
def test_wrong_positions_are_left_out_and_counted(tmp_path, live) -> None:
    write_trial(tmp_path / "roll")
    result = run("reconstruct", "roll", *live, "--figures", "none", "--out", "told", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "position of node 9: contradicted" in result.stdout
    rows = tomllib.loads((tmp_path / "told" / "run.toml").read_text())["rows"]
    causes = ("contradicted", "filled in")  # what stays the same is taken as filled in after some samples
    left_out = {node: sum(rows.get(f"position of node {node}: {cause}", 0) for cause in causes) for node in SEEN}
    assert left_out == {2: 9, 4: 9, 9: 9, 11: pytest.approx(48, abs=2)}
    shape, truth = (read_positions(path, 12) for path in (tmp_path / "told" / "shape.csv", tmp_path / "roll/truth.csv"))
    true_m = truth.node_position_m[np.searchsorted(truth.t_s, shape.t_s - 0.01)]
    assert np.sqrt(np.mean(np.sum((shape.node_position_m - true_m) ** 2, axis=2))) < 0.004
