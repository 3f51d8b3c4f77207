"""A free-standing robot seen by motion capture in a frame of its own, as a user types it."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by
from plan_edits import SHORT_REST, replaced
from roll import roll
from tensegraph.io.positions import read_positions
from tensegraph.models.values.rotations import rotation, rotation_vector
from trial_edits import write_positions

pytestmark = pytest.mark.usefixtures("undrawn")

TURN, ORIGIN_M = rotation(np.array([1.1, -0.7, 1.9])), np.array([1.3, -2.1, 0.8])
CAPTURES = '\n[[position]]\nfile = "seen.csv"\nframe = "own"\n\n[[position]]\nfile = "hidden.csv"\nframe = "own"\n'


@pytest.fixture
def trial(tmp_path) -> Path:
    """The first seconds of an example, with two captures: of four nodes, and of nodes that are hidden at rest."""
    path = roll(tmp_path / "roll", 1.6, lambda text: replaced(text, SHORT_REST) + CAPTURES)
    truth = read_positions(path / "truth.csv", 12)
    noise_m = 5e-4 * np.random.default_rng(1).standard_normal(truth.node_position_m.shape)
    y = (truth.node_position_m + noise_m - ORIGIN_M) @ TURN
    for name, nodes, from_s in (("seen", (2, 4, 9, 11), 0.0), ("hidden", (0, 1, 3), 1.1)):
        told = truth.t_s >= from_s
        write_positions(path / f"{name}.csv", truth.t_s[told], y[told], nodes)
    return path


def test_a_frame_is_found_at_rest_and_told(trial, tmp_path) -> None:
    result = printed_by("reconstruct", trial, "--live", "--figures", "none", "--out", "told", cwd=tmp_path)
    assert "frame of position 0" in result
    assert "position 1: rows in an unknown frame" in result
    table = tomllib.loads((tmp_path / "told" / "run.toml").read_text())
    seen, hidden = table["own_frame"]
    assert hidden["unknown"] == "expected three nodes or more while the robot is at rest, got 0"
    assert table["rows"]["position 1: rows in an unknown frame"] == 3 * 25
    assert seen["nodes"] == [2, 4, 9, 11]
    x, y, z, w = seen["quaternion"]
    turned_rad = rotation_vector(rotation(2 * np.arccos(w) * np.array([x, y, z]) / np.sqrt(1 - w * w)) @ TURN.T)
    assert (np.abs(turned_rad) < 4 * np.array(seen["turn_sigma_rad"])).all()
    assert (np.abs(np.array(seen["origin_m"]) - ORIGIN_M) < 4 * np.array(seen["origin_sigma_m"])).all()
    assert max(seen["origin_sigma_m"]) < 0.02
    shape, truth = (read_positions(path, 12) for path in (tmp_path / "told" / "shape.csv", trial / "truth.csv"))
    last_m = truth.node_position_m[np.argmin(np.abs(truth.t_s - shape.t_s[-1]))]
    assert shape.node_position_m[-1, [2, 4, 9, 11]] == pytest.approx(last_m[[2, 4, 9, 11]], abs=0.005)


def test_live_tells_the_frame_and_why_another_is_not_known(trial, tmp_path) -> None:
    result = printed_by("live", "--replay", trial, "--speed", "4", "--out", "told", cwd=tmp_path)
    assert "frame of position 0: origin at (1." in result
    assert "frame of position 1: not known, its positions are not used: expected three nodes" in result
    seen, hidden = tomllib.loads((tmp_path / "told" / "run.toml").read_text())["own_frame"]
    assert seen["nodes"] == [2, 4, 9, 11]
    assert "unknown" in hidden
