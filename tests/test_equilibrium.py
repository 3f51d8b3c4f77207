"""Balance of forces: worked by hand, by derivatives, and as part of the estimate; loads, health, branches, rest."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import root

from tensegraph import Settings, Status, Structure, six_strut, three_strut
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.branches import OtherBranch
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.rest_step import rest_step
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.factors.equilibrium import equilibrium_factor
from tensegraph.models.estimation import BranchSettings, NoiseSettings
from tensegraph.models.structure.external_loads import Observable, external_loads, observable_loads
from tensegraph.models.structure.rest_shape import RestSettings
from tensegraph.models.structure.rigidity import branch, find_rest_shape
from tensegraph.models.structure.statics import GRAVITY_M_PER_S2, Mechanics, Statics
from tensegraph.models.values.readings import Flag

K = 400.0


def nominal(structure: Structure, rod_mass_kg: float = 0.03) -> Mechanics:
    return Mechanics(np.full(len(structure.tendons), K), structure.natural_length_m, rod_mass_kg, 0.02)


@pytest.fixture(scope="module")
def balanced(structure):
    """The rest step of the six-strut with nothing measured: the shape in which forces balance."""
    return rest_step(structure, nominal(structure), None, RestSettings())


def pressed(structure: Structure, rest, load_n: np.ndarray):
    """The shape under loads at the nodes: all forces balance, rods push as they must and keep their lengths."""
    statics, free = Statics(structure, rest.mechanics), structure.free_nodes

    def place(x):
        position = rest.node_position_m.copy()
        position[free] = x[: 3 * len(free)].reshape(-1, 3)
        return position

    def unbalanced(x, share):
        position = place(x)
        force = statics.node_force_n(position) + share * load_n
        d = position[structure.rods[:, 1]] - position[structure.rods[:, 0]]
        length = np.linalg.norm(d, axis=1)
        along = x[3 * len(free) :, None] * d / length[:, None]
        np.add.at(force, structure.rods[:, 1], along)
        np.add.at(force, structure.rods[:, 0], -along)
        return np.concatenate([force[free].ravel(), K * (length - structure.rod_length_m)])

    start = np.concatenate([rest.node_position_m[free].ravel(), np.full(len(structure.rods), 10.0)])
    for share in (0.25, 0.5, 0.75, 1.0):
        solution = root(unbalanced, start, (share,), method="lm", options={"xtol": 1e-14, "ftol": 1e-14})
        start = solution.x
    assert np.abs(solution.fun).max() < 1e-6
    return place(solution.x)


class TestStatics:
    def test_a_node_between_two_tendons_by_hand(self) -> None:
        """Node 3 hangs from three anchors 0.3 m above: each pulls 400 N/m times 0.1 m, up by 0.8 of it; 96 N in all."""
        structure = Structure(
            np.array([[3, 4]]),
            np.array([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4]]),
            np.array(0.5),
            np.array(0.4),
            np.arange(3),
            np.array([[0.3, 0, 0], [-0.15, 0.15 * np.sqrt(3), 0], [-0.15, -0.15 * np.sqrt(3), 0]]),
        )
        position = np.concatenate([structure.anchor_position_m, [[0, 0, -0.4], [0, 0, 0.1]]])
        force = Statics(structure, nominal(structure, 0.2)).node_force_n(position)
        assert force[3] == pytest.approx([0, 0, 3 * K * 0.1 * 0.8 - 0.1 * GRAVITY_M_PER_S2])
        bent = 0.02 * K * (np.sqrt(0.1) - 0.4)  # shorter than 0.4 m: it pushes back a little
        assert force[4] == pytest.approx([0, 0, -3 * bent * 0.1 / np.sqrt(0.1) - 0.1 * GRAVITY_M_PER_S2])
        residual = Statics(structure, nominal(structure, 0.2)).residual_n(position)
        assert residual[:6] == pytest.approx(0, abs=1e-12)  # both forces are along the rod
        assert residual[6] == pytest.approx(force[3, 2] + force[4, 2])  # from node 3 up to node 4

    @pytest.mark.parametrize("structure", [six_strut(0.3), three_strut(0.3, 0.18)])
    def test_jacobian(self, structure, check_jacobian) -> None:
        rng = np.random.default_rng(0)
        statics = Statics(structure, nominal(structure))
        position = find_rest_shape(structure) + 0.004 * rng.standard_normal((structure.node_count, 3))
        residual, jacobian = statics.residual_and_jacobian(position)
        np.testing.assert_allclose(residual, statics.residual_n(position), atol=1e-12)
        check_jacobian(statics.residual_n, jacobian, position, step=1e-7, tolerance=1e-5)

    def test_jacobian_by_mechanics(self, structure, check_jacobian) -> None:
        position = find_rest_shape(structure) + 0.004 * np.random.default_rng(1).standard_normal((12, 3))
        base = nominal(structure)
        by_log_stiffness, by_natural_length = Statics(structure, base).mechanics_jacobian(position)

        def stiffer(x):
            return Statics(structure, replace(base, stiffness_n_per_m=K * np.exp(x))).residual_n(position)

        def longer(x):
            return Statics(structure, replace(base, natural_length_m=base.natural_length_m + x)).residual_n(position)

        check_jacobian(stiffer, by_log_stiffness, np.zeros(24))
        check_jacobian(longer, by_natural_length, np.zeros(24), step=1e-7, tolerance=1e-5)

    def test_many_frames_are_as_one_by_one(self, structure) -> None:
        positions = find_rest_shape(structure) + 0.003 * np.random.default_rng(2).standard_normal((5, 12, 3))
        statics = Statics(structure, nominal(structure))
        together = statics.residual_and_jacobian(positions)
        for k in range(5):
            for whole, one in zip(together, statics.residual_and_jacobian(positions[k]), strict=True):
                np.testing.assert_allclose(whole[k], one, atol=1e-9)

    @given(st.floats(0, 2 * np.pi), st.integers(0, 1000))
    def test_turning_all_about_the_vertical_turns_the_forces(self, structure, balanced, angle, seed) -> None:
        """Gravity and springs do not care where north is."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        position = balanced.node_position_m + 0.01 * np.random.default_rng(seed).standard_normal((12, 3))
        statics = Statics(structure, nominal(structure))
        np.testing.assert_allclose(
            statics.node_force_n(position @ turn.T), statics.node_force_n(position) @ turn.T, atol=1e-9
        )


class TestFactor:
    def test_error_and_gradient_are_those_of_the_kernel(self, structure, check_jacobian) -> None:
        """1/2 sum log(1 + q); the linear factor's gradient is its derivative, weights 1 / (1 + q) and all."""
        statics, sigma_n = Statics(structure, nominal(structure)), 0.1
        position = find_rest_shape(structure) + 0.002 * np.random.default_rng(3).standard_normal((12, 3))
        graph = gtsam.NonlinearFactorGraph()
        graph.add(equilibrium_factor(statics, range(12), sigma_n))

        def values_at(x):
            values = gtsam.Values()
            for node, point in enumerate(x):
                values.insertPoint3(node, point)
            return values

        def kernel(x):
            r = statics.residual_n(x) / sigma_n
            q = np.bincount(statics.group, r * r)
            return 0.5 * np.log1p(q).sum()

        assert graph.error(values_at(position)) == pytest.approx(kernel(position))
        jacobian, b = graph.linearize(values_at(position)).jacobian()
        check_jacobian(lambda x: np.array([kernel(x)]), -(b @ jacobian), position, step=1e-7, tolerance=1e-2)

    def test_one_pressed_node_is_excused_alone(self, structure, balanced) -> None:
        """A load of 3 N at one node costs log(1 + 900) / 2 and the weight of that node's rows, not of the others'."""
        statics = Statics(structure, balanced.mechanics)
        load = np.zeros((12, 3))
        load[5] = [0, 0, -3.0]
        position = pressed(structure, balanced, load)
        r = statics.residual_n(position)
        by_node = np.linalg.norm(r[:27].reshape(9, 3), axis=1)
        node = structure.free_nodes.tolist().index(5)
        assert by_node[node] > 1
        assert np.delete(by_node, node).max() < 1e-5


class TestRestStep:
    def test_nothing_measured_gives_a_shape_in_balance(self, structure, balanced) -> None:
        assert balanced.source == "found"
        assert balanced.unbalanced_n[1] < 0.001
        assert np.sqrt(np.trace(balanced.covariance_m2) / 9) == pytest.approx(0.0033, rel=0.3)

    def test_tare_finds_the_ratios_of_stiffness(self, structure) -> None:
        """Stiffness drawn 10 % apart, shape measured exactly: ratios come back, the scale stays with the prior."""
        rng = np.random.default_rng(4)
        true = replace(nominal(structure), stiffness_n_per_m=K * np.exp(0.1 * rng.standard_normal(24)))
        exact = RestSettings(measured_sigma_m=1e-6, stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        at_rest = rest_step(structure, true, None, exact).node_position_m
        found = rest_step(structure, nominal(structure), at_rest, RestSettings(measured_sigma_m=1e-5))
        free = structure.free_tendons
        error = np.log(found.mechanics.stiffness_n_per_m / true.stiffness_n_per_m)[free]
        assert np.std(error) < 0.02
        assert found.unbalanced_n[0] > 0.2
        assert found.unbalanced_n[1] < 0.005

    def test_covariance_is_honest(self, structure) -> None:
        """Noise and spread drawn as assumed: the squared error over its covariance is one per coordinate."""
        rng, nees = np.random.default_rng(5), []
        exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        for _ in range(12):
            stiffness = K * np.exp(0.1 * rng.standard_normal(24))
            length_m = structure.natural_length_m + 0.0003 * rng.standard_normal(24)
            true = Mechanics(stiffness, length_m, 0.03, 0.02)
            at_rest = rest_step(structure, true, None, exact).node_position_m
            measured = at_rest + 0.0003 * rng.standard_normal((12, 3))
            found = rest_step(structure, nominal(structure), measured, RestSettings())
            error = (found.node_position_m - at_rest)[3:].ravel()
            nees.append(error @ np.linalg.pinv(found.covariance_m2[9:, 9:], 1e-9) @ error / 21)
        assert 0.6 < np.mean(nees) < 1.5


class TestLoads:
    def test_what_is_observable(self, structure) -> None:
        seen = observable_loads(structure)
        assert [seen[n] for n in (0, 3, 4, 5)] == [Observable.NONE, Observable.ACROSS_ROD, *[Observable.ALL] * 2]

    @pytest.mark.parametrize("estimator", [FrameEstimator, LiveSmoother, BatchOptimizer])
    def test_a_known_press_comes_back(self, estimator, structure, balanced, lengths_of) -> None:
        """2 N down at node 5, lengths good to 0.1 mm: the load at 5 and at no other node."""
        load = np.zeros((12, 3))
        load[5] = [0.3, 0, -2.0]
        shapes = [balanced.node_position_m] * 5 + [pressed(structure, balanced, load * k / 15) for k in range(16)]
        shapes += shapes[-1:] * 30  # held for longer than loads are averaged over
        frames = [lengths_of(structure, x, 0.02 * k, 1e-4) for k, x in enumerate(shapes)]
        exact = replace(balanced, covariance_m2=1e-4 * balanced.covariance_m2)
        shape = list(estimator(structure, exact, Settings()).estimate(frames))[-1]
        np.testing.assert_allclose(shape.node_position_m, shapes[-1], atol=0.001)
        assert shape.loads.force_n[5] == pytest.approx(load[5], abs=0.3)
        others = np.delete(np.arange(3, 12), 2)
        assert np.linalg.norm(shape.loads.force_n[others], axis=1).max() < 0.2
        assert shape.loads.sigma_n[5] < 0.5
        assert np.isinf(shape.loads.sigma_n[0])

    def test_along_a_floating_rod_by_hand(self, structure, balanced) -> None:
        """The axial sum goes to the end that is pushed more across."""
        statics = Statics(structure, balanced.mechanics)
        r = np.zeros(len(statics.group))
        nodes = statics.nodes.tolist()
        r[3 * nodes.index(4)] = 0.5
        r[27 + statics.floating_rods.tolist().index([4, 5])] = 2.0
        loads = external_loads(statics, balanced.node_position_m, r, np.full(len(r), 0.01))
        w = balanced.node_position_m[5] - balanced.node_position_m[4]
        np.testing.assert_allclose(loads.force_n[4], [-0.5, 0, 0] - 2 * w / np.linalg.norm(w))
        np.testing.assert_allclose(loads.force_n[5], 0, atol=1e-15)
        assert loads.sigma_n[4] == pytest.approx(np.sqrt(0.04 / 3))


class TestHealth:
    def test_a_drifting_sensor_is_named_left_out_and_taken_back(self, structure, balanced, lengths_of) -> None:
        """One sensor of 24 drifts by 2 mm/s for 5 s, then is right again."""
        rng, frames = np.random.default_rng(6), []
        for k in range(550):
            drift = np.zeros(24)
            drift[14] = 0.002 * np.clip(0.02 * k - 1, 0, 5) * (k < 300)
            noise = drift + 2e-4 * rng.standard_normal(24)
            frames.append(lengths_of(structure, balanced.node_position_m, 0.02 * k, 5e-4, noise))
        shapes = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))
        named = np.array([shape.lengths.flags & Flag.IMPLAUSIBLE > 0 for shape in shapes])
        assert not np.delete(named, 14, axis=1).any()
        first = 0.02 * np.argmax(named[:, 14])
        assert 1 < first < 1 + 0.75 + 2  # three sigma are reached after 0.75 s
        assert named[250:300, 14].all()
        assert not named[-50:, 14].any()
        error = np.array([shape.node_position_m for shape in shapes]) - balanced.node_position_m
        assert np.sqrt((error[200:300] ** 2).sum(-1)).max() < 0.004
        assert shapes[260].status == Status.PARTIAL


class TestBranches:
    def test_without_stiffness_the_other_shape_is_told_of(self, example_structure, true_positions, lengths_of) -> None:
        """Lengths alone do not tell the two apart: both are given, with the same lengths, on either side."""
        t_s, positions = true_positions
        true = positions[np.searchsorted(t_s, 8.0)]
        rest = rest_step(example_structure, None, positions[0], RestSettings())
        builder = GraphBuilder(example_structure, rest, NoiseSettings())
        lengths = lengths_of(example_structure, true, sigma_m=2e-4)
        shape = FrameEstimator(example_structure, rest, Settings()).update(lengths)
        told = OtherBranch(builder, BranchSettings()).with_other(shape)
        assert told.status == Status.TWO_SHAPES
        other = told.other.node_position_m
        assert branch(example_structure, other) == -branch(example_structure, shape.node_position_m)
        np.testing.assert_allclose(
            example_structure.tendon_length_m(other), example_structure.tendon_length_m(true), atol=0.001
        )

    def test_with_equilibrium_it_is_ruled_out(self, structure, balanced, lengths_of) -> None:
        load = np.zeros((12, 3))
        load[8] = [0, 2.0, -2.0]
        true = pressed(structure, balanced, load)
        builder = GraphBuilder(structure, balanced, NoiseSettings())
        shape = FrameEstimator(structure, balanced, Settings()).update(lengths_of(structure, true, sigma_m=2e-4))
        assert OtherBranch(builder, BranchSettings()).with_other(shape).status == Status.OK


def test_a_trial_that_does_not_begin_at_rest_is_not_pulled_there(structure, balanced, lengths_of) -> None:
    """Exact lengths of a pressed shape from the first frame on: it is found at once, live and batch."""
    load = np.zeros((12, 3))
    load[8] = [0, 2.0, -2.0]
    true = pressed(structure, balanced, load)
    frames = [lengths_of(structure, true, 0.02 * k, 2e-4) for k in range(6)]
    for estimator in (LiveSmoother, BatchOptimizer):
        for shape in estimator(structure, replace(balanced, at_start=False), Settings()).estimate(frames):
            assert np.abs(shape.node_position_m - true).max() < 0.001


def test_no_frames_give_no_shapes(structure, balanced) -> None:
    assert list(BatchOptimizer(structure, balanced, Settings()).estimate([])) == []


def test_equilibrium_beats_lengths_alone(structure, balanced, lengths_of) -> None:
    """The mechanism: 0.5 mm of length error is many millimetres of node error without, about one with."""
    rng = np.random.default_rng(8)
    load = np.zeros((12, 3))
    load[10] = [1.5, 0, -1.0]
    true = pressed(structure, balanced, load)
    rmse = {}
    for name, rest in (("with", balanced), ("without", replace(balanced, mechanics=None))):
        estimator, squared = FrameEstimator(structure, rest, Settings()), []
        for _ in range(20):
            lengths = lengths_of(structure, true, sigma_m=5e-4, noise=5e-4 * rng.standard_normal(24))
            squared.append(((estimator.update(lengths).node_position_m - true) ** 2)[3:].sum(axis=1).mean())
        rmse[name] = np.sqrt(np.mean(squared))
    assert rmse["with"] < 0.0015
    assert rmse["with"] < rmse["without"] / 3
