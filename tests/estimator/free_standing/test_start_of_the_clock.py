"""A free-standing robot whose stamps count from anywhere: its rest is that from the first frame on."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tensegraph import Reconstruction, Settings, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.pipeline import Pipeline
from trial_edits import cut, shifted

ROLL = Path(__file__).parents[3] / "examples" / "roll_02"
SEEN = (2, 4, 9, 11)
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def with_motion_capture(folder: Path) -> None:
    """Add positions of some nodes in a frame of their own, of ten frames a second of the truth."""
    header, *rows = (folder / "truth.csv").read_text().splitlines()
    assert header.startswith("t_s,n0_x_m")
    lines = ["t_s,node,x_m,y_m,z_m"]
    for row in rows[::5]:
        t_s, *values = row.split(",")
        x = np.array(values, dtype=float).reshape(-1, 3) @ TURNED
        lines += [f"{t_s},{node},{','.join(f'{value:.5f}' for value in x[node])}" for node in SEEN]
    (folder / "positions.csv").write_text("\n".join([*lines, ""]))
    trial = folder / "trial.toml"
    table = '[[position]]\nframe = "own"\nfile = "positions.csv"\n\n[[imu]]'
    trial.write_text(trial.read_text().replace("[[imu]]", table))


def until_after_the_rest(folder: Path) -> Path:
    """Return a copy of the first three seconds of the shipped trial, with motion capture."""
    shutil.copytree(ROLL, folder)
    cut(folder, 3.0)
    with_motion_capture(folder)
    return folder


def reconstructed(folder: Path, method: str) -> tuple[Reconstruction, Pipeline]:
    trial = open_trial(folder)
    pipeline = Pipeline(trial.description, Settings(), read_sensor_model())
    shapes = pipeline.estimate(trial.readings(), method)
    return Reconstruction.of(trial.description.structure, shapes), pipeline


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_clock_that_starts_later_gives_the_same_shapes(method, tmp_path) -> None:
    """The robot rests for two seconds from the first frame on, with an inertial sensor and motion capture."""
    plain, later = until_after_the_rest(tmp_path / "plain"), until_after_the_rest(tmp_path / "later")
    shifted(later, 100.0)
    expected, _ = reconstructed(plain, method)
    found, pipeline = reconstructed(later, method)
    assert found.t_s == pytest.approx(expected.t_s + 100.0)
    assert found.node_position_m == pytest.approx(expected.node_position_m, abs=1e-6)
    assert found.node_sigma_m == pytest.approx(expected.node_sigma_m, abs=1e-6)
    (fit,) = pipeline.aids.own_frames.fits
    assert fit.nodes == SEEN
    assert fit.frame is not None
