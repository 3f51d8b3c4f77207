"""The files of inertial sensors, ranges and positions, and what is refused in them and in trial.toml."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from roll import roll
from tensegraph import InputError, open_trial
from tensegraph.io.aid_files import aid_row
from tensegraph.models.trial_description import describe_trial
from tensegraph.models.values.aids import AidReading, ImuReading, PositionReading, RangeReading
from trial_edits import rewritten, stamped

RANGES = "t_s,beacon,node,range_m\n0.0,0,3,2.5\n0.1,1,4,2.6\n"
POSITIONS = "t_s,node,x_m,y_m,z_m\n0.0,3,0.1,0.2,0.3\n0.0,4,0.1,0.2,0.3\n"
BEACONS = '\n[[range]]\nfile = "ranges.csv"\nbeacon_position_m = [[0, 0, 2], [2, 0, 2]]\n'


@pytest.fixture
def trial(tmp_path):
    """Makes a copy of the trial with text added to trial.toml, and with files."""

    def make(toml: str = "", edit=lambda text: text, **files: str) -> Path:
        path = roll(tmp_path / "trial", edit=lambda text: edit(text) + toml)
        for name, content in files.items():
            (path / f"{name}.csv").write_text(content)
        return path

    return make


def aids(path: Path) -> list:
    return [reading for reading in open_trial(path).readings() if isinstance(reading, AidReading)]


def test_readings_of_all_sensors_are_merged_by_time(trial) -> None:
    path = trial(BEACONS + '[[position]]\nfile = "positions.csv"\n', ranges=RANGES, positions=POSITIONS)
    read = aids(path)
    kinds = {type(reading) for reading in read}
    assert kinds == {ImuReading, RangeReading, PositionReading}
    assert [reading.t_s for reading in read] == sorted(reading.t_s for reading in read)
    far = next(reading for reading in read if isinstance(reading, RangeReading) and reading.t_s > 0)
    assert far.pair == (0, 1, 4)
    assert far.beacon_position_m.tolist() == [2, 0, 2]


def test_stamps_that_are_close_together_stay_two() -> None:
    """As of USB bursts, 0.03 ms apart; others have four decimals, as before."""
    stamps = [aid_row(ImuReading(0, t_s, np.zeros(3), np.zeros(3))).split(",")[0] for t_s in (0.02151, 0.02154, 0.5)]
    assert stamps == ["0.021510", "0.021540", "0.5000"]


def test_lengths_in_milliseconds_of_a_robot_with_an_inertial_sensor_are_refused(trial) -> None:
    """A thousand frames would be made between two rows."""
    path = trial()
    table = tomllib.loads((path / "trial.toml").read_text())
    for key in ("board", "adc", "sensors"):
        table.pop(key, None)
    tendons = len(table["structure"]["tendons"])
    header = ",".join(["t_s", *(f"l{k}_m" for k in range(tendons))])
    rows = "\n".join(",".join([f"{20.0 * k}", *["0.184"] * tendons]) for k in range(10))
    (path / "lengths.csv").write_text(f"{header}\n{rows}\n")
    (path / "trial.toml").write_text(tomli_w.dumps(table | {"lengths": {"file": "lengths.csv"}}))
    with pytest.raises(
        InputError, match=r"lengths.csv: column t_s: expected rows at most 0.5 s apart, got 20 s and more"
    ):
        list(open_trial(path).readings())


def test_stamps_of_an_inertial_sensor_in_milliseconds_are_refused(trial) -> None:
    path = trial()
    rewritten(path / "imu0.csv", stamped(lambda t_s: 1000 * t_s))
    with pytest.raises(
        InputError, match=r"imu0.csv: column t_s: expected rows at most 0.5 s apart, .* is the unit right"
    ):
        aids(path)


def test_half_a_line_at_the_end_of_each_file_is_left_out_and_counted(trial) -> None:
    path = trial(
        BEACONS + '[[position]]\nfile = "positions.csv"\n', ranges=RANGES + "0.2,1,4", positions=POSITIONS + "0.1,3,0.1"
    )
    whole = aids(path)
    imu = path / "imu0.csv"
    imu.write_text(imu.read_text().rstrip("\n"))
    opened = open_trial(path)
    read = [reading for reading in opened.readings() if isinstance(reading, AidReading)]
    assert opened.half_lines == 3
    assert len(whole) - len(read) == 1  # the sample whose line has lost its end
    assert sum(isinstance(reading, RangeReading) for reading in read) == 2
    assert sum(isinstance(reading, PositionReading) for reading in read) == 2


REFUSED_ROWS = {
    "row 3, column node: expected an integer from 0 to 11, got 40": RANGES.replace("1,4,", "1,40,"),
    "row 3, column beacon: expected an integer from 0 to 1, got 7": RANGES.replace("1,4,", "7,4,"),
    "row 3, column range_m: expected a positive distance": RANGES.replace("2.6", "-2.6"),
    "row 3, column t_s: expected a stamp not before 0.0": RANGES.replace("0.1,1", "-0.1,1"),
    "column 'range_m' is missing": RANGES.replace("range_m", "metres"),
}


@pytest.mark.parametrize("message", REFUSED_ROWS)
def test_a_row_that_cannot_be_is_refused(message, trial) -> None:
    path = trial(BEACONS, ranges=REFUSED_ROWS[message])
    with pytest.raises(InputError, match=r"ranges\.csv") as refused:
        aids(path)
    assert message in str(refused.value)


REFUSED_TABLES = {
    "ground.normal: expected a unit vector upward": lambda text: text.replace(
        "[mechanics]", "normal = [0.0, 0.0, -1.0]\n\n[mechanics]"
    ),
    "rest.node_position_m: expected the lowest node to stand on the floor, at ground.height_m = 0.11 m, got 0.1 m "
    "below that": lambda text: text.replace("height_m = 0.01", "height_m = 0.11"),
    "ground.normal_sigma_rad: expected at most 0.3 rad, got 10.0": lambda text: text.replace(
        "[ground]", "[ground]\nnormal_sigma_rad = 10.0"
    ),
    "ground.cap_radius_m: expected at most 0.06, a fifth of the shortest rod, got 10: is the unit": lambda text: (
        text.replace("[ground]", "[ground]\ncap_radius_m = 10.0")
    ),
    "ground.normal_sigma_rad: expected a number of at least 0, got -0.1": lambda text: text.replace(
        "[ground]", "[ground]\nnormal_sigma_rad = -0.1"
    ),
    "imu[0].rod: expected a rod from 0 to 5": lambda text: text.replace("rod = 4", "rod = 9"),
    "imu[0].axis: expected a unit vector": lambda text: text.replace("axis = [0, 0, 1]", "axis = [0, 0, 3]"),
    "imu[0].fraction: expected a number from 0 to 1": lambda text: text.replace("fraction = 0.5", "fraction = 50"),
    "imu[0]: expected file, or the board that reads it, got neither": lambda text: text.replace(
        'file = "imu0.csv"', ""
    ),
    "imu[0].file: is missing": lambda text: text.replace('file = "imu0.csv"', "board = 0"),
    "imu[0].board: expected the number of one of 2 boards, got 2": lambda text: text.replace(
        'file = "imu0.csv"', "board = 2"
    ),
    "imu[0].sensor: expected a number from 0 to 255, each once on a board, got 256": lambda text: text.replace(
        'file = "imu0.csv"', "board = 0\nsensor = 256"
    ),
    "imu[1].sensor: expected a number from 0 to 255, each once on a board, got 0": lambda text: text.replace(
        'file = "imu0.csv"', "board = 0\nrod = 1\naxis = [0, 0, 1]\n\n[[imu]]\nboard = 0"
    ),
    "position[0].frame: expected 'world' or 'own', got 'lab'": lambda text: text.replace(
        "[[imu]]", '[[position]]\nfile = "positions.csv"\nframe = "lab"\n\n[[imu]]'
    ),
    "range: expected at most 500 pairs of a beacon and a node in all [[range]] tables, got 42 beacons": lambda text: (
        text + '[[range]]\nfile = "ranges.csv"\nbeacon_position_m = [' + 42 * "[1.0, 1.0, 1.0], " + "]\n"
    ),
    "[[imu]]: expected [ground]": lambda text: text.replace("[ground]", "[grounds]"),
    "rest: expected seconds above 0 and node_position_m with [ground]": lambda text: text.replace(
        "seconds = 2.0", "seconds = 0.0"
    ),
}


FLAT = """
[structure]
rods = [[0, 2], [1, 3]]
tendons = [[0, 1], [1, 2], [2, 3], [0, 3]]
rod_length_m = 0.42426
natural_length_m = 0.28
anchors = []
anchor_position_m = []

[rest]
seconds = 0.5
node_position_m = [[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0]]

[mechanics]
tendon_stiffness_n_per_m = 400.0
rod_mass_kg = 0.03

[lengths]
file = "lengths.csv"

[ground]
height_m = 0.0
"""


def test_a_robot_that_is_flat_is_refused_on_a_floor() -> None:
    """It has no faces onto which it could tip; held in a hand it is taken."""
    table = tomllib.loads(FLAT)
    with pytest.raises(InputError, match=r"rest\.node_position_m: expected nodes that are not all in one plane"):
        describe_trial(table, "trial.toml")
    del table["ground"]
    _, description = describe_trial(table, "trial.toml")
    assert description.robot is None


@pytest.mark.parametrize("message", REFUSED_TABLES)
def test_a_table_that_cannot_be_is_refused(message, trial) -> None:
    path = trial(edit=REFUSED_TABLES[message])
    with pytest.raises(InputError) as refused:
        open_trial(path)
    assert message in str(refused.value)


def test_a_missing_file_is_named(trial) -> None:
    path = trial()
    (path / "imu0.csv").unlink()
    with pytest.raises(InputError, match=r"imu0\.csv: no such file"):
        open_trial(path)
