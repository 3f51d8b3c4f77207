"""Plans: refused by line."""

import pytest

from plan_edits import PLANS, replaced
from tensegraph import InputError
from tensegraph.io.plan_file import read_plan


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
