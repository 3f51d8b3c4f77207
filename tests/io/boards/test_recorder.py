"""The writer of trials: what it writes is what the reader reads, and nothing is written over."""

import tomllib
from itertools import islice

import numpy as np
import pytest

from roll import ROLL
from tensegraph import BoardReading, InputError, open_trial
from tensegraph.io.boards.recorder import Recorder
from tensegraph.models.values.aids import AidReading, ImuReading, PositionReading, RangeReading
from tensegraph.models.values.readings import NaturalLengthReading


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
    with pytest.raises(InputError, match="one: exists: expected a new name"):
        Recorder(tmp_path / "one", trial.toml)
    assert (tmp_path / "one" / "trial.toml").read_bytes() == before


def test_what_can_not_be_written_is_said(tmp_path, example) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        Recorder(tmp_path / "file" / "trial", open_trial(example).toml)


def test_readings_of_every_other_sensor_are_recorded_in_its_file(tmp_path) -> None:
    """Two of each kind; what is read back is what was added, to the decimals of the files."""
    trial = open_trial(ROLL)
    beacons = [[0.0, 0.0, 2.0], [2.0, 0.0, 2.0]]
    imu = {"rod": 1, "axis": [0, 0, 1]}
    tables = {
        "imu": [imu | {"file": f"imu{k}.csv"} for k in range(2)],
        "range": [{"file": f"ranges{k}.csv", "beacon_position_m": beacons} for k in range(2)],
        "position": [{"file": f"positions{k}.csv"} for k in range(2)],
    }
    x = np.array([0.1, -0.25, 0.5])
    added = [
        *(ImuReading(k, 0.5 + 0.001 * k, x, -x) for k in range(2)),
        *(RangeReading(0.6 + 0.001 * k, np.array(beacons[1]), (k, 1, 4), 2.125) for k in range(2)),
        *(PositionReading(0.7 + 0.001 * k, 3, x, k) for k in range(2)),
    ]
    with Recorder(tmp_path / "trial", trial.toml | tables) as recorder:
        recorder.add(next(reading for reading in trial.readings() if isinstance(reading, BoardReading)))
        for reading in added:
            recorder.add(reading)
    read = [reading for reading in open_trial(tmp_path / "trial").readings() if isinstance(reading, AidReading)]
    assert [repr(reading) for reading in read] == [repr(reading) for reading in added]


def test_files_may_be_in_folders_of_the_trial(tmp_path) -> None:
    """One of a board, one of an inertial sensor; what is read back are the rows that were added."""
    trial = open_trial(ROLL)
    boards = [board | {"file": f"data/{board['file']}"} for board in trial.toml["board"]]
    tables = {"board": boards, "imu": [trial.toml["imu"][0] | {"file": "more/data/imu0.csv"}]}
    with Recorder(tmp_path / "trial", trial.toml | tables) as recorder:
        added = list(islice(trial.readings(), 50))
        for reading in added:
            recorder.add(reading)
    assert (tmp_path / "trial" / "data" / "board0.csv").is_file()
    assert [repr(reading) for reading in open_trial(tmp_path / "trial").readings()] == list(map(repr, added))


def test_a_file_in_the_place_of_a_folder_is_said(tmp_path, example) -> None:
    toml = open_trial(example).toml
    boards = [board | {"file": f"trial.toml/{board['file']}"} for board in toml["board"]]
    with pytest.raises(InputError, match=r"one: cannot be written: "):
        Recorder(tmp_path / "one", toml | {"board": boards})
    assert list(tmp_path.iterdir()) == []


def test_a_sigma_of_micrometres_is_not_rounded_to_zero(tmp_path, example) -> None:
    """Of a motor's natural lengths, which are refused without a sigma."""
    motor = {"file": "lengths.csv", "tendons": [3], "strip_length_m": 0.1}
    added = [NaturalLengthReading(0.1, 3, 0.125, 4e-6), NaturalLengthReading(0.2, 3, 0.125, 0.00123456)]
    trial = open_trial(example)
    with Recorder(tmp_path / "trial", trial.toml | {"motor": [motor]}) as recorder:
        for reading in (next(iter(trial.readings())), *added):
            recorder.add(reading)
    read = [row for row in open_trial(tmp_path / "trial").readings() if isinstance(row, NaturalLengthReading)]
    assert read == added
