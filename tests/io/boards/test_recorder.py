"""The writer of trials: what it writes is what the reader reads, and nothing is written over."""

import tomllib

import numpy as np
import pytest

from tensegraph import InputError, open_trial
from tensegraph.io.boards.recorder import Recorder


def test_a_recorded_trial_is_the_trial(tmp_path, example) -> None:
    """Reading and recording the example gives its files again, byte for byte; trial.toml value for value."""
    trial = open_trial(example)
    (tmp_path / "more").mkdir()
    with Recorder(tmp_path / "more" / "copy", trial.toml) as recorder:
        for row in trial.readings():
            recorder.add(row)
        truth = trial.truth()
        loads = np.genfromtxt(example / "loads.csv", delimiter=",", skip_header=1)[:, 1:]
        recorder.add_truth(truth, loads.reshape(truth.node_position_m.shape))
    copy = tmp_path / "more" / "copy"
    for name in ("board0.csv", "board1.csv", "truth.csv"):
        assert (copy / name).read_bytes() == (example / name).read_bytes(), name
    written = (copy / "loads.csv").read_text().replace("-0.0000", "0.0000")
    assert written == (example / "loads.csv").read_text().replace("-0.0000", "0.0000")
    assert tomllib.loads((copy / "trial.toml").read_text()) == trial.toml
    assert "# L0 of each tendon, unstretched" in (copy / "trial.toml").read_text()


def test_nothing_is_written_over(tmp_path, example) -> None:
    trial = open_trial(example)
    Recorder(tmp_path / "one", trial.toml).__exit__(None, None, None)
    before = (tmp_path / "one" / "trial.toml").read_bytes()
    with pytest.raises(InputError, match="one: exists: expected a new name for the trial"):
        Recorder(tmp_path / "one", trial.toml)
    assert (tmp_path / "one" / "trial.toml").read_bytes() == before


def test_what_can_not_be_written_is_said(tmp_path, example) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        Recorder(tmp_path / "file" / "trial", open_trial(example).toml)
