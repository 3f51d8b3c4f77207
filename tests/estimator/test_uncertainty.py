"""Covariances of shapes, against gtsam and against errors that were drawn."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import chi2

from balance import pressed
from noise_settings import with_noise
from tensegraph import Settings
from tensegraph.estimator.doubt import Doubt
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.linear_frame import linearised
from tensegraph.estimator.uncertainty import FrameEvidence, moments_of
from tensegraph.estimator.whole_trial.trial_balance import TrialBalance
from tensegraph.estimator.whole_trial.trial_factors import TrialFactors
from tensegraph.factors.noise import weigh
from tensegraph.models.estimation import DoubtSettings, NoiseSettings
from tensegraph.models.structure.lengths import length_jacobian
from tensegraph.models.structure.rigidity import rigidity
from tensegraph.models.values.readings import ModelError


class TestCovariance:
    def test_is_the_inverse_of_the_frame_s_information(self, structure, rest, lengths_of) -> None:
        """gtsam's own linearisation of the frame's factors, plus the rest shape's covariance, is the same.

        A tight prior keeps the shape where lengths are linear in it.
        """
        lengths = lengths_of(structure, rest.node_position_m, noise=1e-4)
        settings = with_noise(anchor_m=1e-6, shape_prior_m=0.0005)
        shape = FrameEstimator(structure, rest, settings).update(lengths)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        GraphBuilder(structure, rest, settings.noise).add_frame(graph, 0, weigh(lengths, settings.noise))
        for node, x in enumerate(shape.node_position_m):
            values.insertPoint3(node, x)
        expected = np.linalg.inv(graph.linearize(values).hessian()[0]) + rest.covariance_m2
        np.testing.assert_allclose(
            shape.covariance_m2[9:, 9:], expected[9:, 9:], rtol=0.03, atol=3e-9
        )  # sigmas are rounded to 1 %

    @pytest.mark.parametrize("shared", [0.0, 0.95])
    def test_nees_of_a_linear_gaussian_toy(self, shared, structure, rest, lengths_of) -> None:
        """Where the problem is linear (tight prior, noise drawn as assumed), NEES is chi-square with 3 per node.

        The error of a sum of lengths is that of its sigma, too, where sensors share an error that does not average out.
        """
        rng = np.random.default_rng(2)
        settings, free = with_noise(shape_prior_m=0.0005), structure.free_nodes
        exact = replace(rest, covariance_m2=np.zeros((36, 36)))
        estimator, nees, of_sum = FrameEstimator(structure, exact, settings), [], []
        summed = length_jacobian(rest.node_position_m, structure.tendons[structure.is_free_tendon]).sum(axis=0)
        sigma_m = np.hypot(0.0005, NoiseSettings().stretching_m)
        rods = length_jacobian(rest.node_position_m, structure.rods).reshape(6, -1)
        keep = np.eye(36) - rods.T @ np.linalg.pinv(rods.T)
        for _ in range(150):
            moved = 0.0005 * rng.standard_normal((12, 3)) * np.isin(np.arange(12), free)[:, None]
            moved = (keep @ moved.ravel()).reshape(12, 3) * np.isin(np.arange(12), free)[:, None]
            true = rest.node_position_m + moved
            noise = sigma_m * (shared * rng.standard_normal() + np.sqrt(1 - shared**2) * rng.standard_normal(24))
            untared = ModelError(np.full(24, shared * sigma_m), np.full(24, np.nan), np.ones(24), np.zeros(24))
            shape = estimator.update(replace(lengths_of(structure, true, noise=noise), model_error=untared))
            of_all = (shape.node_position_m - true).ravel()
            of_sum.append((summed @ of_all) ** 2 / (summed @ shape.covariance_m2 @ summed))
            error = of_all.reshape(-1, 3)[free]
            covariance = shape.node_covariance_m2[free]
            nees.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error).mean())
        low, high = chi2.ppf([0.001, 0.999], 3 * 150 * 3) / (150 * 3)  # nodes of a frame are not independent
        assert 0.8 * low < np.mean(nees) < 1.2 * high
        low, high = chi2.ppf([0.001, 0.999], 150) / 150
        assert 0.8 * low < np.mean(of_sum) < 1.2 * high


class TestSecondOrder:
    """Moments of the motion that lengths tell to second order only."""

    def test_of_a_parabola_they_are_those_of_a_normal_distribution(self) -> None:
        moments = moments_of(np.array(4.0), np.array(0.0), np.array(0.0))
        assert moments == pytest.approx([0.0, 4.0, 0.0, 48.0], rel=1e-6, abs=1e-9)

    @given(st.floats(1e-3, 50), st.floats(-2, 7))
    def test_they_are_those_of_the_density(self, sigma, log_flat) -> None:
        """Two minima with nothing but a low barrier between, or one that is much narrower than s: by quadrature.

        E = (a / s)^2 (1 + h a / s)^2 / 2 + f (a / s)^4 / 8 has its second minimum at -s / h, for f = 0.
        """
        h = 0.25
        skew, quartic = 2 * h, 4 * h**2 + 10**log_flat
        narrow = quartic**-0.25

        def mean_of(power: int) -> float:
            def density(b: float) -> float:
                a = narrow * b
                return b**power * np.exp(-(0.5 * a**2 + 0.5 * skew * a**3 + 0.125 * quartic * a**4))

            return narrow**power * quad(density, -8, 8, points=[-1, 0])[0]

        got = moments_of(np.array(sigma**2), np.array(skew / sigma**3), np.array(quartic / sigma**4))
        expected = [sigma**n * mean_of(n) / mean_of(0) for n in (1, 2, 3, 4)]
        assert got == pytest.approx(expected, rel=1e-3, abs=1e-6 * sigma * narrow)

    def test_a_minimum_beyond_a_barrier_is_another_shape(self) -> None:
        far = moments_of(np.array(1.0), np.array(2 / 18), np.array(4 / 18**2))  # the barrier is 18^2 / 32 = 10
        near = moments_of(np.array(1.0), np.array(2 / 8), np.array(4 / 8**2))  # and 2 here
        assert abs(far[0]) < 0.5
        assert far[1] < 1.5
        assert near[0] == pytest.approx(-8 / 2, rel=0.01)
        assert near[1] == pytest.approx(8**2 / 2, rel=0.1)

    def test_the_moments_are_continuous(self) -> None:
        w = np.linspace(4, 20, 801)
        mean, square, *_ = moments_of(np.ones_like(w), 2 / w, 4 / w**2)
        assert np.abs(np.diff(mean)).max() < 0.1
        assert np.abs(np.diff(square)).max() < 1.0

    def test_shapes_whose_lengths_are_nearly_singular_are_the_mean_of_what_samples_say(
        self, structure, rest, lengths_of
    ) -> None:
        """Importance sampling of the frame's own error along the whole curve of shapes: mean and covariance agree."""
        settings, free = Settings(), structure.free_coordinates
        exact = replace(rest, covariance_m2=np.zeros((36, 36)))
        true_m = rest.node_position_m + 0.008 * rigidity(structure, rest.node_position_m).mechanism
        noise = 0.001 * np.random.default_rng(2).standard_normal(24)
        lengths = lengths_of(structure, true_m, sigma_m=0.001, noise=noise)
        builder = GraphBuilder(structure, exact, settings.noise)
        measured = weigh(lengths, settings.noise)
        factors = TrialFactors(builder, [measured], TrialBalance.of_newest(builder, 1))
        shape = FrameEstimator(structure, exact, settings).update(lengths)
        # samples of twice the covariance in all directions, weighed by their error
        rng, count = np.random.default_rng(3), 400_000
        covariance = shape.covariance_m2[np.ix_(free, free)]
        drawn = rng.standard_normal((count, len(free)))
        x = np.repeat(shape.node_position_m.reshape(1, -1), count, axis=0)
        x[:, free] += 1.2 * drawn @ np.linalg.cholesky(covariance).T
        error = factors.error(x.reshape(count, 12, 3), np.zeros(count, dtype=np.int64))
        log_weight = -error + 0.5 * np.sum(drawn**2, axis=1)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        assert 1 / np.sum(weight**2) > 300
        mean = weight @ x[:, free]
        sampled = (x[:, free] - mean).T @ ((x[:, free] - mean) * weight[:, None])
        sigma = np.sqrt(np.diag(sampled))
        assert np.abs(mean - shape.node_position_m.ravel()[free]).max() < 0.5 * sigma.max()
        np.testing.assert_allclose(np.trace(covariance), np.trace(sampled), rtol=0.3)

    def test_ellipsoids_hold_shapes_whose_lengths_are_nearly_singular(self, structure, rest, lengths_of) -> None:
        """True shapes 10 mm away along the mechanism, on both sides of the rest shape; 86 % with the Hessian alone.

        Minima are 11 mm off, and their mean, in which both sides count, is 5 mm off.
        """
        rng = np.random.default_rng(4)
        settings, free = Settings(), structure.free_nodes
        mechanism = rigidity(structure, rest.node_position_m).mechanism
        inside, squared_m2 = [], []
        for step_m in [-0.01, 0.01] * 30:
            true_m = rest.node_position_m + step_m * mechanism
            lengths = lengths_of(structure, true_m, sigma_m=0.001, noise=0.001 * rng.standard_normal(24))
            start_m = rest.node_position_m.copy()
            start_m[free] += 0.005 * rng.standard_normal((len(free), 3))
            start = replace(rest, node_position_m=start_m, covariance_m2=np.zeros((36, 36)))
            shape = FrameEstimator(structure, start, settings).update(lengths)
            error = (shape.node_position_m - true_m)[free]
            squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(shape.node_covariance_m2[free]), error)
            inside.append(squared < chi2.ppf(0.95, 3))
            squared_m2.append(np.sum(error**2, axis=1))
        assert np.mean(inside) > 0.93
        assert np.sqrt(np.mean(squared_m2)) < 0.007


@pytest.mark.parametrize("many_loads", [0.0, 0.1])
def test_a_length_that_a_kernel_weighs_little_says_little(many_loads, structure, balanced, lengths_of) -> None:
    """One length 30 mm off: as without it, the mean does not move, and sigma is not smaller."""
    settings = with_noise(robust="cauchy")
    builder = GraphBuilder(structure, balanced, settings.noise)
    evidence, tendon = FrameEvidence(builder, settings.doubt), int(structure.free_tendons[5])
    lengths = lengths_of(structure, balanced.node_position_m)
    off_m = np.where(np.arange(24) == tendon, 0.03, 0.0)
    found = []
    for told in (
        weigh(replace(lengths, length_m=lengths.length_m + off_m), settings.noise),
        weigh(lengths, settings.noise),
    ):
        measured = told.without(off_m > 0) if found else told
        position = builder.search(measured, balanced.node_position_m).finished().node_position_m
        doubt = Doubt(many_loads=many_loads, many_loads_n=1.0)
        found.append(evidence.assess(linearised(builder, position, measured), position, doubt))
    with_it, without_it = found
    np.testing.assert_allclose(with_it.node_position_m, without_it.node_position_m, atol=0.0005)
    assert np.trace(with_it.covariance_m2) == pytest.approx(np.trace(without_it.covariance_m2), rel=0.05)


class TestHiddenLoads:
    def test_missing_lengths_give_the_ellipsoids_of_all_probable_loads(self, structure, balanced, lengths_of) -> None:
        """Loads drawn as the settings say, and no length measured: the ellipsoids contain the loaded shapes."""
        rng = np.random.default_rng(6)
        settings = Settings()
        missing = lengths_of(structure, balanced.node_position_m, noise=np.nan)
        shape = FrameEstimator(structure, balanced, settings).update(missing)
        free = structure.free_nodes
        inside = []
        for _ in range(25):
            load = np.zeros((12, 3))
            chosen = free[rng.random(len(free)) < settings.doubt.loaded_share]
            load[chosen] = settings.doubt.load_n * rng.standard_normal((len(chosen), 3))
            error = (pressed(structure, balanced, load) - shape.node_position_m)[free]
            nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(shape.node_covariance_m2[free]), error)
            inside.append(nees < chi2.ppf(0.95, 3))
        assert 0.85 < np.mean(inside) < 0.99

    def test_poor_lengths_that_contradict_the_balance_widen_the_ellipsoids(
        self, structure, balanced, lengths_of
    ) -> None:
        """3 N at node 8, and lengths with a noise of 5 mm: most shapes are near the rest shape, and do not say so."""
        rng, settings, free = np.random.default_rng(7), Settings(), structure.free_nodes
        true_m = pressed(structure, balanced, np.where(np.arange(12)[:, None] == 8, [0, 0, -3.0], 0.0))
        estimator, inside = FrameEstimator(structure, balanced, settings), []
        for _ in range(60):
            noise = 0.005 * rng.standard_normal(24)
            shape = estimator.update(lengths_of(structure, true_m, sigma_m=0.005, noise=noise))
            error = (shape.node_position_m - true_m)[free]
            nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(shape.node_covariance_m2[free]), error)
            inside.append(nees < chi2.ppf(0.999, 3))
        assert np.mean(inside) > 0.9

    def test_measured_lengths_leave_no_room_for_them(self, structure, balanced, lengths_of) -> None:
        """With all lengths measured, loads of 1.5 N that might hide widen sigma by less than a fourth."""
        lengths = lengths_of(structure, balanced.node_position_m)
        hidden, none = (
            FrameEstimator(structure, balanced, replace(Settings(), doubt=DoubtSettings(loaded_share=share)))
            .update(lengths)
            .node_sigma_m.mean()
            for share in (0.1, 1e-9)
        )
        assert none < hidden < 1.25 * none


def test_many_loads_are_mixed_in(structure, balanced, lengths_of) -> None:
    """The covariance is that of the mixture: linear in the probability, apart from what the rest shape adds."""
    settings = Settings()
    builder = GraphBuilder(structure, balanced, settings.noise)
    measured = weigh(lengths_of(structure, balanced.node_position_m), settings.noise)
    frame = linearised(builder, balanced.node_position_m, measured)
    evidence = FrameEvidence(builder, settings.doubt)
    few, half, many = (
        evidence.assess(frame, balanced.node_position_m, Doubt(probability, 1.0)).covariance_m2
        for probability in (0.0, 0.5, 1.0)
    )
    np.testing.assert_allclose(half, 0.5 * (few + many), rtol=1e-9)
    assert np.trace(many) > 2 * np.trace(few)
