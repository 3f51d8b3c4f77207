"""A free-standing robot whose stamps count from anywhere: its rest is that from the first frame on."""

from pathlib import Path

import numpy as np
import pytest

from pipelines import pipeline_of
from plan_edits import SHORT_REST, replaced
from roll import roll
from tensegraph import Reconstruction, open_trial
from tensegraph.io.positions import read_positions
from tensegraph.pipeline import Pipeline
from trial_edits import rewritten, stamped, write_positions

SEEN = (2, 4, 9, 11)
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def until_after_the_rest(folder: Path) -> Path:
    """Return a copy of the first 1.5 s of the shipped trial, 1 s of them as rest, with 10 Hz of motion capture."""
    own = '\n[[position]]\nframe = "own"\nfile = "positions.csv"\n'
    roll(folder, 1.5, lambda text: replaced(text, SHORT_REST) + own)
    truth = read_positions(folder / "truth.csv", 12)
    write_positions(folder / "positions.csv", truth.t_s[::5], truth.node_position_m[::5] @ TURNED, SEEN)
    return folder


def reconstructed(folder: Path, method: str) -> tuple[Reconstruction, Pipeline]:
    trial = open_trial(folder)
    pipeline = pipeline_of(trial.description)
    shapes = pipeline.estimate(trial.readings(), method)
    return Reconstruction.of(trial.description.structure, shapes), pipeline


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_clock_that_starts_later_gives_the_same_shapes(method, tmp_path) -> None:
    """The robot rests for a second from the first frame on, with an inertial sensor and motion capture."""
    plain, later = until_after_the_rest(tmp_path / "plain"), until_after_the_rest(tmp_path / "later")
    for file in later.glob("*.csv"):
        rewritten(file, stamped(lambda t_s: t_s + 100.0))
    expected, _ = reconstructed(plain, method)
    found, pipeline = reconstructed(later, method)
    assert found.t_s == pytest.approx(expected.t_s + 100.0)
    assert found.node_position_m == pytest.approx(expected.node_position_m, abs=1e-6)
    assert found.node_sigma_m == pytest.approx(expected.node_sigma_m, abs=1e-6)
    (fit,) = pipeline.aids.own_frames.fits
    assert fit.nodes == SEEN
    assert fit.frame is not None
