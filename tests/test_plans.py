"""Plans and the trials they make: refused by line, the same in form as recorded ones, the same bytes for one seed."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegraph import InputError, Settings, Trial, reconstruct
from tensegraph.commands.simulate import simulate
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.plan_file import read_plan
from tensegraph.io.toml import line_of
from tensegraph.pipeline import Pipeline

PLANS = {path.stem: path for path in (Path(__file__).parents[1] / "examples" / "plans").glob("*.toml")}


def replaced(text: str, *edits: tuple[str, str]) -> str:
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    return text


SHORT = (("duration_s = 30.0", "duration_s = 6.0"), ("until_s = 29.0", "until_s = 6.0"))


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Trial:
    """Six seconds of the press plan."""
    folder = tmp_path_factory.mktemp("plans")
    (folder / "press.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT))
    return simulate(folder / "press.toml", folder / "press_01")


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize("name", sorted(PLANS))
def test_the_examples_are_plans(name) -> None:
    plan = read_plan(PLANS[name])
    assert plan.name == name


REFUSED = [
    ("rod_mass_kg = 0.030", "rod_mass_kg = -1", r"mechanics.rod_mass_kg: .*greater than 0, got -1"),
    ("rod_mass_kg = 0.030", "rod_mas_kg = 0.030", r"mechanics.rod_mas_kg: is no key of a plan"),
    ("rod_mass_kg = 0.030", "rod_mass_kg = inf", r"mechanics.rod_mass_kg: expected a finite number, got inf"),
    ("gauge_factor = [0.823, 2.11, 4.28]", "gauge_factor = [0.823, 'x', 4.28]", r"sensors.gauge_factor\[1\]: .*got 'x'"),
    ("gauge_corner_strain = [0.111, 0.494]", "gauge_corner_strain = [0.111]", r"expected 2 numbers, got 1"),
    ("gauge_corner_strain = [0.111, 0.494]", "gauge_corner_strain = [0.5, 0.4]", r"expected rising strains"),
    ("overstress_time_s = [0.39, 5.4]", "overstress_time_s = [0.39]", r"overstress_time_s: expected 2 numbers, got 1"),
    ("hysteresis_at_rest = 0.0", "hysteresis_at_rest = 1.5", r"expected at most 1, got 1.5"),
    ("nodes = [5, 8, 11]", "nodes = [5, 8, 12]", r"load.random\[0\].nodes: expected nodes that can move, .*got 12"),
    ("nodes = [5, 8, 11]", "nodes = [5, 8, 1]", r"load.random\[0\].nodes: expected nodes that can move, .*got 1$"),
    ("nodes = [5, 8, 11]", "nodes = [5, 5, 11]", r"load.random\[0\].nodes: expected different nodes, got 5, 5, 11"),
    ("together = [1, 2]", "together = [1, 4]", r"load.random\[0\].together: expected at most 3, .*got 4"),
    ("force_n = [0.9, 3.1]", "force_n = [3.1, 0.9]", r"load.random\[0\].force_n: expected \[least, most\]"),
    ("ramp_share = 0.28", "ramp_share = 0.6", r"load.random\[0\].ramp_share: expected at most 0.5, got 0.6"),
    ("from_s = 2.0", "from_s = 1.0", r"load.random\[0\].from_s: expected a time from rest.seconds = 2.0 .*got 1.0"),
    ("until_s = 29.0", "until_s = 31.0", r"load.random\[0\].until_s: .*at most duration_s = 30.0, got 31.0"),
    ("direction = [0.0, 0.0, -1.0]", "direction = [0.0, 0.0]", r"load.random\[0\].direction"),
    ("seconds = 2.0 ", "seconds = 40.0 ", r"rest.seconds: expected less than duration_s = 30.0, got 40.0"),
    ("rate_hz = 50.0", "rate_hz = 33.0", r"truth.rate_hz: expected a whole number of steps of 0.001 s"),
    ("bits = 10", "bits = 99", r"adc.bits: expected 1 to 24, got 99"),
    ('sensor_side = "ground"', 'sensor_side = "left"', r"adc.sensor_side: .*got 'left'"),
    ("[12, 13, 14,", "[11, 13, 14,", r"boards.tendon_of_channel\[1\]: tendon 11 is wired already"),
    ("[12, 13, 14,", "[24, 13, 14,", r"boards.tendon_of_channel\[1\]: expected tendons from 0 to 23, got 24"),
    ("lost_rows = 0.004", "lost_rows = 1.0", r"boards.lost_rows: .*less than 1, got 1.0"),
    ("anchors = [0, 1, 2] ", "anchors = [0, 1, 3] ", r"structure.anchors: rod 0 is 0.3 m long, its anchors 0.183\d+ m apart"),
    ("rod_length_m = 0.3", "rod_length_m = -0.3", r"structure.rod_length_m\[0\]: expected a positive, finite length"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_what_can_not_be_is_refused_by_line(tmp_path, old, new, message) -> None:
    text = replaced(PLANS["press"].read_text(), (old, new))
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_plan(path)
    line = 1 + text[: text.index(new)].count("\n")
    assert str(error.value).startswith(f"{path}: line {line}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ("[[fault.stuck]]\ntendon = 24\nfrom_s = 1.0\nuntil_s = 2.0", r"line {2}: fault.stuck\[0\].tendon: .*0 to 23"),
        ("[[fault.stuck]]\ntendon = 3\nfrom_s = 5.0\nuntil_s = 2.0", r"line {4}: fault.stuck\[0\].until_s: .*got 2.0"),
        ("[[fault.stuck]]\ntendon = 3\nfrom_s = 5.0", r"line {1}: fault.stuck\[0\].until_s: is missing"),
        ("[[fault.stuk]]\ntendon = 3", r"line {1}: fault.stuk: is no key of a plan"),
        ("[[fault.unplugged]]\nboard = 2\nfrom_s = 1.0\nuntil_s = 2.0", r"line {2}: .*board from 0 to 1, got 2"),
        ("[[load.squeeze]]\nat_s = 3.0\nramp_s = 1.0\nhold_s = 1.0\nforce_n = 1.0\nnodes = [3, 3]", r"line {6}: load.sq"),
        ("[[load.hold]]\nat_s = 3.0\nramp_s = 0.0\nforce_n = 1.0\nnodes = [3]\ndirection = [0, 0, 1]", r"line {3}: .*got 0"),
        ("[[load.hold]]\nat_s = 3.0\nramp_s = 1.0\nforce_n = 1.0\nnodes = [3]\ndirection = [0, 0, 0]", r"line {6}: .*zero"),
        ("[ground]\nfriction = -1.0", r"line {2}: ground.friction: .*got -1.0"),
    ],
)  # fmt: skip
def test_what_is_added_is_refused_by_line(tmp_path, added, message) -> None:
    text = PLANS["press"].read_text()
    first = text.count("\n")
    path = tmp_path / "plan.toml"
    path.write_text(text + added + "\n")
    for n in range(1, 7):
        message = message.replace(f"{{{n}}}", str(first + n))
    with pytest.raises(InputError, match=message):
        read_plan(path)


def test_lines_of_keys() -> None:
    text = 'a = 1\n\n[t] # x\nb = [\n  [0],\n  [1],\n]\ns = """\n[u]\n"""\n[[t.l]]\nc = 1\n[[t.l]]\nd.e = 2\n'
    assert tomllib.loads(text)["t"]["l"][1] == {"d": {"e": 2}}
    lines = {"a": 1, "t": 3, "t.b": 4, "t.b[1][0]": 4, "t.s": 8, "t.l[0].c": 12, "t.l[1]": 13, "t.l[1].d.e": 14, "z": 1}
    assert {key: line_of(text, key) for key in lines} == lines


# ---------------------------------------------------------------- what is written


def shape_of(value: object) -> object:
    """A TOML value's types, and the lengths of its lists."""
    if isinstance(value, dict):
        return {key: shape_of(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [shape_of(inner) for inner in value]
    return type(value)


def form(path: Path) -> list[tuple[str, ...]]:
    """The header, and every form that a row's cells take: digits before the point do not count."""
    header, *rows = path.read_bytes().decode().split("\r\n")
    assert rows.pop() == ""
    return [(header,), *sorted({tuple(re.sub(r"^-?\d+", "9", cell) for cell in row.split(",")) for row in rows[:1]})]


def test_a_twin_s_trial_is_one_in_form(made, example) -> None:
    """Same files, columns, digits and line ends; same keys, types and list lengths in trial.toml."""
    assert {p.name for p in made.path.iterdir()} == {p.name for p in example.iterdir()}
    mine, theirs = made.toml, tomllib.loads((example / "trial.toml").read_text())
    assert shape_of(mine) == shape_of(theirs)
    assert list(mine) == list(theirs)
    assert not made.description.ignored_keys
    for name in ("board0.csv", "board1.csv", "truth.csv", "loads.csv"):
        digits = [
            [len(cell.partition(".")[2]) for cell in row]
            for row in (form(made.path / name)[1], form(example / name)[1])
        ]
        assert form(made.path / name)[0] == form(example / name)[0]
        assert digits[0] == digits[1]


def test_rows_come_as_boards_send_them(made) -> None:
    for board in (0, 1):
        rows = [row for row in made.readings() if row.board == board]
        seq, device_us = np.array([row.seq for row in rows]), np.array([row.device_us for row in rows])
        host_s = np.array([row.host_s for row in rows])
        assert 290 < len(rows) <= 300
        assert seq[0] <= 1
        np.testing.assert_array_equal(np.diff(device_us), 20_000 * np.diff(seq))
        assert (np.diff(host_s) > 0).all()
    truth = made.truth()
    np.testing.assert_allclose(truth.t_s, np.arange(300) / 50)
    assert np.ptp(truth.node_position_m[:100], axis=0).max() < 5e-6  # rest.seconds
    assert np.ptp(truth.node_position_m, axis=0).max() > 0.005


def test_same_plan_and_seed_same_bytes_another_seed_another_trial(made, tmp_path) -> None:
    plan = made.path.parent / "press.toml"
    again = simulate(plan, tmp_path / "again")
    other = simulate(plan, tmp_path / "other", seed=2)
    assert other.name == "press_02"
    for file in made.path.iterdir():
        assert (again.path / file.name).read_bytes() == file.read_bytes(), file.name
        assert (other.path / file.name).read_bytes() != file.read_bytes(), file.name


def test_faults_stand_in_the_truth(tmp_path) -> None:
    edits = (*SHORT, ("until_s = 22.0", "until_s = 5.9"), ("from_s = 7.0", "from_s = 3.0"))
    edits += (("at_s = 23.0", "at_s = 5.0"), ("from_s = 26.0", "from_s = 4.0"), ("until_s = 30.0", "until_s = 6.0"))
    text = PLANS["prism"].read_text()
    for old, new in edits:
        text = text.replace(old, new)
    (tmp_path / "prism.toml").write_text(text)
    trial = simulate(tmp_path / "prism.toml", tmp_path / "out")
    fault = {"kind": "open_circuit", "tendon": 7, "from_s": 4.0, "until_s": 6.0}
    assert trial.toml["truth"]["fault"] == [fault]
    counts = np.array([row.counts[7] for row in trial.readings()])
    assert (counts[210:] == 1023).all()
    result = reconstruct(trial, "live")
    assert result.node_position_m.shape[1:] == (6, 3)
    assert np.isfinite(result.node_position_m).all()


# ---------------------------------------------------------------- the estimator, in worlds unlike its sensor model


def length_error_m(trial: Trial) -> NDArray[np.float64]:
    """(frames, free tendons) of the front end."""
    structure, truth = trial.description.structure, trial.truth()
    frames = list(Pipeline(trial.description, Settings(), read_sensor_model()).lengths(trial.readings()))
    t_s = [frame.t_s for frame in frames]
    true_m = structure.tendon_length_m(truth.node_position_m)
    true_m = np.stack([np.interp(t_s, truth.t_s, column) for column in true_m.T], axis=1)
    return (np.array([frame.length_m for frame in frames]) - true_m)[:, structure.free_tendons]


WORLDS = {
    "gauge": (("gauge_factor = [0.823, 2.11,", "gauge_factor = [0.4, 5.0,"), ("strain = [0.111", "strain = [0.08")),
    "hysteresis": (("hysteresis_gain = [0.215, 0.188, 0.118]", "hysteresis_gain = [0.6, 0.5, 0.3]"),),
    "fresh": (("hysteresis_at_rest = 0.0", "hysteresis_at_rest = 1.0"),),
    "slow": (("stretching_time_s = [0.122, 0.402]", "stretching_time_s = [0.6, 2.0]"),),
}
"""Sensors of other kinds than those the shipped model was trained on."""


@pytest.mark.parametrize("world", sorted(WORLDS))
def test_sensors_of_another_kind_are_measured_worse(made, tmp_path, world) -> None:
    """The twin is no copy of the estimator's sensor model: agreement is lost with its sensors, and only so much.

    The motion is the same in all worlds, so that only the sensor differs.
    """
    (tmp_path / "plan.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT, *WORLDS[world]))
    other = simulate(tmp_path / "plan.toml", tmp_path / "out")
    np.testing.assert_array_equal(other.truth().node_position_m, made.truth().node_position_m)
    ordinary, worse = (np.sqrt(np.nanmean(length_error_m(trial) ** 2)) for trial in (made, other))
    assert ordinary < 0.001
    assert 1.2 * ordinary < worse < 0.03


def test_a_plan_that_is_not_there_and_a_trial_that_is(tmp_path) -> None:
    with pytest.raises(InputError, match=r"none.toml: no such file"):
        simulate(tmp_path / "none.toml", tmp_path / "out")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=r"out: exists: expected a new name"):
        simulate(PLANS["press"], tmp_path / "out")
    assert not any((tmp_path / "out").iterdir())
