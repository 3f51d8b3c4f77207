"""Plans and the trials they make: refused by line, the same in form as recorded ones, the same bytes for one seed."""

import re
import runpy
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegraph import InputError, Settings, Trial, reconstruct
from tensegraph.commands.simulate import simulate
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.plan_file import base_plan_path, read_plan
from tensegraph.io.toml import line_of
from tensegraph.models.evaluation.truth import Fault
from tensegraph.pipeline import Pipeline

PLANS = {path.stem: path for path in (Path(__file__).parents[1] / "examples" / "plans").glob("*.toml")}
CAUSES = {path.stem: path for path in (PLANS["press"].parent / "causes").glob("*.toml")}


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


DRIFT = """[drift]
from_s = 1.0
common_share = 0.01
common_course = "ramp"
of = "resistance"
own_sigma = 0.0
own_course = "ramp"
"""
HUG = """[[load.hug]]
from_s = 3.0
until_s = 20.0
pause_s = [0.5, 1.0]
duration_s = [2.0, 3.0]
ramp_share = 0.3
nodes = [3, 4, 5]
force_n = [0.5, 1.0]
force_spread = 0.3
axis = [0, 0, 0]
direction_sigma = 0.0
"""
SHAKE = """[[load.shake]]
from_s = 3.0
until_s = 20.0
pause_s = [0.5, 1.0]
duration_s = [2.0, 3.0]
ramp_share = 0.3
nodes = [3, 4, 5]
together = [1, 1]
force_n = [0.5, 1.0]
direction = [0, 0, 0]
direction_sigma = [1, 1, 1]
"""
WIND = """[[load.wind]]
at_s = 3.0
ramp_s = 1.0
nodes = [3, 4, 5]
force_n = 0.5
force_spread = 0.3
direction = [1, 0, 0]
gust_period_s = [2.0, 7.0]
"""


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
        ("[drift]\nuntil_s = 3.0", r"line {1}: drift.from_s: is missing"),
        (f"{DRIFT}until_s = 1.0", r"line {8}: drift.until_s: expected a time after from_s = 1.0, got 1.0"),
        (f"{DRIFT}until_s = 60.0\ntime_constant_s = 5.0", r"line {9}: drift.time_constant_s: expected none .*got 5.0"),
        (f"{DRIFT.replace('ramp', 'warm_up', 1)}until_s = 60.0", r"line {4}: drift.common_course: expected time_constant_s"),
        (f"{DRIFT.replace('= 1.0', '= 30.0')}until_s = 60.0", r"line {2}: drift.from_s: expected less than .* got 30.0"),
        (f"{DRIFT.replace('0.01', '-1.0')}until_s = 60.0", r"line {3}: drift.common_share: expected more than -1, got -1.0"),
        (f"{DRIFT}until_s = 60.0\nshare = 1.0", r"line {9}: drift.share: is no key of a plan"),
        ("[hysteresis]\nhysteresis = -3.0\ncreep = 1.0", r"line {2}: hysteresis.hysteresis: .*got -3.0"),
        ("[hysteresis]\nhysteresis = 3.0", r"line {1}: hysteresis.creep: is missing"),
        ("[geometry_error]\nrod_length_sigma_m = -0.001", r"line {2}: geometry_error.rod_length_sigma_m: .*got -0.001"),
        ("[geometry_error]\nrod_length_offset_m = -1.0", r"line {2}: geometry_error.rod_length_offset_m: .*0.3 m, got 1.0"),
        ("[geometry_error]\nhub_radius_m = [0.01, 0.005]", r"line {2}: .*hub_radius_m: expected \[least, most\] up to 0.0425 m"),
        ("[geometry_error]\nhub_radius_m = [0.01, 0.1]", r"line {2}: geometry_error.hub_radius_m: .*got \[0.01, 0.1\]"),
        ("[[load.press]]\nat_s = 0.5\nramp_s = 0.5\nhold_s = 0.5\nnodes = [5]\nforce_n = 1.0\ndirection = [0, 0, 1]",
         r"line {2}: load.press\[0\].at_s: expected a time from rest.seconds = 2.0 .*got 0.5"),
        ("[[load.hug]]\nfrom_s = 3.0", r"line {1}: load.hug\[0\].until_s: is missing"),
        (f"{HUG}together = [1, 3]", r"line {12}: load.hug\[0\].together: expected at least 2, which have a middle, got 1"),
        (f"{HUG}together = [2, 4]", r"line {12}: load.hug\[0\].together: expected at most 3, as there are nodes, got 4"),
        (f"{HUG.replace('3, 4, 5', '0, 4, 5')}together = [2, 3]", r"line {7}: load.hug\[0\].nodes: .*can move, .*got 0"),
        (f"{SHAKE}frequency_hz = [8.0, 5.0]", r"line {12}: load.shake\[0\].frequency_hz: expected \[least, most\]"),
        (f"{SHAKE}frequency_hz = [5.0, 80.0]", r"line {12}: load.shake\[0\].frequency_hz: expected at most 50, 20 steps"),
        (f"{WIND}gust_share = 0.6", r"line {9}: load.wind\[0\].gust_share: .*less than or equal to 0.5, got 0.6"),
        (f"{WIND.replace('1, 0, 0', '0, 0, 0')}gust_share = 0.4", r"line {7}: load.wind\[0\].direction: .*got zero"),
    ],
)  # fmt: skip
def test_what_is_added_is_refused_by_line(tmp_path, added, message) -> None:
    text = PLANS["press"].read_text()
    first = text.count("\n")
    path = tmp_path / "plan.toml"
    path.write_text(text + added + "\n")
    for n in range(1, 13):
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
    truth_s, truth_m = made.truth()
    np.testing.assert_allclose(truth_s, np.arange(300) / 50)
    assert np.ptp(truth_m[:100], axis=0).max() < 5e-6  # rest.seconds
    assert np.ptp(truth_m, axis=0).max() > 0.005


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
    structure, (truth_s, truth_m) = trial.description.structure, trial.truth()
    frames = list(Pipeline(trial.description, Settings(), read_sensor_model()).lengths(trial.readings()))
    t_s = [frame.t_s for frame in frames]
    true_m = np.stack([np.interp(t_s, truth_s, column) for column in structure.tendon_length_m(truth_m).T], axis=1)
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
    np.testing.assert_array_equal(other.truth()[1], made.truth()[1])
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


# ---------------------------------------------------------------- plans that extend others


def test_the_causes_are_plans_that_add_to_the_healthy_one() -> None:
    assert len(CAUSES) == 15
    for name, path in CAUSES.items():
        plan = read_plan(path)
        assert plan.name == name
        base = base_plan_path(path)
        assert base is not None
        assert base.stem == ("press" if name == "healthy" else "healthy")
    assert replace(read_plan(CAUSES["healthy"]), name="press") == read_plan(PLANS["press"])


@pytest.fixture
def below(tmp_path) -> Path:
    """The press plan, to be extended by others beside it."""
    path = tmp_path / "below.toml"
    path.write_text(PLANS["press"].read_text())
    return path


def above(below: Path, text: str) -> Path:
    path = below.parent / "above.toml"
    path.write_text(f'extends = "below.toml"\n{text}')
    return path


def test_tables_are_added_to_and_lists_replaced(below) -> None:
    text = "[mechanics]\nrod_mass_kg = 0.05\n[load]\nrandom = []\n[sensors]\ngauge_factor = [1, 2, 3]\n"
    plan, base = read_plan(above(below, text)), read_plan(below)
    assert plan.load == replace(base.load, random=[])
    assert plan.mechanics == replace(base.mechanics, rod_mass_kg=0.05)
    assert plan.sensors == replace(base.sensors, gauge_factor=[1, 2, 3])
    assert plan.boards == base.boards


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ("[mechanics]\nrod_mass_kg = -1", r"above.toml: line 3: mechanics.rod_mass_kg: .*got -1"),
        ("[mechanics]\nrod_mas_kg = 1", r"above.toml: line 3: mechanics.rod_mas_kg: is no key of a plan"),
        ("[rest]\nseconds = 4.0", r"below.toml: line 83: load.random\[0\].from_s: .*rest.seconds = 4.0 .*got 2.0"),
        ("[load]\nrandom = [{ from_s = 3.0 }]", r"above.toml: line 3: load.random\[0\].until_s: is missing"),
        ("[hysteresis]\ncreep = 3.0", r"above.toml: line 2: hysteresis.hysteresis: is missing"),
    ],
)
def test_a_problem_is_told_of_the_file_it_stands_in(below, added, message) -> None:
    with pytest.raises(InputError, match=message):
        read_plan(above(below, added))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("3", r"below.toml: line 1: extends: expected the path of a plan, got 3"),
        ("'nothing.toml'", r"nothing.toml: no such file"),
        ("'above.toml'", r"below.toml: line 1: extends: comes back to .*above.toml: expected a plan below"),
    ],
)
def test_what_can_not_be_extended_is_said(below, edit, message) -> None:
    path = above(below, "")
    below.write_text(f"extends = {edit}\n{below.read_text()}")
    with pytest.raises(InputError, match=message):
        read_plan(path)


# ---------------------------------------------------------------- causes, through the whole twin

NEUTRAL = """
[drift]
from_s = 0.0
until_s = 60.0
of = "resistance"
common_share = 0.0
common_course = "ramp"
own_sigma = 0.0
own_course = "walk"

[hysteresis]
hysteresis = 1.0
creep = 1.0

[geometry_error]
rod_length_sigma_m = 0.0
"""


def with_cause(tmp_path: Path, cause: str, *edits: tuple[str, str]) -> Trial:
    """Six seconds of the press plan with a cause, as a trial of the same name as without."""
    (tmp_path / "press.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT, *edits) + cause)
    return simulate(tmp_path / "press.toml", tmp_path / "press_01")


def names_of_bytes_that_differ(one: Trial, other: Trial) -> set[str]:
    return {file.name for file in one.path.iterdir() if (other.path / file.name).read_bytes() != file.read_bytes()}


def test_causes_that_do_nothing_change_no_byte(made, tmp_path) -> None:
    assert names_of_bytes_that_differ(with_cause(tmp_path, NEUTRAL), made) == set()


def test_seeds_draw_what_they_drew_before_there_were_causes(made) -> None:
    """Numbers of the first version of the twin: numpy's generators give them on any machine."""
    assert made.toml["sensors"]["natural_resistance_ohm"][:4] == [4502570, 6384821, 5369242, 4661713]
    assert made.toml["structure"]["natural_length_m"][:4] == [0.16946, 0.17049, 0.16971, 0.1712]


def test_all_sensors_drift_to_3_percent_of_r_at_the_time_said(made, tmp_path) -> None:
    drift = DRIFT.replace("0.01", "0.03") + "until_s = 5.0\n"
    warm = with_cause(tmp_path, drift)
    assert names_of_bytes_that_differ(warm, made) == {"board0.csv", "board1.csv"}
    divider = made.description.divider
    for board in (0, 1):
        was, now = (
            np.array([divider.resistance_ohm(row.counts) for row in trial.readings() if row.board == board])
            for trial in (made, warm)
        )
        t_s = np.array([row.host_s for row in warm.readings() if row.board == board])
        ratio = now / was
        for since_s, until_s, share in ((0.0, 1.0, 0.0), (2.9, 3.1, 0.015), (5.1, 6.0, 0.03)):
            during = (t_s > since_s) & (t_s < until_s)
            np.testing.assert_allclose(ratio[during].mean(axis=0) - 1, share, atol=0.002)  # a code is 0.4 %


def test_what_is_told_wrongly_stands_in_trial_toml_alone(made, tmp_path) -> None:
    error = "[geometry_error]\nrod_length_sigma_m = 0.001\nanchor_sigma_m = 0.002\nrest_position_sigma_m = 0.002\n"
    off = with_cause(tmp_path, error)
    assert names_of_bytes_that_differ(off, made) == {"trial.toml"}
    told, true = off.description, made.description
    np.testing.assert_array_equal(told.structure.natural_length_m, true.structure.natural_length_m)
    for error_m, sigma_m in (
        (told.structure.rod_length_m - 0.3, 0.001),
        (told.structure.anchor_position_m - true.structure.anchor_position_m, 0.002),
        (told.rest_position_m - true.rest_position_m, 0.002),
    ):
        assert 0.3 * sigma_m < error_m.std() < 2 * sigma_m


def test_hubs_shorten_tendons_and_keep_strains_at_rest(made, tmp_path) -> None:
    """Across two hubs of 5 to 10 mm a tendon of the six-strut loses 0.58 and 0.91 of their radii: 11 mm on average."""
    hubs = with_cause(tmp_path, "[geometry_error]\nhub_radius_m = [0.005, 0.010]\n")
    shorter_m = made.description.structure.natural_length_m - hubs.description.structure.natural_length_m
    assert 0.0075 / 1.08 < shorter_m.min() < shorter_m.max() < 0.015 / 1.08
    assert shorter_m.mean() == pytest.approx(0.0112 / 1.08, rel=0.1)
    first = [np.array([row.counts for row in t.readings() if row.board == 0])[:90].mean(axis=0) for t in (made, hubs)]
    assert np.abs(first[1] - first[0]).max() < 3
    assert np.abs(hubs.truth()[1][0] - made.truth()[1][0]).max() < 0.005


def test_a_touch_while_taring_moves_it_at_rest(made, tmp_path) -> None:
    touch = CAUSES["touched"].read_text().partition("[[load.press]]")[2]
    touched = with_cause(tmp_path, f"[[load.press]]{touch}")
    t_s, moved_m = touched.truth()[0], np.ptp(touched.truth()[1][:100], axis=0)
    assert moved_m.max() > 0.003
    np.testing.assert_array_equal(touched.truth()[1][0], made.truth()[1][0])
    load_n = np.linalg.norm(touched.true_loads().force_n, axis=2)
    np.testing.assert_allclose(load_n[(t_s > 0.61) & (t_s < 1.19)][:, 5], 1.0, atol=1e-3)
    assert not load_n[(t_s > 1.62) & (t_s < 2.0)].any()
    assert touched.description.rest_position_m == pytest.approx(made.description.rest_position_m)


def test_an_unplugged_hub_is_a_gap_of_all_boards(tmp_path) -> None:
    boards = "".join(f"[[fault.unplugged]]\nboard = {board}\nfrom_s = 4.0\nuntil_s = 5.0\n" for board in (0, 1))
    gap = with_cause(tmp_path, boards)
    arrival_s = np.array([row.host_s for row in gap.readings()])
    assert not ((arrival_s > 4.02) & (arrival_s < 5.0)).any()
    assert np.diff(arrival_s).max() == pytest.approx(1.0, abs=0.03)
    assert {fault.where for fault in gap.faults()} == {"board 0", "board 1"}


def test_sensors_left_out_for_longer_than_a_second_count() -> None:
    """The benchmark's own count: 0.9 s is a moment, 1.1 s is not; a board that is unplugged excuses its sensors."""
    benchmark = runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "causes.py"))
    t_s = np.arange(500) * 0.02
    sigma_m = np.full((500, 4), 0.001)
    sigma_m[100:146, 0] = sigma_m[100:156, 1] = sigma_m[300:400, 2] = sigma_m[:, 3] = np.inf
    estimate = SimpleNamespace(t_s=t_s, sigma_m=sigma_m)
    gap = Fault("unplugged", "board 0", np.array([2]), t_s[300], t_s[400])
    dead = Fault("open_circuit", "tendon 3", np.array([3]), 1.0, 2.0)
    assert benchmark["left_out_share"](estimate, [gap, dead]) == pytest.approx(1 / 3)
    assert benchmark["left_out_share"](estimate, []) == pytest.approx(3 / 4)
