"""Plans: refused by line, and extended by others."""

from dataclasses import replace
from pathlib import Path

import pytest

from plan_edits import CAUSES, DRIFT, PLANS, replaced
from tensegraph import InputError
from tensegraph.io.plan_file import plan_files, read_plan


def test_loads_without_number_are_refused(tmp_path) -> None:
    """Each of 0.01 s, without pauses, from 2 to 29 s: 2700, of which each step of the integration would ask all."""
    short = (("duration_s = [1.8, 3.8]", "duration_s = [0.01, 3.8]"), ("pause_s = [0.4, 1.3]", "pause_s = [0, 1.3]"))
    (tmp_path / "plan.toml").write_text(replaced(PLANS["press"].read_text(), *short))
    with pytest.raises(InputError, match=r"load.random\[0\].duration_s: .* for 2000 loads at most, got 2700"):
        read_plan(tmp_path / "plan.toml")


@pytest.mark.parametrize("name", sorted(PLANS))
def test_the_examples_are_plans(name) -> None:
    plan = read_plan(PLANS[name])
    assert plan.name == name


REFUSED = [
    ("rod_mass_kg = 0.030", "rod_mass_kg = -1", r"mechanics.rod_mass_kg: .*greater than 0, got -1"),
    ("rod_mass_kg = 0.030", "rod_mas_kg = 0.030", r"mechanics.rod_mas_kg: is no key of a plan"),
    ("rod_mass_kg = 0.030", "rod_mass_kg = inf", r"mechanics.rod_mass_kg: .*a finite number, got inf"),
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
    ("duration_s = 30.0", "duration_s = 1e5", r"duration_s: 100000 s in steps of 0.001 s take .* GiB of memory: expected at"),
    ("period_us = 20000", "period_us = 30000001", r"boards.period_us: expected a row or more in duration_s = 30.0, got 30000001"),
    ("step_s = 0.001", "step_s = 0.00001", r"mechanics.step_s: expected at least 0.0001 s, got 1e-05"),
    ("period_us = 20000", "period_us = 999", r"boards.period_us: expected mechanics.step_s, 1000 us, or more, got 999"),
    ("period_us = 20000", "period_us = 1", r"boards.period_us: 6e\+07 rows take 55.9 GiB of memory: expected at most 8 GiB"),
    ("rod_length_m = 0.3", "rod_length_sigma_m = 0.1\nrod_length_m = 0.3", r": structure.rod_length_sigma_m: expected at most 0.06"),
    ("rod_length_m = 0.3", "rod_length_m = -0.3", r"structure.rod_length_m\[0\]: expected a positive, finite length"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_what_cannot_be_is_refused_by_line(tmp_path, old, new, message) -> None:
    text = replaced(PLANS["press"].read_text(), (old, new))
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_plan(path)
    line = 1 + text[: text.index(new)].count("\n")
    assert str(error.value).startswith(f"{path}: line {line}: ")
    assert "\n" not in str(error.value)


def test_an_error_of_the_rest_shape_needs_a_rest_shape_that_is_measured(tmp_path) -> None:
    text = replaced(PLANS["press"].read_text(), ("node_position_sigma_m = 0.0003", ""))
    path = tmp_path / "plan.toml"
    path.write_text(f"{text}[geometry_error]\nrest_position_sigma_m = 0.002\n")
    line = text.count("\n") + 2
    message = (
        rf"line {line}: geometry_error.rest_position_sigma_m: expected rest.node_position_sigma_m too, .*got 0.002"
    )
    with pytest.raises(InputError, match=message):
        read_plan(path)


RANDOM = """from_s = 3.0
until_s = 20.0
pause_s = [0.5, 1.0]
duration_s = [2.0, 3.0]
ramp_share = 0.3
nodes = [3, 4, 5]
"""
HUG = f"""[[load.hug]]
{RANDOM}force_n = [0.5, 1.0]
force_spread = 0.3
axis = [0, 0, 0]
direction_sigma = 0.0
"""
SHAKE = f"""[[load.shake]]
{RANDOM}together = [1, 1]
force_n = [0.5, 1.0]
direction = [0, 0, 0]
direction_sigma = [1, 1, 1]
"""
LIFT = f"""[[load.lift]]
{RANDOM}height_m = [0.05, 0.2]
aside_m = [0.0, 0.1]
stiffness_n_per_m = 100.0
damping_n_s_per_m = 2.0
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


IMU = """[[imu]]
fraction = 0.5
rate_hz = 100.0
rate_noise_rad_per_s = 0.001
force_noise_m_per_s2 = 0.03
rate_bias_rad_per_s = 0.01
force_bias_m_per_s2 = 0.1
misalignment_rad = 0.02
range_m_per_s2 = 80.0
"""
RANGE = """[[range]]
rate_hz = 50.0
noise_m = 0.05
offset_m = 0.05
outlier_share = 0.0
outlier_m = 0.0
"""
POSITION = """[[position]]
rate_hz = 50.0
noise_m = 0.001
seen_s = 2.0
hidden_s = 1.0
"""


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ("[[fault.stuck]]\ntendon = 24\nfrom_s = 1.0\nuntil_s = 2.0", r"line {2}: fault.stuck\[0\].tendon: .*0 to 23"),
        ("[[fault.stuck]]\ntendon = 3\nfrom_s = 5.0\nuntil_s = 2.0", r"line {4}: fault.stuck\[0\].until_s: .*got 2.0"),
        ("[[fault.stuck]]\ntendon = 3\nfrom_s = 5.0", r"line {1}: fault.stuck\[0\].until_s: is missing"),
        ("[[fault.stuk]]\ntendon = 3", r"line {1}: fault.stuk: is no key of a plan: did you mean stuck\?"),
        ("[[bord]]\nrows = 3", r"line {1}: bord: is no key of a plan"),
        ("[[fault.unplugged]]\nboard = 2\nfrom_s = 1.0\nuntil_s = 2.0", r"line {2}: .*board from 0 to 1, got 2"),
        ("[[load.squeeze]]\nat_s = 3.0\nramp_s = 1.0\nhold_s = 1.0\nforce_n = 1.0\nnodes = [3, 3]", r"line {6}: load.sq"),
        ("[[load.hold]]\nat_s = 3.0\nramp_s = 0.0\nforce_n = 1.0\nnodes = [3]\ndirection = [0, 0, 1]", r"line {3}: .*got 0"),
        ("[[load.hold]]\nat_s = 3.0\nramp_s = 1.0\nforce_n = 1.0\nnodes = [3]\ndirection = [0, 0, 0]", r"line {6}: .*zero"),
        (f"{IMU}rod = 6", r"line {10}: imu\[0\].rod: expected a rod from 0 to 5, got 6"),
        (f"{IMU.replace('100.0', '800.0')}rod = 0", r"line {3}: imu\[0\].rate_hz: expected a whole number of steps .*got 1.25"),
        (f"{RANGE}beacon_position_m = []", r"line {7}: range\[0\].beacon_position_m: expected one beacon or more, got none"),
        (f"{POSITION.replace('2.0', '1e-9')}nodes = [3]", r"line {4}: position\[0\].seen_s: expected mechanics.step_s .*got 1e-09"),
        (f"{HUG.replace('2.0, 3.0', '1e-9, 1e-9')}together = [2, 3]", r"line {5}: load.hug\[0\].duration_s: .*got 1e-09"),
        (f"{POSITION}nodes = [3, 12]", r"line {6}: position\[0\].nodes\[1\]: expected a node from 0 to 11, got 12"),
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
        ("[geometry_error]\nrod_length_offset_m = -1.0", r"line {2}: geometry_error.rod_length_offset_m: expected at most 0.03 m either way, got -1.0"),
        ("[geometry_error]\nhub_radius_m = [0.01, 0.005]", r"line {2}: .*hub_radius_m: expected \[least, most\] up to 0.0425 m"),
        ("[geometry_error]\nhub_radius_m = [0.01, 0.1]", r"line {2}: geometry_error.hub_radius_m: .*got \[0.01, 0.1\]"),
        ("[[load.press]]\nat_s = 0.5\nramp_s = 0.5\nhold_s = 0.5\nnodes = [5]\nforce_n = 1.0\ndirection = [0, 0, 1]",
         r"line {2}: load.press\[0\].at_s: expected a time from rest.seconds = 2.0 .*got 0.5"),
        ("[[load.hug]]\nfrom_s = 3.0", r"line {1}: load.hug\[0\].until_s: is missing"),
        (f"{HUG}together = [1, 3]", r"line {12}: load.hug\[0\].together: expected at least 2 nodes, got 1"),
        (f"{HUG}together = [2, 4]", r"line {12}: load.hug\[0\].together: expected at most 3, the number of nodes, got 4"),
        (f"{HUG.replace('3, 4, 5', '0, 4, 5')}together = [2, 3]", r"line {7}: load.hug\[0\].nodes: .*can move, .*got 0"),
        (f"{SHAKE}frequency_hz = [8.0, 5.0]", r"line {12}: load.shake\[0\].frequency_hz: expected \[least, most\]"),
        (f"{SHAKE}frequency_hz = [5.0, 80.0]", r"line {12}: load.shake\[0\].frequency_hz: expected at most 50, which is 20 steps"),
        (f"{LIFT}turn_rad = [1.0, -1.0]", r"line {12}: load.lift\[0\].turn_rad: expected \[least, most\], got \[1.0, -1.0\]"),
        (f"{LIFT}turn_rad = [-1.0, 1.0]", r"line {1}: load.lift\[0\]: expected \[ground\]: what is lifted has no anchors"),
        (f"{LIFT.replace('3, 4, 5', '4, 5')}turn_rad = [-1.0, 1.0]", r"line {7}: load.lift\[0\].nodes: expected at least 3, got 2"),
        (f"{WIND}gust_share = 0.6", r"line {9}: load.wind\[0\].gust_share: .*at most 0.5, got 0.6"),
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


def test_a_fault_of_a_tendon_that_no_board_reads_is_refused(tmp_path) -> None:
    """It would stand in the truth, and never be seen."""
    text = replaced(PLANS["prism"].read_text(), ("[0, 1, 2, 3, 4, 5, 6, 7, 8]]", "[0, 1, 2, 3, 4, 5, 6, 8]]"))
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(InputError, match=r"fault.open_circuit\[0\].tendon: expected a tendon that a board .*got 7"):
        read_plan(tmp_path / "plan.toml")


def test_a_structure_that_nothing_holds_is_refused(tmp_path) -> None:
    text = PLANS["roll"].read_text().replace("press.toml", str(PLANS["press"]))
    (tmp_path / "plan.toml").write_text(replaced(text, ("[ground]\nfriction = 0.8", "[fault]\nstuck = []")))
    with pytest.raises(InputError, match=r"line \d+: structure.anchors: expected \[ground\] where there are none"):
        read_plan(tmp_path / "plan.toml")


def test_the_causes_are_plans_that_add_to_the_healthy_one() -> None:
    assert len(CAUSES) == 16
    for name, path in CAUSES.items():
        plan = read_plan(path)
        assert plan.name == name
        _, base, *_ = plan_files(path)
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
    assert plan.load == replace(base.load, random=())
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
        ("'load.random[x]' = 1", r"above.toml: line 2: load.random\[x\]: is no key of a plan"),
        ("'load.random[]' = 1", r"above.toml: line 2: load.random\[\]: is no key of a plan"),
    ],
)
def test_a_problem_is_told_of_the_file_it_stands_in(below, added, message) -> None:
    with pytest.raises(InputError, match=message):
        read_plan(above(below, added))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("3", r"below.toml: line 1: extends: expected the path of a plan, got 3"),
        (r'"a\u0000.toml"', r"below.toml: line 1: extends: expected the path of a plan, got 'a\\x00.toml'"),
        ("'nothing.toml'", r"below.toml: line 1: extends: .*nothing.toml: no such file"),
        (
            "'above.toml'",
            r"below.toml: line 1: extends: leads back to .*above.toml: expected a plan that does not",
        ),
    ],
)
def test_what_cannot_be_extended_is_said(below, edit, message) -> None:
    path = above(below, "")
    below.write_text(f"extends = {edit}\n{below.read_text()}")
    with pytest.raises(InputError, match=message):
        read_plan(path)


def test_a_long_chain_of_plans_is_read_to_its_end(below) -> None:
    files = 300
    for k in range(files):
        base = "below.toml" if k == 0 else f"plan_{k - 1}.toml"
        (below.parent / f"plan_{k}.toml").write_text(f'extends = "{base}"\nseed = {k}\n')
    plan = read_plan(below.parent / f"plan_{files - 1}.toml")
    assert plan == replace(read_plan(below), seed=files - 1)
