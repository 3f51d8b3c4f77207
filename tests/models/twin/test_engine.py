"""The twin's mechanics: by hand, laws of physics, two solvers, constants far and wide."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tensegraph import TensegraphError
from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.loads import Hold, Loads, Press
from tensegraph.models.twin.mjcf import Body
from twin_bodies import body, resting


@pytest.mark.parametrize("pull_n", [0.0, 0.7])
def test_a_hanging_rod_hangs_where_forces_balance(hanging, pull_n) -> None:
    """3 k (l - L0) h / l = m g + F, l^2 = h^2 + 0.2^2."""
    twin = Twin(
        body(hanging, push_back=0.0),
        1e-3,
        np.array([*hanging.anchor_position_m, [0, 0, -0.1], [0, 0, -0.4]]),
    )
    twin.settle()
    motion = twin.run(Loads([Hold(0.0, 0.5, [4], max(pull_n, 1e-9), (0, 0, -1))]), 4000)

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
    motion = twin.run(Loads([Hold(0.0, 0.01, [3, 4], 0.1, (1, 0, 0))]), 1000)
    speed = np.diff(motion.node_position_m[-2:, 3:], axis=0)[0] / 1e-3
    np.testing.assert_allclose(speed, [[0.4, 0, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize("node", [0, 3])
def test_a_rod_turns_with_its_axis_from_its_first_node_to_its_second(node) -> None:
    """Also where it hangs from its second node: the axis of an inertial sensor is told by it."""
    structure, shape_m = resting(6)
    made = body(replace(structure, anchors=np.array([node]), anchor_position_m=shape_m[[node]]))
    motion = Twin(made, 1e-3, shape_m).run(Loads([]), 300, with_turns=True)
    along_m = np.diff(motion.node_position_m[:, structure.rods], axis=2)[:, :, 0]
    np.testing.assert_allclose(0.3 * motion.rod_turn[..., 2], along_m, atol=1e-9)


@pytest.mark.parametrize("heading_rad", [0.0, np.pi / 4, 2.0])
def test_feet_slide_where_the_push_is_more_than_friction_in_any_direction(heading_rad) -> None:
    """Coulomb: three feet that carry 3 m g, pushed along the floor by less and by more than mu 3 m g."""
    structure, shape_m = resting(6)
    free = replace(structure, anchors=np.array([], dtype=np.int64), anchor_position_m=np.zeros((0, 3)))
    slid_m = []
    for share in (0.5, 1.3):
        twin = Twin(body(free, rod_radius_m=0.01, ground_friction=0.5), 1e-3, shape_m)
        twin.settle()
        force_n = share * 0.5 * 0.03 * 9.81
        push = Hold(0.0, 0.2, [0, 1, 2], force_n, (np.cos(heading_rad), np.sin(heading_rad), 0.0))
        x = twin.run(Loads([push]), 1000).node_position_m
        slid_m.append(np.linalg.norm((x[-1] - x[500])[:3].mean(axis=0)))
    assert slid_m[0] < 1e-4
    assert slid_m[1] > 0.02


@pytest.mark.parametrize("nodes", [12, 6])
def test_at_rest_the_static_equations_hold(nodes) -> None:
    """At a free end the tendons' force is along the rod, but for half its weight; along a free rod it is zero.

    Written from the statics alone; the engine integrates motion until it stops.
    """
    structure, shape_m = resting(nodes)
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
    structure, shape_m = resting(12)
    paths = []
    for step_s in (1e-3, 5e-4):
        twin = Twin(body(structure), step_s, shape_m)
        twin.settle()
        motion = twin.run(Loads([Press(0.1, 0.5, 0.3, [5], 3.0, (0, 0.3, -1))]), round(1.5 / step_s))
        paths.append(motion.node_position_m[:: round(0.01 / step_s)])
    assert np.abs(paths[0] - paths[0][0]).max() > 0.01
    assert np.abs(paths[0] - paths[1]).max() < 1e-4


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
    structure, shape_m = resting(c["nodes"])
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
    x = Twin(made, step_s, shape_m).run(Loads([]), 4000).node_position_m
    length = np.linalg.norm(x[:, structure.rods[:, 0]] - x[:, structure.rods[:, 1]], axis=2)
    np.testing.assert_allclose(length, np.broadcast_to(structure.rod_length_m, length.shape), atol=1e-9)
    np.testing.assert_array_equal(x[:, structure.anchors], x[:1, structure.anchors].repeat(len(x), axis=0))
    potential, kinetic = energy_j(made, x, step_s)
    total = (potential + kinetic)[3:-1]  # speeds at the ends are one-sided differences
    assert (total - np.minimum.accumulate(total)).max() < 0.01 * kinetic.max() + 1e-12


@pytest.mark.parametrize(
    ("nodes", "stiffness", "mass", "friction"),
    [
        (12, 100.0, 0.01, None),
        (6, 115.5, 0.0933, 1.0),
        (6, 300.0, 0.0284, None),
        (12, 1119.5, 0.0598, 1.0),
        (6, 233.6, 0.01, 0.3),
        (12, 1400.0, 0.08, 1.0),
    ],
)
def test_at_rest_the_momentum_stays_zero(nodes, stiffness, mass, friction) -> None:
    """Held, or on the ground, which must carry exactly the weight.

    Constants by hand: hypothesis draws others whenever another module is imported, even derandomised.
    """
    structure, shape_m = resting(nodes)
    k = stiffness * np.random.default_rng(1).uniform(0.8, 1.2, len(structure.tendons))
    made = body(structure, stiffness_n_per_m=k, rod_mass_kg=mass, ground_friction=friction)
    twin = Twin(made, 1e-3, shape_m)
    twin.settle()
    x = twin.run(Loads([]), 500).node_position_m
    velocity = np.diff(x, axis=0) / 1e-3
    momentum = mass * velocity[:, structure.rods].mean(axis=2).sum(axis=1)
    assert np.abs(momentum).max() < 1e-5 * mass * len(structure.rods)
    assert np.abs(x[-1] - x[0]).max() < 2e-6


def test_in_free_space_momentum_is_conserved() -> None:
    """No gravity, no drag, lifted off the ground: however the tendons shake the rods, their sum goes on evenly.

    To 2 % in a second: the integrator damps a rod's own motion implicitly, and its neighbours' explicitly.
    """
    structure, shape_m = resting(12)
    k = 400 * np.random.default_rng(2).uniform(0.5, 2, 24)
    made = body(structure, stiffness_n_per_m=k, gravity_m_per_s2=0.0, rod_drag_n_s_per_m=0.0, ground_friction=0.5)
    lift = Press(0.0, 0.01, 0.015, list(range(12)), 2.0, (0, 0, 1))
    x = Twin(made, 1e-3, shape_m).run(Loads([lift]), 1000).node_position_m
    velocity = (np.diff(x[:, structure.rods].mean(axis=2), axis=0) / 1e-3)[100:]
    total = velocity.mean(axis=1)
    assert np.abs(velocity - total[:, None]).max() > 0.01
    assert np.linalg.norm(total - total[0], axis=1).max() < 0.02 * np.linalg.norm(total[0])


def test_on_the_ground_it_stays_until_pushed_over() -> None:
    """Six rods weigh 1.77 N and stand 53 mm from the feet's edges: at a height of 0.17 m, 0.55 N topples them."""
    structure, shape_m = resting(12)
    feet = {}
    for push_n in (0.3, 1.0):
        twin = Twin(body(structure, ground_friction=0.8), 1e-3, shape_m)
        twin.settle()
        x = twin.run(Loads([Press(0.1, 0.3, 0.3, [3], push_n, (1, 0, 0))]), 1000).node_position_m
        feet[push_n] = np.abs(x[:, :3] - x[0, :3]).max(axis=(0, 2))
        assert x[:, :, 2].min() > -0.002
    assert feet[0.3].max() < 0.002
    assert feet[1.0].max() > 0.02


def test_a_structure_that_never_rests_is_said() -> None:
    structure, shape_m = resting(6)
    made = body(structure, damping_n_s_per_m=0.0, rod_drag_n_s_per_m=0.0)
    with pytest.raises(TensegraphError, match="does not come to rest in 300 s: try more drag"):
        Twin(made, 5e-3, shape_m).settle()


def test_a_structure_that_swings_by_the_integration_alone_is_said() -> None:
    """It is in the same place every 0.1 s, but not between."""
    structure, shape_m = resting(12)
    with pytest.raises(TensegraphError, match=r"does not come to rest in 300 s: .*, or a smaller step_s"):
        Twin(body(structure), 5e-3, shape_m).settle()


def test_a_step_that_is_too_long_is_said(tmp_path, monkeypatch, capfd) -> None:
    """By the error alone: nothing is on the terminal, and no log in the folder."""
    monkeypatch.chdir(tmp_path)
    structure, shape_m = resting(6)
    made = body(structure, stiffness_n_per_m=np.full(9, 1e12), rod_mass_kg=0.005)
    with pytest.raises(TensegraphError, match="expected a smaller step_s"):
        Twin(made, 0.02, shape_m).settle()
    with pytest.raises(TensegraphError, match="expected a smaller step_s"):
        Twin(made, 0.02, shape_m).run(Loads([]), 100)
    assert capfd.readouterr().err == ""
    assert not list(tmp_path.iterdir())
