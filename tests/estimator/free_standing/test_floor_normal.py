"""A floor whose normal is not told exactly: from heights of the nodes that stand, and gravity of inertial sensors."""

import tomllib
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from command_line import printed_by, refusal_of, run
from plan_edits import replaced
from roll import roll
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.values.aids import Imu, ImuReading
from tensegraph.models.values.rotations import rotation, shortest_rotation

SLOPE = rotation(np.array([0.08, -0.12, 0.0]))
SHAPE_M2 = 1e-7 * np.eye(36)
RODS = (0, 2)


def at_rest_on_a_slope(balanced, told: Floor):
    """Return the last step of the filter after 0.6 s at rest on a slope, 3 m from the origin, and the floor."""
    x = balanced.node_position_m @ SLOPE.T + np.array([3.0, 0.5, 0.0])
    rest = replace(balanced, node_position_m=x)
    floor = told.under(x)
    imus = tuple(Imu(rod, 0.5, UP) for rod in RODS)
    poses = PoseFilter(rest, FreeStandingRobot(floor=floor, imus=imus, rest_seconds=0.2), PoseSettings())
    a, b = balanced.structure.rods[list(RODS)].T
    along = (x[b] - x[a]) / np.linalg.norm(x[b] - x[a], axis=1, keepdims=True)
    force = [GRAVITY_M_PER_S2 * UP @ shortest_rotation(UP, direction) for direction in along]
    for k in range(30):
        aids = [ImuReading(i, 0.02 * k, np.zeros(3), force[i]) for i in range(2)]
        step = poses.step(0.02 * k, x, SHAPE_M2, aids)
    return step, floor


def test_the_normal_is_found_and_the_structure_stays_upright(balanced) -> None:
    """A slope of 8 degrees that is told to be level, and far from the origin, where heights are off by decimetres."""
    step, floor = at_rest_on_a_slope(balanced, Floor(0.01, UP, 0.17))
    at = step.state.layout.floor_tilt
    normal = floor.estimated(step.state.floor_tilt, step.covariance[at, at])
    error_rad = np.linalg.norm(np.cross(normal.direction, SLOPE @ UP))
    assert error_rad < 3 * normal.sigma_rad
    assert error_rad < 0.003
    assert 1e-4 < normal.sigma_rad < 0.01
    assert step.state.turn == pytest.approx(np.eye(3), abs=0.002)
    assert np.flatnonzero(step.standing.nodes).tolist() == [0, 1, 2]


def test_a_normal_that_is_told_exactly_and_wrong_tilts_the_structure(balanced) -> None:
    """The same slope without sigma: the test above can fail."""
    step, _ = at_rest_on_a_slope(balanced, Floor(0.01, UP))
    assert not len(step.state.floor_tilt)
    assert not np.allclose(step.state.turn, np.eye(3), atol=0.002)


def cut_trial(folder: Path, ground: str) -> Path:
    """Copy the first 0.8 s of the shipped trial, of which 0.4 s are told as rest, with lines added to `[ground]`."""
    edits = ("seconds = 2.0", "seconds = 0.4"), ("[ground]\n", f"[ground]\n{ground}\n")
    return roll(folder, 0.8, lambda text: replaced(text, *edits))


def test_the_command_line_tells_the_normal(tmp_path) -> None:
    """A level floor that is told to slope by 8 degrees; `[floor_normal]` and the table say that it does not.

    A live session tells the same to the last digit.
    """
    cut_trial(tmp_path / "trial", "normal = [0.1, -0.1, 0.98995]\nnormal_sigma_rad = 0.17")
    result = printed_by("reconstruct", "trial", "--live", "--figures", "none", "--out", "out", cwd=tmp_path)
    assert "normal of the floor" in result
    told = tomllib.loads((tmp_path / "out" / "run.toml").read_text())["floor_normal"]
    off_rad = np.arccos(told["direction"][2])
    assert off_rad < 0.02
    assert off_rad < 4 * told["sigma_rad"] < 0.04
    all_frames = mock.patch("tensegraph.live.activity.LATE_S", np.inf)
    with mock.patch("tensegraph.io.figures.shape_figures.write_figures"), all_frames:
        result = run("live", "--replay", "trial", "--speed", 1000, "--out", "live", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert tomllib.loads((tmp_path / "live" / "run.toml").read_text())["floor_normal"] == told


def test_without_gravity_the_normal_is_refused(tmp_path) -> None:
    path = cut_trial(tmp_path / "trial", "normal_sigma_rad = 0.17")
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text.replace("[[imu]]", "[[was_imu]]"))
    result = refusal_of("reconstruct", "trial", cwd=tmp_path)
    assert "ground.normal_sigma_rad: expected [[imu]] or [[position]]" in " ".join(result.split())
