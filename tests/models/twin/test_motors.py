"""Motors of the twin: their course by hand, what they tell, and the structure that they move."""

from dataclasses import replace

import numpy as np
import pytest

from plan_edits import PLANS, replaced
from tensegraph import InputError
from tensegraph.io.plan_file import read_plan
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.loads import Loads
from tensegraph.models.twin.motors import MotorPlan, wound_m
from twin_bodies import body, resting

PLAN = MotorPlan(
    tendons=[3, 5],
    strip_length_m=0.1,
    at_s=[1.0, 2.0, 5.0],
    change_m=[-0.03, 0.01, 0.0],
    speed_m_per_s=0.02,
    rate_hz=10.0,
    noise_m=0.0001,
    drum_sigma=0.02,
)


def test_the_course_by_hand() -> None:
    """At 20 mm/s: -30 mm is not reached in one second, then +10 mm is, and home."""
    t_s = np.array([0.0, 1.0, 1.5, 2.0, 2.5, 3.5, 4.9, 5.25, 5.5, 9.0])
    expected_m = [0.0, 0.0, -0.01, -0.02, -0.01, 0.01, 0.01, 0.005, 0.0, 0.0]
    assert PLAN.told_m(t_s) == pytest.approx(expected_m)


def test_what_is_told_is_as_wrong_as_its_sigma_says() -> None:
    """The drum's error over the whole of one motion, on many seeds: normal with the sigma of the rows."""
    t_s = np.arange(0.0, 10.0, 0.1)
    z = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        true_m = wound_m([PLAN], t_s, 9, rng)
        assert not true_m[:, 4].any()
        rows = PLAN.readings(np.full(9, 0.17), 10.0, rng)
        assert [row.t_s for row in rows] == sorted(row.t_s for row in rows)
        late = [row for row in rows if row.tendon == 5][40]  # at 4 s, +10 mm: 0.2 mm by the drum and 0.1 mm of noise
        assert late.sigma_m == pytest.approx(np.hypot(0.0002, 0.0001))
        z.append((late.natural_length_m - 0.17 - true_m[40, 5]) / late.sigma_m)
    assert np.std(z) == pytest.approx(1.0, abs=0.15)


def test_the_structure_comes_to_rest_where_forces_balance_with_the_new_natural_lengths() -> None:
    structure, shape_m = resting(6)
    made = body(structure)
    twin = Twin(made, 1e-3, shape_m)
    twin.settle()
    change_m = np.zeros((4000, 9))
    change_m[:, 3] = -np.minimum(np.arange(4000) * 1e-5, 0.01)
    x = twin.run(Loads([]), 4000, wound_m=change_m).node_position_m
    mechanics = Mechanics(made.stiffness_n_per_m, structure.natural_length_m, made.rod_mass_kg, made.push_back)
    statics = Statics(structure, mechanics)
    assert np.abs(statics.residual_n(x[-1])).max() > 0.5
    assert np.abs(statics.wound(structure.natural_length_m + change_m[-1]).residual_n(x[-1])).max() < 2e-3
    assert np.abs(x[-1] - x[0]).max() > 0.002


def test_a_slack_tendon_pushes_back_from_its_new_natural_length() -> None:
    """Let out by 160 mm, it is bent, and still all balances with the push-back of a bent strip."""
    structure, shape_m = resting(12)
    made = body(structure, push_back=0.05)
    twin = Twin(made, 1e-3, shape_m)
    twin.settle()
    change_m = np.zeros((4000, 24))
    change_m[:, 5] = np.minimum(np.arange(4000) * 5e-5, 0.16)
    x = twin.run(Loads([]), 4000, wound_m=change_m).node_position_m[-1]
    mechanics = Mechanics(made.stiffness_n_per_m, structure.natural_length_m, made.rod_mass_kg, made.push_back)
    wound = Statics(structure, mechanics).wound(structure.natural_length_m + change_m[-1])
    assert structure.tendon_length_m(x)[5] < wound.mechanics.natural_length_m[5] - 0.01
    assert np.abs(wound.residual_n(x)).max() < 2e-3


REFUSED = [
    (
        "noise_m = 0.00005      ",
        "noise_m = 0.1      ",
        r"motor\[0\].noise_m: expected at most 0.013, a tenth of the strip, got 0.1",
    ),
    ("tendons = [15, 20, 23]", "tendons = [15, 20, 99]", r"motor\[0\].tendons: expected tendons from 0 to 23, got 99"),
    ("tendons = [15, 20, 23]", "tendons = [15, 20, 12]", r"motor\[1\].tendons: tendon 12 has a motor already"),
    ("at_s = [3.0, 7.0, 12.0]", "at_s = [3.0, 2.5, 12.0]", r"motor\[0\].at_s: expected rising times from rest.seconds"),
    ("at_s = [3.0, 7.0, 12.0]", "at_s = [1.0, 7.0, 12.0]", r"motor\[0\].at_s: expected rising times .*= 2.0 to"),
    ("at_s = [3.0, 7.0, 12.0]", "at_s = [3.0, 7.0]", r"motor\[0\].change_m: expected as many as at_s, .*got 3"),
    ("[-0.008, -0.015, 0.0]", "[-0.008, -0.050, 0.0]", r"motor\[0\].change_m: expected at least -0.0401, .*got -0.05"),
]


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_plans_that_cannot_be_are_refused_by_key(tmp_path, old, new, message) -> None:
    text = replaced(PLANS["motor"].read_text(), (old, new), ('"press.toml"', f'"{PLANS["press"].as_posix()}"'))
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_plan(tmp_path / "plan.toml")


def test_a_course_without_motion_is_none() -> None:
    assert not replace(PLAN, at_s=[1.0], change_m=[0.0]).told_m(np.arange(5.0)).any()
