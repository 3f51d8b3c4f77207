"""What a virtual robot carries: a plan of a robot that is tipped, and what its sensors say against the truth."""

from dataclasses import replace

import numpy as np
import pytest

from plan_edits import PLANS, replaced
from tensegraph import evaluate, open_trial, reconstruct, simulate
from tensegraph.models.twin.carried_sensors import ImuPlan, PositionPlan, RangePlan
from tensegraph.models.twin.engine import TwinMotion
from tensegraph.models.values.aids import ImuReading
from tensegraph.models.values.rotations import rotation
from twin_bodies import resting


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    """Seven seconds of the plan, with one push or two."""
    folder = tmp_path_factory.mktemp("plans")
    (folder / "press.toml").write_text(PLANS["press"].read_text())
    short = (("duration_s = 24.0", "duration_s = 7.0"), ("until_s = 23.0", "until_s = 7.0"))
    (folder / "roll.toml").write_text(replaced(PLANS["roll"].read_text(), *short))
    return simulate(folder / "roll.toml", folder / "roll_01")


def test_the_robot_stands_on_caps_and_tips(rolled) -> None:
    d = rolled.description
    assert d.structure.is_free_standing
    assert d.robot.floor.height_m == pytest.approx(0.01)
    truth, contacts = rolled.truth(), rolled.true_contacts()
    assert contacts.standing[0].sum() == 3
    assert truth.node_position_m[0][contacts.standing[0], 2] == pytest.approx(0.01, abs=3e-4)
    assert truth.node_position_m[..., 2].min() > 0.008
    assert not np.array_equal(contacts.standing[0], contacts.standing[-1])
    path = np.linalg.norm(np.diff(truth.node_position_m.mean(axis=1), axis=0), axis=1).sum()
    assert path > 0.1


def test_it_stands_on_the_floor_wherever_a_file_has_it_and_tells_its_hubs(tmp_path) -> None:
    """Half a metre above, as in the models of others."""
    (tmp_path / "press.toml").write_text(PLANS["press"].read_text())
    above_m = (resting(12)[1] + np.array([0, 0, 0.5])).tolist()
    told = f"anchors = []\nnode_position_m = {above_m}"
    short = (("duration_s = 24.0", "duration_s = 2.5"), ("anchors = []", told))
    untouched = PLANS["roll"].read_text().partition("[[load.tip]]")[0]
    (tmp_path / "roll.toml").write_text(replaced(untouched, *short))
    trial = simulate(tmp_path / "roll.toml", tmp_path / "roll_01")
    assert trial.truth().node_position_m[0, :, 2].min() == pytest.approx(0.01, abs=3e-4)
    assert trial.description.rest_position_m[:, 2].min() == pytest.approx(0.01, abs=1.5e-3)
    assert trial.description.geometry.hub_radius_m == 0.0025


def test_the_estimate_follows_it(rolled) -> None:
    """A trial that nothing was tuned on."""
    evaluation = evaluate(reconstruct(rolled, "live"), rolled)
    assert evaluation.pose.tilt_rms_deg < 2.0
    assert evaluation.pose.contacts.precision > 0.9
    assert evaluation.pose.contacts.recall > 0.9
    assert evaluation.consistency.coverage_95 > 0.85


EXACT = {
    "rate_noise_rad_per_s": 0.0,
    "force_noise_m_per_s2": 0.0,
    "rate_bias_rad_per_s": 0.0,
    "force_bias_m_per_s2": 0.0,
    "misalignment_rad": 0.0,
}


def turning(structure, rate: np.ndarray) -> TwinMotion:
    """Return a second in which the whole structure turns about the origin at a rate."""
    t_s = 0.001 * np.arange(1001)
    x = np.random.default_rng(1).standard_normal((structure.node_count, 3))
    turns = rotation(t_s[:, None] * rate)
    position_m = np.einsum("tij,nj->tni", turns, x)
    first, second = structure.rods.T
    along = x[second] - x[first]
    frames = []
    for direction in along / np.linalg.norm(along, axis=1)[:, None]:
        aside = np.cross(direction, [0.3, 0.5, 0.8])
        aside /= np.linalg.norm(aside)
        frames.append(np.stack([aside, np.cross(direction, aside), direction], axis=1))
    rod_turn = np.einsum("tij,rjk->trik", turns, np.array(frames))
    nothing = np.zeros((len(t_s), structure.node_count, 3))
    return TwinMotion(t_s, position_m, nothing, nothing[..., 0], rod_turn)


@pytest.mark.parametrize("gravity", [9.81, 1.62])
def test_an_exact_sensor_measures_rate_and_centripetal_force(structure, gravity) -> None:
    """By hand: |w| is that of the body; the specific force is -w^2 r, and gravity, on the Moon too."""
    rate = np.array([0.0, 0.0, 2.0])
    motion = turning(structure, rate)
    plan = ImuPlan(rod=2, fraction=0.5, rate_hz=100.0, range_m_per_s2=100.0, **EXACT)
    readings = plan.readings(0, motion, structure, gravity, np.random.default_rng(2))
    a, b = structure.rods[2]
    middle_m = motion.node_position_m[0, [a, b]].mean(axis=0)
    expected = np.hypot(4.0 * np.hypot(*middle_m[:2]), gravity)
    for reading in readings[5:90:20]:
        assert isinstance(reading, ImuReading)
        assert np.linalg.norm(reading.rate_rad_per_s) == pytest.approx(2.0, rel=1e-3)
        assert np.linalg.norm(reading.specific_force_m_per_s2) == pytest.approx(expected, rel=1e-3)
        along = motion.rod_turn[0, 2, :, 2] @ [0, 0, 1]
        assert reading.rate_rad_per_s[2] == pytest.approx(2.0 * along, abs=1e-3)


def test_a_sample_is_the_mean_until_its_stamp(structure) -> None:
    """A structure that turns ever faster, w = 4 t: the mean of the 10 ms before a stamp is that of their middle."""
    t_s = 0.001 * np.arange(1001)
    turned = turning(structure, np.array([0.0, 0.0, 1.0]))
    angle = 2.0 * t_s**2
    turns = rotation(np.stack([0 * angle, 0 * angle, angle], axis=1))
    first = turned.rod_turn[0]
    motion = replace(turned, rod_turn=np.einsum("tij,rjk->trik", turns, first))
    plan = ImuPlan(rod=2, fraction=0.5, rate_hz=100.0, range_m_per_s2=100.0, **EXACT)
    for reading in plan.readings(0, motion, structure, 9.81, np.random.default_rng(2))[10:90:20]:
        assert np.linalg.norm(reading.rate_rad_per_s) == pytest.approx(4.0 * (reading.t_s - 0.005), rel=1e-3)


def test_the_error_in_proportion_to_the_rate_lasts(structure) -> None:
    """By hand: of each axis it is one number for all samples, whose standard deviation over many sensors is as told."""
    motion = turning(structure, np.array([0.0, 0.0, 2.0]))
    exact = ImuPlan(rod=2, fraction=0.5, rate_hz=100.0, range_m_per_s2=100.0, **EXACT)
    scaled = replace(exact, rate_scale=0.02)
    found = []
    for seed in range(40):
        of = [plan.readings(0, motion, structure, 9.81, np.random.default_rng(seed)) for plan in (exact, scaled)]
        rate, told = ([reading.rate_rad_per_s for reading in readings] for readings in of)
        scale = np.array(told[5:90:20]) / np.array(rate[5:90:20])
        assert np.ptp(scale, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
        found.append(scale[0] - 1)
    assert np.std(found) == pytest.approx(0.02, rel=0.25)


def test_ranges_have_offsets_and_positions_gaps(structure) -> None:
    motion = turning(structure, np.array([0.0, 0.0, 0.5]))
    rng = np.random.default_rng(3)
    ranges = RangePlan([(2.0, 0, 0), (0, 2.0, 0)], 100.0, 0.0, 0.05, 0.0, 0.0).readings(0, motion, rng)
    off = [r.range_m - np.linalg.norm(_at(motion, r.t_s, r.node) - r.beacon_position_m) for r in ranges]
    assert 0.02 < np.std(off) < 0.1
    often = RangePlan([(2.0, 0, 0), (0, 2.0, 0)], 100.0, 0.0, 0.0, 0.5, 0.2).readings(0, motion, rng)
    outliers = [r.range_m - np.linalg.norm(_at(motion, r.t_s, r.node) - r.beacon_position_m) for r in often]
    assert min(outliers) > -1e-9  # what is reflected goes a longer way
    assert 0.05 < np.mean(outliers) < 0.2
    positions = PositionPlan([1, 4], 50.0, 0.0, 0.2, 0.2).readings(0, motion, rng)
    assert 10 < len(positions) < 90
    for reading in positions:
        assert reading.position_m == pytest.approx(_at(motion, reading.t_s, reading.node))


def _at(motion: TwinMotion, t_s: float, node: int) -> np.ndarray:
    return motion.node_position_m[np.searchsorted(motion.t_s, t_s), node]


def test_the_shipped_trial_is_of_the_same_format(rolled) -> None:
    shipped = open_trial(PLANS["press"].parents[1] / "roll_02")
    assert set(shipped.toml) == set(rolled.toml)
