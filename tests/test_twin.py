"""The twin's mechanics, sensors and boards: worked by hand, laws of physics, two solvers, constants far and wide."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tensegraph import Structure, TensegraphError, six_strut, three_strut
from tensegraph.models.sensor.bending import BendingCurve
from tensegraph.models.sensor.clock import BoardClock, ClockSettings
from tensegraph.models.sensor.divider import Divider
from tensegraph.models.structure.rigidity import find_rest_shape
from tensegraph.models.twin.emulated_boards import (
    BoardPhysics,
    Faults,
    ResistanceDrift,
    SensorFault,
    Signal,
    Spikes,
    Unplugged,
    board_rows,
)
from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.geometry_error import GeometryError, ToldErrors, end_to_end_m, hub_offset_m
from tensegraph.models.twin.loads import Hold, Loads, Press, RandomPresses, Squeeze, Window
from tensegraph.models.twin.mjcf import Body
from tensegraph.models.twin.slow_drift import DriftPlan
from tensegraph.models.twin.specimens import HysteresisPlan, SensorPhysics, Sensors, Specimens, drift
from tensegraph.models.twin.spread_loads import Hug, RandomHugs, RandomShakes, Shake, WindPlan

SHAPES = {s.node_count: (s, find_rest_shape(s)) for s in (six_strut(0.3), three_strut(0.3, 0.15))}


def body(structure: Structure, **constants) -> Body:
    """A structure with ordinary constants, but for those given."""
    ordinary = {
        "rod_mass_kg": 0.03,
        "rod_radius_m": 0.003,
        "rod_drag_n_s_per_m": 0.2,
        "stiffness_n_per_m": np.full(len(structure.tendons), 400.0),
        "damping_n_s_per_m": 1.0,
        "push_back": 0.1,
        "gravity_m_per_s2": 9.81,
        "ground_friction": None,
    }
    return Body(structure, **(ordinary | constants))


# ---------------------------------------------------------------- mechanics, by hand


@pytest.fixture(scope="module")
def hanging() -> Structure:
    """A rod (3 over 4) that hangs from three anchors by three tendons; another three, long and loose, hold its foot."""
    angle = np.deg2rad([90.0, 210.0, 330.0])
    anchors = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), 0 * angle], axis=1)
    tendons = np.array([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4]])
    natural_m = np.repeat([0.21, 0.9], 3)
    return Structure(np.array([[3, 4]]), tendons, np.array(0.3), natural_m, np.arange(3), anchors)


@pytest.mark.parametrize("pull_n", [0.0, 0.7])
def test_a_hanging_rod_hangs_where_forces_balance(hanging, pull_n) -> None:
    """3 k (l - L0) h / l = m g + F, l^2 = h^2 + 0.2^2."""
    twin = Twin(
        body(hanging, push_back=0.0),
        1e-3,
        np.array([*hanging.anchor_position_m, [0, 0, -0.1], [0, 0, -0.4]]),
    )
    twin.settle()
    motion = twin.run(Loads([Hold(0.0, 0.5, [4], max(pull_n, 1e-9), (0, 0, -1))], 5), 4000)

    def balance(h: float) -> float:
        length = np.hypot(h, 0.2)
        return 3 * 400 * (length - 0.21) * h / length - 0.03 * 9.81 - pull_n

    np.testing.assert_allclose(motion.node_position_m[-1, 3], [0, 0, -brentq(balance, 0.065, 0.3)], atol=2e-6)
    np.testing.assert_allclose(motion.load_n[-1].sum(axis=0), [0, 0, -pull_n], atol=1e-8)


def test_drag_is_force_over_speed(hanging) -> None:
    """A loose rod pushed by F at either end ends up at v = 2 F / d, and turns nowhere."""
    loose = replace(hanging, natural_length_m=np.array(2.0))
    twin = Twin(
        body(loose, push_back=0.0, damping_n_s_per_m=0.0, gravity_m_per_s2=0.0, rod_drag_n_s_per_m=0.5),
        1e-3,
        np.array([*loose.anchor_position_m, [0, 0, -0.1], [0, 0, -0.4]]),
    )
    motion = twin.run(Loads([Hold(0.0, 0.01, [3, 4], 0.1, (1, 0, 0))], 5), 1000)
    speed = np.diff(motion.node_position_m[-2:, 3:], axis=0)[0] / 1e-3
    np.testing.assert_allclose(speed, [[0.4, 0, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize("nodes", [12, 6])
def test_at_rest_the_static_equations_hold(nodes) -> None:
    """At a free end the tendons' force is along the rod, but for half its weight; along a free rod it is zero.

    Written from the statics alone; the engine integrates motion until it stops.
    """
    structure, shape_m = SHAPES[nodes]
    rng = np.random.default_rng(nodes)
    made = body(structure, stiffness_n_per_m=400 * rng.uniform(0.5, 2, len(structure.tendons)))
    twin = Twin(made, 1e-3, shape_m)
    twin.settle()
    x = twin.node_position_m
    force = np.zeros_like(x)
    for (a, b), natural, k in zip(structure.tendons, structure.natural_length_m, made.stiffness_n_per_m, strict=True):
        along = x[b] - x[a]
        length = np.linalg.norm(along)
        pull = k * (1.0 if length > natural else made.push_back) * (length - natural) * along / length
        force[a] += pull
        force[b] -= pull
    force[:, 2] -= made.rod_mass_kg * 9.81 / 2
    free = set(structure.free_nodes.tolist())
    for i, j in structure.rods.tolist():
        w = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
        for node in {i, j} & free:
            assert np.linalg.norm(force[node] - w * (w @ force[node])) < 1e-4
        if {i, j} <= free:
            assert abs(w @ (force[i] + force[j])) < 1e-4


def test_half_the_step_is_the_same_motion() -> None:
    structure, shape_m = SHAPES[12]
    paths = []
    for step_s in (1e-3, 5e-4):
        twin = Twin(body(structure), step_s, shape_m)
        twin.settle()
        motion = twin.run(Loads([Press(0.1, 0.5, 0.3, [5], 3.0, (0, 0.3, -1))], 12), round(1.5 / step_s))
        paths.append(motion.node_position_m[:: round(0.01 / step_s)])
    assert np.abs(paths[0] - paths[0][0]).max() > 0.01
    assert np.abs(paths[0] - paths[1]).max() < 1e-4


# ---------------------------------------------------------------- laws, with constants far and wide


def energy_j(made: Body, position_m: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Potential and kinetic energy, from positions alone; a uniform rod's is m (v1^2 + v1 v2 + v2^2) / 6."""
    s = made.structure
    stretch = s.tendon_length_m(position_m) - s.natural_length_m
    stiffness = made.stiffness_n_per_m * np.where(stretch > 0, 1.0, made.push_back)
    lifted = made.rod_mass_kg * made.gravity_m_per_s2 * position_m[:, s.rods, 2].mean(axis=2).sum(axis=1)
    v = np.gradient(position_m, step_s, axis=0)[:, s.rods]
    squares = (v[:, :, 0] ** 2 + v[:, :, 1] ** 2 + v[:, :, 0] * v[:, :, 1]).sum(axis=(1, 2))
    return (stiffness * stretch**2 / 2).sum(axis=1) + lifted, made.rod_mass_kg / 6 * squares


constants = st.fixed_dictionaries(
    {
        "nodes": st.sampled_from([12, 6]),
        "stiffness": st.floats(50, 2000),
        "spread": st.floats(0, 0.4),
        "damping": st.floats(0, 3),
        "push_back": st.floats(0, 0.5),
        "mass": st.floats(0.01, 0.3),
        "drag": st.floats(0, 1),
        "natural": st.floats(0.8, 1.05),
    }
)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(constants)
def test_rods_keep_their_length_and_energy_never_grows(c) -> None:
    """Let go from a shape that is not at rest: tendons pull, weight falls, and all that motion costs energy."""
    structure, shape_m = SHAPES[c["nodes"]]
    structure = replace(structure, natural_length_m=structure.natural_length_m * c["natural"])
    k = c["stiffness"] * np.exp(c["spread"] * np.random.default_rng(0).normal(size=len(structure.tendons)))
    made = body(
        structure,
        stiffness_n_per_m=k,
        damping_n_s_per_m=c["damping"],
        push_back=c["push_back"],
        rod_mass_kg=c["mass"],
        rod_drag_n_s_per_m=c["drag"],
    )
    step_s = 5e-5  # the integration's own error of energy is of first order in the step, 2 % of kinetic at 0.25 ms
    x = Twin(made, step_s, shape_m).run(Loads([], c["nodes"]), 4000).node_position_m
    length = np.linalg.norm(x[:, structure.rods[:, 0]] - x[:, structure.rods[:, 1]], axis=2)
    np.testing.assert_allclose(length, np.broadcast_to(structure.rod_length_m, length.shape), atol=1e-9)
    np.testing.assert_array_equal(x[:, structure.anchors], x[:1, structure.anchors].repeat(len(x), axis=0))
    potential, kinetic = energy_j(made, x, step_s)
    total = (potential + kinetic)[3:-1]  # speeds at the ends are one-sided differences
    assert (total - np.minimum.accumulate(total)).max() < 0.01 * kinetic.max() + 1e-12


@settings(max_examples=6, deadline=None, derandomize=True)
@given(st.sampled_from([12, 6]), st.floats(100, 2000), st.floats(0.01, 0.1), st.sampled_from([None, 0.3, 1.0]))
def test_at_rest_the_momentum_stays_zero(nodes, stiffness, mass, friction) -> None:
    """Held, or on the ground, which must carry exactly the weight."""
    structure, shape_m = SHAPES[nodes]
    k = stiffness * np.random.default_rng(1).uniform(0.8, 1.2, len(structure.tendons))
    made = body(structure, stiffness_n_per_m=k, rod_mass_kg=mass, ground_friction=friction)
    twin = Twin(made, 1e-3, shape_m)
    twin.settle()
    x = twin.run(Loads([], nodes), 500).node_position_m
    velocity = np.diff(x, axis=0) / 1e-3
    momentum = mass * velocity[:, structure.rods].mean(axis=2).sum(axis=1)
    assert np.abs(momentum).max() < 1e-5 * mass * len(structure.rods)
    assert np.abs(x[-1] - x[0]).max() < 2e-6


def test_in_free_space_momentum_is_conserved() -> None:
    """No gravity, no drag, lifted off the ground: however the tendons shake the rods, their sum goes on evenly.

    To 2 % in a second: the integrator damps a rod's own motion implicitly, and its neighbours' explicitly.
    """
    structure, shape_m = SHAPES[12]
    k = 400 * np.random.default_rng(2).uniform(0.5, 2, 24)
    made = body(structure, stiffness_n_per_m=k, gravity_m_per_s2=0.0, rod_drag_n_s_per_m=0.0, ground_friction=0.5)
    lift = Press(0.0, 0.01, 0.015, list(range(12)), 2.0, (0, 0, 1))
    x = Twin(made, 1e-3, shape_m).run(Loads([lift], 12), 1000).node_position_m
    velocity = (np.diff(x[:, structure.rods].mean(axis=2), axis=0) / 1e-3)[100:]
    total = velocity.mean(axis=1)
    assert np.abs(velocity - total[:, None]).max() > 0.01
    assert np.linalg.norm(total - total[0], axis=1).max() < 0.02 * np.linalg.norm(total[0])


def test_on_the_ground_it_stays_until_pushed_over() -> None:
    """Six rods weigh 1.77 N and stand 53 mm from the feet's edges: at a height of 0.17 m, 0.55 N topples them."""
    structure, shape_m = SHAPES[12]
    feet = {}
    for push_n in (0.3, 1.0):
        twin = Twin(body(structure, ground_friction=0.8), 1e-3, shape_m)
        twin.settle()
        x = twin.run(Loads([Press(0.1, 0.3, 0.3, [3], push_n, (1, 0, 0))], 12), 1000).node_position_m
        feet[push_n] = np.abs(x[:, :3] - x[0, :3]).max(axis=(0, 2))
        assert x[:, :, 2].min() > -0.002
    assert feet[0.3].max() < 0.002
    assert feet[1.0].max() > 0.02


def test_a_structure_that_never_rests_is_said() -> None:
    structure, shape_m = SHAPES[6]
    made = body(structure, damping_n_s_per_m=0.0, rod_drag_n_s_per_m=0.0)
    with pytest.raises(TensegraphError, match="does not come to rest in 300 s: try more drag"):
        Twin(made, 5e-3, shape_m).settle()


def test_a_step_that_is_too_long_is_said(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log
    structure, shape_m = SHAPES[6]
    made = body(structure, stiffness_n_per_m=np.full(9, 1e12), rod_mass_kg=0.005)
    with pytest.raises(TensegraphError, match="expected a smaller step_s"):
        Twin(made, 0.02, shape_m).settle()


# ---------------------------------------------------------------- loads


def test_a_press_grows_and_fades_by_the_cosine() -> None:
    loads = Loads([Press(1.0, 0.4, 0.6, [2, 3], 2.0, (0, 3, 4))], 4)
    shares = {0.99: 0.0, 1.1: (1 - np.sqrt(0.5)) / 2, 1.2: 0.5, 1.4: 1.0, 2.0: 1.0, 2.2: 0.5, 2.41: 0.0}
    for t_s, share in shares.items():
        force = loads.force_n(t_s, np.zeros((4, 3)))
        np.testing.assert_allclose(force, share * np.array([[0, 0, 0]] * 2 + [[0, 1.2, 1.6]] * 2), atol=1e-12)


def test_a_squeeze_follows_its_nodes_and_a_hold_stays() -> None:
    position_m = np.array([[0, 0, 0], [0.3, 0.4, 0], [1, 1, 1]])
    squeeze = Loads([Squeeze(0.0, 1.0, 9.0, (0, 1), 5.0)], 3).force_n(5.0, position_m)
    np.testing.assert_allclose(squeeze, [[3, 4, 0], [-3, -4, 0], [0, 0, 0]])
    hold = Loads([Hold(0.0, 1.0, [2], 5.0, (0, 0, -2))], 3).force_n(1e6, position_m)
    np.testing.assert_allclose(hold, [[0, 0, 0], [0, 0, 0], [0, 0, -5]])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_random_presses_stay_in_their_ranges(seed) -> None:
    random = RandomPresses(
        2.0, 25.0, (0.4, 1.3), (1.8, 3.8), 0.28, [5, 8, 11], (1, 2), (0.9, 3.1), (0, 0, -1), (0.3, 0.3, 0)
    )
    presses = random.draw(np.random.default_rng(seed))
    starts = sorted({p.at_s for p in presses})
    for press in presses:
        duration_s = 2 * press.ramp_s + press.hold_s
        assert 1.8 <= round(duration_s, 9) <= 3.8
        assert 2.4 <= press.at_s <= press.at_s + duration_s < 25.0
        assert 0.9 <= press.force_n <= 3.1
        assert set(press.nodes) <= {5, 8, 11}
        assert press.direction[2] == -1
    assert all(1 <= sum(p.at_s == at_s for p in presses) <= 2 for at_s in starts)
    assert np.diff(starts).min() >= 1.8 + 0.4


# ---------------------------------------------------------------- sensors

PLAIN = SensorPhysics(
    natural_resistance_ohm=5e6,
    natural_resistance_spread=0.0,
    natural_resistance_error=0.0,
    gain_spread=0.0,
    gauge_factor=[1.0],
    gauge_corner_strain=[],
    gauge_corner_width=0.01,
    overstress_gain=[],
    overstress_time_s=[],
    hysteresis_gain=[],
    hysteresis_strain=[],
    hysteresis_at_rest=0.0,
    softening=0.0,
    softening_strain=1.0,
    stretching_time_s=(1e-6, 1e-6),
    bending_time_s=(1e-6, 1e-6),
    drift_sigma=0.0,
    drift_time_s=1.0,
    noise_sigma=0.0,
    noise_share=0.0,
)
"""A sensor that does nothing but dR/R = strain, at once."""


def response(physics: SensorPhysics, strain, step_s: float = 0.01) -> np.ndarray:
    strain = np.array(strain, dtype=np.float64)[:, None]
    return np.array(list(Sensors(physics, np.ones(1), strain[0]).changes(strain, step_s)))[:, 0]


def test_the_gauge_curve_has_its_slopes_and_starts_at_zero() -> None:
    physics = replace(PLAIN, gauge_factor=[1.0, 3.0], gauge_corner_strain=[0.2], gauge_corner_width=0.01)
    strain = np.array([0.0, 0.1, 0.3, 0.4])
    np.testing.assert_allclose(physics.gauge(strain), [0, 0.1, 0.2 + 3 * 0.1, 0.2 + 3 * 0.2], atol=1e-5)


def test_the_lag_reaches_90_percent_at_2_303_time_constants() -> None:
    physics = replace(PLAIN, stretching_time_s=(0.122, 0.402))
    up = response(physics, np.r_[np.zeros(1), np.full(1000, 0.1)], 0.001)
    down = response(physics, np.r_[np.full(1, 0.1), np.zeros(2000)], 0.001)
    assert up[281] == pytest.approx(0.09, rel=1e-3)
    assert down[926] == pytest.approx(0.01, rel=1e-2)


def test_the_overstress_of_steady_stretching_is_rate_times_time() -> None:
    """q -> rate tau (1 - exp(-t / tau)) and relaxes when it stops."""
    physics = replace(PLAIN, overstress_gain=[0.5], overstress_time_s=[2.0])
    t = np.arange(0, 3, 0.01)
    y = response(physics, np.r_[0.1 * t, np.full(1000, 0.3)])
    np.testing.assert_allclose(y[299], 0.299 + 0.5 * 0.1 * 2 * (1 - np.exp(-299 * 0.01 / 2)), rtol=2e-3)
    np.testing.assert_allclose(y[-1], 0.3, atol=0.5 * 0.2 * np.exp(-9.9 / 2) + 1e-4)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.005, 0.05), st.floats(0.0, 0.4), st.floats(0.5, 200))
def test_the_hysteresis_loop_is_2_w_r_wide_at_any_rate(width, gain, speed) -> None:
    physics = replace(PLAIN, hysteresis_gain=[gain], hysteresis_strain=[width])
    up = np.linspace(0.0, 0.4, 401)
    y = response(physics, np.r_[up, up[::-1], up], 0.1 / speed)
    middle = 200
    assert y[401 + 200] - y[802 + middle] == pytest.approx(2 * gain * width, abs=1e-9)


def test_hysteresis_at_rest_is_the_first_stretch() -> None:
    physics = replace(PLAIN, hysteresis_gain=[0.2], hysteresis_strain=[0.01], hysteresis_at_rest=1.0)
    brought = response(replace(physics, hysteresis_at_rest=0.0), np.linspace(0, 0.1, 101))[-1]
    assert response(physics, [0.1, 0.1])[-1] == pytest.approx(brought, abs=1e-12)
    assert response(replace(physics, hysteresis_at_rest=0.0), [0.1, 0.1])[-1] == pytest.approx(0.1)


def test_a_worked_strip_is_softer() -> None:
    physics = replace(PLAIN, softening=0.2, softening_strain=2.0)
    strain = 0.1 + 0.1 * np.sin(np.linspace(0, 2 * np.pi * 5, 5001))
    y = response(physics, strain)
    travelled = 0.1 + np.abs(np.diff(strain)).sum()
    assert y[-1] == pytest.approx(0.1 * (1 - 0.2 * (1 - np.exp(-travelled / 2))), rel=1e-9)


def test_a_bent_strip_follows_equation_9() -> None:
    strain = -np.linspace(0, 0.8, 50)
    np.testing.assert_allclose(response(PLAIN, strain), BendingCurve().change(strain), atol=1e-12)


def test_drift_and_spread_are_as_large_as_said() -> None:
    physics = replace(
        PLAIN,
        drift_sigma=0.01,
        drift_time_s=5.0,
        gain_spread=0.07,
        natural_resistance_spread=0.1,
        natural_resistance_error=0.003,
    )
    walk = drift(physics, 2000, 500, 0.1, np.random.default_rng(0))
    assert walk.std() == pytest.approx(0.01, rel=0.05)
    assert (walk[:-50] * walk[50:]).mean() == pytest.approx(0.01**2 * np.exp(-1), rel=0.15)
    drawn = Specimens.draw(physics, 5000, np.random.default_rng(1))
    assert drawn.gain.std() == pytest.approx(0.07, rel=0.1)
    assert (drawn.natural_resistance_ohm / 5e6).std() == pytest.approx(0.1, rel=0.1)
    assert (drawn.measured_resistance_ohm / drawn.natural_resistance_ohm).std() == pytest.approx(0.003, rel=0.1)


# ---------------------------------------------------------------- boards

DIVIDER = Divider(10, 5.8e6, "ground")
QUIET = BoardPhysics([[0, 1], [2]], 20_000, 0.0, 0.002, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def signal() -> Signal:
    """30 s of three sensors: steady, rising by half, steady."""
    t_s = np.arange(0, 30, 0.001)
    resistance = np.stack([np.full_like(t_s, 5.8e6), 5.8e6 * (1 + t_s / 60), np.full_like(t_s, 2.9e6)], axis=1)
    return Signal(t_s, resistance, np.zeros_like(resistance))


def counts_of(signal, faults=None, board=0, physics=QUIET, seed=0):
    rows = board_rows(board, physics, DIVIDER, signal, faults or Faults(), np.random.default_rng(seed))
    return np.array([row.host_s for row in rows]), np.array([row.counts for row in rows]), rows


@pytest.mark.parametrize("side", ["ground", "supply"])
def test_a_code_means_its_resistance_and_the_other_way_round(side) -> None:
    divider = Divider(10, 5.8e6, side)
    codes = np.arange(1024)
    np.testing.assert_array_equal(divider.counts(divider.resistance_ohm(codes)), codes)
    open_and_short = divider.counts(np.array([np.inf, 0.0]))
    np.testing.assert_array_equal(open_and_short, [1023, 0] if side == "ground" else [0, 1023])


def test_a_quiet_board_is_a_sampled_divider(signal) -> None:
    host_s, counts, rows = counts_of(signal)
    assert len(rows) in (1499, 1500)
    np.testing.assert_array_equal(counts[:, 0], 512)
    resistance = 5.8e6 * (1 + (host_s - 0.002) / 60)
    np.testing.assert_array_equal(counts[:, 1], DIVIDER.counts(resistance))
    assert {b.device_us - a.device_us for a, b in pairwise(rows)} == {20_000}


def test_clocks_jitter_and_loss_are_as_said(signal) -> None:
    physics = replace(QUIET, rate_error=0.005, delay_s=0.0015, lost_rows=0.02)
    for seed in range(3):
        host_s, _, rows = counts_of(signal, physics=physics, seed=seed)
        seq = np.array([row.seq for row in rows])
        assert 0.005 < 1 - len(seq) / (seq[-1] + 1) < 0.04
        assert (np.diff(host_s) > 0).all()
        rate, start_s = np.polyfit(seq, host_s, 1)
        assert abs(rate / 0.02 - 1) <= 0.0051
        late_s = host_s - (start_s + rate * seq)
        assert late_s.std() == pytest.approx(0.0015, rel=0.2)


def test_the_estimator_s_clock_finds_when_rows_were_sampled(signal) -> None:
    """Two parts that know nothing of each other: the board that makes the stamps, and the clock that undoes them."""
    physics = replace(QUIET, rate_error=150e-6, delay_s=0.0015, lost_rows=0.004)
    _, counts, rows = counts_of(signal, physics=physics)
    clock = BoardClock(ClockSettings())
    times = np.array([clock.time_s(row) for row in rows])
    ramp = (DIVIDER.resistance_ohm(counts[:, 1]) / 5.8e6 - 1) * 60
    assert abs((ramp - times)[200:].mean()) < 0.01  # a code is 0.2 s of the ramp, and averages out
    assert np.abs(np.diff(times) / np.diff([row.seq for row in rows]) - 0.02)[200:].max() < 2e-4


def test_counters_wrap() -> None:
    t_s = np.array([0.0, 80.0])
    signal = Signal(t_s, np.full((2, 3), 5.8e6), np.zeros((2, 3)))
    _, _, rows = counts_of(signal, physics=replace(QUIET, period_us=1000))
    assert max(row.seq for row in rows) == 65535
    assert rows[65536].seq == 0


def test_each_fault_is_what_it_says(signal) -> None:
    faults = Faults(
        open_circuit=[SensorFault(0, 1.0, 2.0)],
        short_circuit=[SensorFault(0, 3.0, 4.0)],
        stuck=[SensorFault(1, 10.0, 30.0)],
        spikes=[Spikes(0, 5.0, 29.0, 2.0, 400.0)],
        unplugged=[Unplugged(1, 7.0, 9.0)],
        resistance_drift=[ResistanceDrift(2, 10.0, 20.0, 0.01)],
    )
    host_s, counts, _ = counts_of(signal, faults)
    t_s = host_s - 0.002
    clean = counts_of(signal)[1]
    np.testing.assert_array_equal(counts[(t_s > 1) & (t_s < 2), 0], 1023)
    np.testing.assert_array_equal(counts[(t_s > 3) & (t_s < 4), 0], 0)
    assert len(set(counts[t_s > 10.001, 1])) == 1
    assert len(set(clean[t_s > 10.001, 1])) > 50
    off = counts[t_s > 5, 0] != 512
    assert 24 < off.sum() < 80
    np.testing.assert_array_equal(counts[t_s < 1], clean[t_s < 1])
    host_s, counts, rows = counts_of(signal, faults, board=1)
    assert not ((host_s > 7.01) & (host_s < 9)).any()
    assert max(b.seq - a.seq for a, b in pairwise(rows)) == 101
    np.testing.assert_array_equal(counts[host_s > 20.1, 0], DIVIDER.counts(np.array(2.9e6 * 1.1)))
    assert [row["kind"] for row in faults.as_truth()] == [
        "open_circuit", "short_circuit", "spikes", "unplugged", "stuck", "resistance_drift",
    ]  # fmt: skip


# ---------------------------------------------------------------- causes that break an estimate: drift, hysteresis

WARM = DriftPlan(
    from_s=5.0,
    until_s=65.0,
    of="resistance",
    common_share=0.03,
    common_course="ramp",
    own_sigma=0.0,
    own_course="ramp",
)


def test_a_common_ramp_is_3_percent_when_it_ends_and_half_of_that_half_way() -> None:
    t_s = np.array([0.0, 5.0, 35.0, 65.0, 80.0])
    common = WARM.drift(t_s, 2, np.random.default_rng(0))
    np.testing.assert_allclose(common, np.outer([0, 0, 0.015, 0.03, 0.03], [1, 1]), atol=1e-15)


def test_warming_up_slows_down_and_ends_where_it_is_told() -> None:
    """1 - exp(-1) = 0.632 of what tau = 20 s would reach in the end, of which 60 s see 1 - exp(-3)."""
    warm = replace(WARM, common_course="warm_up", time_constant_s=20.0)
    common = warm.drift(np.array([5.0, 25.0, 65.0, 90.0]), 1, np.random.default_rng(0))[:, 0]
    np.testing.assert_allclose(common, [0, 0.03 * 0.63212 / 0.95021, 0.03, 0.03], rtol=1e-4)


@pytest.mark.parametrize(("course", "half_way"), [("ramp", 0.5), ("walk", np.sqrt(0.5))])
def test_each_sensor_s_own_drift_has_the_sigma_told(course, half_way) -> None:
    """A ramp is half way at half its time; the variance of a random walk grows with time."""
    own = replace(WARM, common_share=0.0, own_sigma=0.02, own_course=course)
    d = own.drift(np.arange(0.0, 70.0, 0.5), 4000, np.random.default_rng(1))
    assert not d[:11].any()
    assert d[130].std() == pytest.approx(0.02, rel=0.05)
    assert d[70].std() == pytest.approx(half_way * 0.02, rel=0.05)
    np.testing.assert_array_equal(d[130], d[-1])
    later = np.corrcoef(d[70], d[130] - d[70])[0, 1]
    assert later == pytest.approx(1.0 if course == "ramp" else 0.0, abs=0.05)


@pytest.mark.parametrize("factor", [0.0, 1.0, 3.0])
def test_hysteresis_times_three_is_a_loop_three_times_as_wide(factor) -> None:
    """A loop much longer than the stop is 2 w r high: 2 x 0.2 x 0.01; creep leaves a s exp(-t / tau) of a step s."""
    physics = replace(PLAIN, hysteresis_gain=[0.2], hysteresis_strain=[0.01])
    back_and_forth = np.concatenate([np.linspace(0.05, 0.1, 501), np.linspace(0.1, 0.05, 501)])
    loop = response(HysteresisPlan(factor, 1.0).applied(physics), np.tile(back_and_forth, 2))
    up, down = loop[1002 + 250], loop[1002 + 501 + 250]
    assert down - up == pytest.approx(factor * 2 * 0.2 * 0.01, abs=1e-9)
    physics = replace(PLAIN, overstress_gain=[0.5], overstress_time_s=[2.0])
    step = response(HysteresisPlan(1.0, factor).applied(physics), np.r_[0.0, np.full(400, 0.1)])
    assert step[201] - 0.1 == pytest.approx(factor * 0.5 * 0.1 * np.exp(-1), rel=0.01)


# ---------------------------------------------------------------- causes: loads on many nodes, shaking

SQUARE = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 1], [0, -1, 1], [9, 9, 9]])
"""Four nodes about (0, 0, 0.5), and one far away."""
ALWAYS = Window(0.0, 1.0, 99.0)


@pytest.mark.parametrize(
    ("axis", "first"), [((0, 0, 0), np.array([-2, 0, 1]) / np.sqrt(5)), ((0, 0, 7), np.array([-1, 0, 0]))]
)
def test_a_hug_pushes_towards_the_middle_or_the_axis(axis, first) -> None:
    hug = Hug(ALWAYS, np.arange(4), np.array([1.0, 1.0, 2.0, 2.0]), np.array(axis, dtype=float), np.zeros((4, 3)))
    force_n = Loads([], 5, [hug]).force_n(50.0, SQUARE)
    np.testing.assert_allclose(force_n[0], first, atol=1e-12)
    np.testing.assert_allclose(force_n[[1, 3]], force_n[[0, 2]] * [-1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(force_n, axis=1), [1, 1, 2, 2, 0], atol=1e-12)
    np.testing.assert_allclose(Loads([], 5, [hug]).force_n(0.5, SQUARE), force_n / 2, atol=1e-12)


def test_a_node_in_the_middle_of_a_hug_is_not_pushed() -> None:
    hug = Hug(ALWAYS, np.arange(3), np.ones(3), np.zeros(3), np.full((3, 3), 0.1))
    force_n = hug.full_n(50.0, np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 0]]))
    assert not force_n[2].any()
    assert np.isfinite(force_n).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(0, 0, 0), (0, 0, 1), (1, 1, 0)]))
def test_random_hugs_stay_in_their_ranges_and_point_inwards(seed, axis) -> None:
    nodes = list(range(3, 12))
    random = RandomHugs(2.0, 29.0, (0.4, 1.5), (2.5, 4.5), 0.28, nodes, (6, 9), (0.6, 1.4), 0.3, axis, 0.0)
    position_m = SHAPES[12][1]
    hugs = random.draw(np.random.default_rng(seed))
    assert len(hugs) >= 4
    for hug in hugs:
        force_n = hug.full_n(0.0, position_m)
        size_n = np.linalg.norm(force_n, axis=1)
        assert 6 <= np.count_nonzero(size_n) <= 9
        assert not size_n[:3].any()
        assert 0.6 * 0.7 <= size_n[size_n > 0].min() <= size_n.max() <= 1.4 * 1.3
        assert ((position_m[hug.nodes].mean(axis=0) - position_m[hug.nodes]) * force_n[hug.nodes]).sum(axis=1).min() > 0
        np.testing.assert_allclose(force_n @ np.array(axis), 0 if any(axis) else force_n @ np.array(axis), atol=1e-12)


def test_a_wind_has_its_mean_and_its_gusts_and_does_not_turn_round() -> None:
    plan = WindPlan(
        at_s=0.0,
        ramp_s=1.0,
        nodes=[0, 2, 3],
        force_n=2.0,
        force_spread=0.5,
        direction=(0, 3, 4),
        gust_share=0.5,
        gust_period_s=(2.5, 7.0),
    )
    t_s = np.arange(1.0, 3000.0, 0.37)
    for seed in range(3):
        wind = Loads([], 4, [plan.draw(np.random.default_rng(seed))])
        along = np.array([wind.force_n(t, np.zeros((4, 3))) for t in t_s]) @ [0, 0.6, 0.8]
        assert not along[:, 1].any()
        caught = along[:, [0, 2, 3]].mean(axis=0) / 2.0
        assert ((caught > 0.49) & (caught < 1.51)).all()
        np.testing.assert_allclose(along[:, [0, 2, 3]].std(axis=0) / caught, 2.0 * 0.5, rtol=0.02)
        assert along.min() >= 0


def test_a_shake_is_a_sine_of_its_frequency() -> None:
    shake = Shake(ALWAYS, np.array([1]), np.array([0.0, 0.0, 2.0]), 5.0)
    quarter_s = 1 / 20
    force_n = [Loads([], 2, [shake]).force_n(10.0 + k * quarter_s, np.zeros((2, 3)))[1, 2] for k in range(4)]
    np.testing.assert_allclose(force_n, [0, 2, 0, -2], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_random_shakes_stay_in_their_ranges(seed) -> None:
    random = RandomShakes(
        2.0, 29.0, (0.4, 1.5), (2.0, 3.5), 0.28, [5, 8, 11], (1, 2), (2.0, 4.0), (5.0, 8.0), (0, 0, 0), (1, 1, 1)
    )
    for shake in random.draw(np.random.default_rng(seed)):
        assert 5.0 <= shake.frequency_hz <= 8.0
        assert 2.0 <= np.linalg.norm(shake.force_n) <= 4.0
        assert set(shake.nodes) <= {5, 8, 11}
        assert 2.0 <= round(2 * shake.when.ramp_s + shake.when.hold_s, 9) <= 3.5


@pytest.mark.parametrize("frequency_hz", [5.0, 8.0])
def test_a_shaken_structure_moves_at_that_frequency(frequency_hz) -> None:
    structure, shape_m = SHAPES[12]
    twin = Twin(body(structure), 1e-3, shape_m)
    twin.settle()
    shake = Shake(Window(0.0, 0.2, 99.0), np.array([5]), np.array([2.0, 0.0, 0.0]), frequency_hz)
    moved_m = twin.run(Loads([], 12, [shake]), 2000).node_position_m[1000:, 5, 0]
    spectrum = np.abs(np.fft.rfft(moved_m - moved_m.mean()))
    assert np.fft.rfftfreq(1000, 1e-3)[spectrum.argmax()] == frequency_hz
    assert np.ptp(moved_m) > 0.005


# ---------------------------------------------------------------- causes: geometry told wrongly


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([12, 6]), st.integers(0, 2**32))
def test_hubs_have_the_radius_told_and_lie_across_the_rod(nodes, seed) -> None:
    structure, shape_m = SHAPES[nodes]
    offset_m = hub_offset_m(structure, shape_m, (0.005, 0.010), np.random.default_rng(seed))
    radius_m = np.linalg.norm(offset_m, axis=2)
    assert radius_m.min() >= 0.005
    assert radius_m.max() <= 0.010
    for i, j in structure.rods:
        at_rod = np.isin(structure.tendons, [i, j])
        assert np.abs(offset_m[at_rod] @ (shape_m[j] - shape_m[i])).max() < 1e-12
    assert (end_to_end_m(structure, shape_m, offset_m) < structure.tendon_length_m(shape_m)).all()


@pytest.mark.parametrize("radius_m", [0.0, 0.01])
def test_a_rod_hangs_by_its_hub_where_forces_balance(hanging, radius_m) -> None:
    """3 k (l - L0) h / l = m g, l^2 = h^2 + (0.2 - r)^2: the anchors are on no rod, and have no hub."""
    start_m = np.array([*hanging.anchor_position_m, [0, 0, -0.1], [0, 0, -0.4]])
    offset_m = hub_offset_m(hanging, start_m, (radius_m, radius_m), np.random.default_rng(0))
    twin = Twin(body(hanging, push_back=0.0, hub_offset_m=offset_m), 1e-3, start_m)
    np.testing.assert_allclose(twin.tendon_length_m, end_to_end_m(hanging, start_m, offset_m), rtol=1e-9)
    twin.settle()
    across_m = 0.2 - radius_m

    def balance(h: float) -> float:
        length = np.hypot(h, across_m)
        return 3 * 400 * (length - 0.21) * h / length - 0.03 * 9.81

    h = brentq(balance, np.sqrt(0.21**2 - across_m**2), 0.3)
    np.testing.assert_allclose(twin.node_position_m[3], [0, 0, -h], atol=3e-6)
    np.testing.assert_allclose(twin.tendon_length_m[:3], np.hypot(h, across_m), atol=3e-6)


def test_hubs_stay_on_their_rods() -> None:
    """However the structure moves, tendons end within the hubs' radii of the nodes: lengths differ by 20 mm at most."""
    structure, shape_m = SHAPES[12]
    offset_m = hub_offset_m(structure, shape_m, (0.005, 0.010), np.random.default_rng(0))
    shortened = end_to_end_m(structure, shape_m, offset_m) / structure.tendon_length_m(shape_m)
    hubbed = replace(structure, natural_length_m=shortened * structure.natural_length_m)
    twin = Twin(body(hubbed, hub_offset_m=offset_m), 1e-3, shape_m)
    twin.settle()
    assert np.abs(twin.node_position_m - shape_m).max() < 0.01
    motion = twin.run(Loads([Press(0.1, 0.3, 0.3, [5], 3.0, (0, 0.3, -1))], 12), 1000)
    node_to_node_m = structure.tendon_length_m(motion.node_position_m)
    assert np.abs(motion.node_position_m - motion.node_position_m[0]).max() > 0.01
    assert np.ptp(node_to_node_m - motion.tendon_length_m, axis=0).max() > 1e-5
    assert np.abs(node_to_node_m - motion.tendon_length_m).max() < 0.02


def test_what_is_told_is_off_by_what_is_said() -> None:
    structure = SHAPES[12][0]
    plan = GeometryError(0.001, 0.004, 0.002, 0.003, 0.0005)
    errors = [ToldErrors.draw(plan, structure, np.random.default_rng(seed)) for seed in range(400)]
    rods, anchors, nodes, tendons = (
        np.array([getattr(error, name) for error in errors])
        for name in ("rod_length_m", "anchor_m", "rest_position_m", "natural_length_m")
    )
    assert rods.mean() == pytest.approx(0.004, abs=1e-4)
    for values, sigma_m in ((rods, 0.001), (anchors, 0.002), (nodes, 0.003), (tendons, 0.0005)):
        assert values.std() == pytest.approx(sigma_m, rel=0.05)
    assert anchors.shape[1:] == (3, 3)
    assert nodes.shape[1:] == (12, 3)
