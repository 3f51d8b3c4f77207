"""Estimators: exact on exact lengths, agreeing with each other and with other solvers, honest about what is missing."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from tensegraph import IndeterminateError, Reconstruction, Settings, Status, three_strut
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.least_squares import LeastSquares
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.estimator.unscented_kalman import UnscentedKalman
from tensegraph.models.estimation import NoiseSettings, SmootherSettings
from tensegraph.models.evaluation.alignment import interpolated
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.rigidity import find_rest_shape
from tensegraph.models.structure.shape import ellipsoids

ESTIMATORS = [FrameEstimator, LiveSmoother, BatchOptimizer]
BASELINES = [LeastSquares, UnscentedKalman]


def with_noise(**changes) -> Settings:
    return replace(Settings(), noise=replace(NoiseSettings(), **changes))


@pytest.fixture(scope="module")
def pressed(example_structure, true_positions):
    """A press and its release: true shapes of the example trial, 6 to 9 s, and the rest shape as known."""
    t_s, positions = true_positions
    during = (t_s >= 6) & (t_s < 9)
    variance = np.full((12, 3), 0.0003**2)
    variance[example_structure.anchors] = 0
    rest = RestShape(positions[during][0], np.diag(variance.ravel()), "measured")
    return t_s[during], positions[during], rest


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_exact_lengths_give_the_exact_shape(estimator, example_structure, pressed, lengths_of) -> None:
    """Noise off, priors next to off: what is left is the anchors' own 0.03 mm and the linearisation."""
    t_s, positions, rest = pressed
    settings = with_noise(shape_prior_m=10.0, stretching_m=1e-5, rod_m=1e-5, anchor_m=1e-5, motion_m_per_s15=30.0)
    frames = [lengths_of(example_structure, x, t, 1e-5) for t, x in zip(t_s, positions, strict=True)]
    shapes = list(estimator(example_structure, rest, settings).estimate(frames))
    error = np.array([s.node_position_m for s in shapes]) - positions
    assert np.sqrt((error**2).sum(-1)).max() < 0.002
    assert np.median(np.sqrt((error**2).sum(-1))) < 0.0002


@pytest.mark.parametrize("estimator", ESTIMATORS + BASELINES)
def test_all_give_the_same_kind_of_shape(estimator, structure, rest, lengths_of) -> None:
    frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(12)]
    shapes = list(estimator(structure, rest, Settings()).estimate(frames))
    assert [s.t_s for s in shapes] == [f.t_s for f in frames]
    for shape in shapes:
        assert shape.node_position_m.shape == (12, 3)
        assert shape.covariance_m2.shape == (36, 36)
        np.testing.assert_allclose(shape.covariance_m2, shape.covariance_m2.T, atol=1e-12)
        assert np.linalg.eigvalsh(shape.covariance_m2).min() > 0
        assert shape.status == Status.OK


def test_frame_agrees_with_scipy(example_structure, pressed, lengths_of) -> None:
    """The same weighted residuals, minimised by another solver: same positions, same covariance.

    It starts where gtsam ended: from the rest shape either may take either of the two shapes with these lengths.
    """
    structure, (_, positions, rest) = example_structure, pressed
    noise = 0.0005 * np.random.default_rng(7).standard_normal(24)
    lengths = lengths_of(structure, positions[75], noise=noise)
    settings, n = with_noise(shape_prior_m=0.01), NoiseSettings()
    shape = FrameEstimator(structure, rest, settings).update(lengths)
    members = np.concatenate([structure.rods, structure.tendons])
    target = np.concatenate([structure.rod_length_m, lengths.length_m])
    sigma = np.concatenate([np.full(6, n.rod_m), np.full(24, np.hypot(n.stretching_m, 0.0005))])
    free = structure.free_nodes

    def residual(x):
        x = x.reshape(12, 3)
        return np.concatenate(
            [
                (member_length_m(x, members) - target) / sigma,
                ((x[:3] - structure.anchor_position_m) / n.anchor_m).ravel(),
                ((x[free] - rest.node_position_m[free]) / 0.01).ravel(),
            ]
        )

    solution = least_squares(residual, shape.node_position_m.ravel(), xtol=1e-14, ftol=1e-14)
    covariance = np.linalg.inv(solution.jac.T @ solution.jac) + rest.covariance_m2
    apart = (shape.node_position_m.ravel() - solution.x) / np.sqrt(np.diag(covariance))
    assert np.abs(apart).max() < 0.1
    ratio = np.sqrt(np.diag(shape.covariance_m2) / np.diag(covariance))
    np.testing.assert_allclose(ratio, 1, atol=0.05)


def test_live_with_a_long_lag_ends_where_batch_ends(structure, rest, lengths_of) -> None:
    """The newest frame's posterior is the same whether old frames are kept, marginalised or optimised at once."""
    rng = np.random.default_rng(3)
    frames = [
        lengths_of(structure, rest.node_position_m, 0.02 * k, noise=1e-5 * rng.standard_normal(24)) for k in range(30)
    ]
    settings = with_noise(shape_prior_m=0.003)
    batch = list(BatchOptimizer(structure, rest, settings).estimate(frames))[-1]
    for lag in (2, 5, 40):
        live = list(
            LiveSmoother(structure, rest, replace(settings, smoother=SmootherSettings(lag=lag))).estimate(frames)
        )[-1]
        np.testing.assert_allclose(live.node_position_m, batch.node_position_m, atol=5e-6)
        np.testing.assert_allclose(live.covariance_m2, batch.covariance_m2, rtol=0.02, atol=1e-10)


def test_batch_takes_lengths_without_their_lag(structure, rest, lengths_of) -> None:
    """Lengths that come two frames late are used two frames earlier; the last ones stand in for what never came."""
    frames = [
        replace(lengths_of(structure, rest.node_position_m, 0.02 * k, noise=1e-5 * k), lag_s=0.038) for k in range(9)
    ]
    shapes = list(BatchOptimizer(structure, rest, Settings()).estimate(frames))
    assert [shape.t_s for shape in shapes] == [frame.t_s for frame in frames]
    for shape, later in zip(shapes, [2, 3, 4, 5, 6, 7, 8, 8, 8], strict=True):
        np.testing.assert_array_equal(shape.lengths.length_m, frames[later].length_m)


def test_live_uses_the_past_only(structure, rest, lengths_of) -> None:
    rng = np.random.default_rng(3)
    frames = [
        lengths_of(structure, rest.node_position_m, 0.02 * k, noise=5e-4 * rng.standard_normal(24)) for k in range(20)
    ]
    part = list(LiveSmoother(structure, rest, Settings()).estimate(frames[:10]))
    whole = list(LiveSmoother(structure, rest, Settings()).estimate(frames))
    for a, b in zip(part, whole, strict=False):
        np.testing.assert_array_equal(a.node_position_m, b.node_position_m)


def test_smoothing_beats_single_frames(example_structure, pressed, lengths_of) -> None:
    t_s, positions, rest = pressed
    rng = np.random.default_rng(11)
    frames = [
        lengths_of(example_structure, x, t, noise=5e-4 * rng.standard_normal(24))
        for t, x in zip(t_s, positions, strict=True)
    ]
    rmse = {}
    for estimator in ESTIMATORS:
        shapes = estimator(example_structure, rest, Settings()).estimate(frames)
        rmse[estimator] = node_rmse_m(Reconstruction.of(example_structure, shapes), t_s, positions)
    assert rmse[LiveSmoother] < rmse[FrameEstimator]
    assert rmse[BatchOptimizer] < 1.1 * rmse[LiveSmoother]


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_missing_tendons_widen_and_are_said(estimator, structure, rest, lengths_of) -> None:
    frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(10)]
    whole = list(estimator(structure, rest, Settings()).estimate(frames))[-1]
    for frame in frames:
        frame.length_m[[5, 9, 20]] = np.nan
    part = list(estimator(structure, rest, Settings()).estimate(frames))[-1]
    assert part.status == Status.PARTIAL
    assert np.trace(part.covariance_m2) > np.trace(whole.covariance_m2)
    for frame in frames:
        frame.length_m[:] = np.nan
    none = list(estimator(structure, rest, Settings()).estimate(frames))[-1]
    assert none.status == Status.PRIOR_ONLY
    assert "no tendon was measured" in none.status.advice
    assert np.trace(none.covariance_m2) > np.trace(part.covariance_m2)


def test_an_indeterminate_frame_names_nodes_and_what_is_missing(structure, rest, lengths_of) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[[15, 16, 17, 18]] = np.nan  # all tendons of node 5
    estimator = FrameEstimator(structure, rest, with_noise(shape_prior_m=np.inf))
    with pytest.raises(IndeterminateError, match=r"nodes .*5.*tendons left out: 15, 16, 17, 18.*shape_prior_m"):
        estimator.update(lengths)


def test_lengths_alone_do_not_hold_the_rest_shape(structure, rest, lengths_of) -> None:
    """The mechanism: even with all 24 lengths, one motion of all free nodes is left."""
    estimator = FrameEstimator(structure, rest, with_noise(shape_prior_m=np.inf))
    with pytest.raises(IndeterminateError, match="leave 1 of their motions free"):
        estimator.update(lengths_of(structure, rest.node_position_m))


def test_any_structure_runs(lengths_of) -> None:
    prism = three_strut(0.3, 0.18)
    variance = np.full((6, 3), 0.0003**2)
    variance[:3] = 0
    rest = RestShape(find_rest_shape(prism), np.diag(variance.ravel()), "measured")
    frames = [lengths_of(prism, rest.node_position_m, 0.02 * k) for k in range(8)]
    for estimator in ESTIMATORS:
        shape = list(estimator(prism, rest, Settings()).estimate(frames))[-1]
        np.testing.assert_allclose(shape.node_position_m, rest.node_position_m, atol=1e-4)


def test_live_memory_is_bounded(structure, rest, lengths_of) -> None:
    smoother = LiveSmoother(structure, rest, Settings())
    sizes = []
    for k in range(200):
        smoother.update(lengths_of(structure, rest.node_position_m, 0.02 * k))
        sizes.append((smoother._isam.size(), smoother._isam.getLinearizationPoint().size()))
    assert len(set(sizes[50:])) == 1


class TestCovariance:
    def test_is_the_inverse_of_the_frame_s_information(self, structure, rest, lengths_of) -> None:
        """gtsam's own linearisation of the frame's factors, plus the rest shape's covariance, is the same."""
        lengths = lengths_of(structure, rest.node_position_m, noise=1e-4)
        settings = with_noise(anchor_m=1e-6)
        shape = FrameEstimator(structure, rest, settings).update(lengths)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        GraphBuilder(structure, rest, settings.noise).add_frame(graph, 0, lengths)
        for node, x in enumerate(shape.node_position_m):
            values.insertPoint3(node, x)
        expected = np.linalg.inv(graph.linearize(values).hessian()[0]) + rest.covariance_m2
        np.testing.assert_allclose(
            shape.covariance_m2[9:, 9:], expected[9:, 9:], rtol=0.03, atol=3e-9
        )  # sigmas are rounded to 1 %

    def test_nees_of_a_linear_gaussian_toy(self, structure, rest, lengths_of) -> None:
        """Where the problem is linear (tight prior, noise drawn as assumed), NEES is chi-square with 3 per node."""
        rng = np.random.default_rng(2)
        settings, free = with_noise(shape_prior_m=0.0005), structure.free_nodes
        exact = replace(rest, covariance_m2=np.zeros((36, 36)))
        estimator, nees = FrameEstimator(structure, exact, settings), []
        sigma_m = np.hypot(0.0005, NoiseSettings().stretching_m)
        rods = length_jacobian(rest.node_position_m, structure.rods).reshape(6, -1)
        keep = np.eye(36) - rods.T @ np.linalg.pinv(rods.T)
        for _ in range(150):
            moved = 0.0005 * rng.standard_normal((12, 3)) * np.isin(np.arange(12), free)[:, None]
            moved = (keep @ moved.ravel()).reshape(12, 3) * np.isin(np.arange(12), free)[:, None]
            true = rest.node_position_m + moved
            shape = estimator.update(lengths_of(structure, true, noise=sigma_m * rng.standard_normal(24)))
            error = (shape.node_position_m - true)[free]
            covariance = shape.node_covariance_m2[free]
            nees.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error).mean())
        low, high = chi2.ppf([0.001, 0.999], 3 * 150 * 3) / (150 * 3)  # nodes of a frame are not independent
        assert 0.8 * low < np.mean(nees) < 1.2 * high


class TestBaselines:
    def test_least_squares_solves_the_paper_s_equations(self, example_structure, pressed, lengths_of) -> None:
        """As many lengths as unknowns: at the solution every rod and tendon has its length."""
        t_s, positions, rest = pressed
        frames = [lengths_of(example_structure, x, t) for t, x in zip(t_s[:60], positions[:60], strict=True)]
        for shape, frame in zip(
            LeastSquares(example_structure, rest, Settings()).estimate(frames), frames, strict=True
        ):
            found_m = example_structure.tendon_length_m(shape.node_position_m)[example_structure.free_tendons]
            np.testing.assert_allclose(found_m, frame.length_m[example_structure.free_tendons], atol=5e-5)

    def test_least_squares_does_not_claim_what_lengths_do_not_see(self, structure, rest, lengths_of) -> None:
        """At rest the twist is unseen: its sigma is a rod's length; with a board gone, more motions are."""
        frame = lengths_of(structure, rest.node_position_m)
        shape = LeastSquares(structure, rest, Settings()).update(frame)
        assert np.sqrt(np.linalg.eigvalsh(shape.covariance_m2)[-1]) == pytest.approx(0.3, rel=0.05)
        half = replace(frame, length_m=np.where(np.arange(24) < 12, frame.length_m, np.nan))
        half = replace(half, sigma_m=np.where(np.arange(24) < 12, frame.sigma_m, np.inf))
        shape = LeastSquares(structure, rest, Settings()).update(half)
        assert (np.sqrt(np.linalg.eigvalsh(shape.covariance_m2)) > 0.29).sum() == 12
        assert shape.status == Status.PARTIAL

    def test_the_ukf_is_the_kalman_filter_where_all_is_linear(self, structure, rest, lengths_of) -> None:
        """One update by hand from a prior so tight that lengths are straight lines: x + K (z - h), (1 - K H) P."""
        settings = with_noise(motion_m_per_s15=1e-6)
        tight = RestShape(rest.node_position_m, 1e-4 * rest.covariance_m2, "measured")
        settings = replace(settings, noise=replace(settings.noise, anchor_m=1e-6))
        noise = 1e-5 * np.random.default_rng(3).standard_normal(24)
        shape = UnscentedKalman(structure, tight, settings).update(
            lengths_of(structure, rest.node_position_m, sigma_m=1e-5, noise=noise)
        )
        members = np.concatenate([structure.rods, structure.tendons])
        H = np.zeros((39, 36))
        H[:30] = length_jacobian(rest.node_position_m, members).reshape(30, -1)
        H[30:, :9] = np.eye(9)
        P = tight.covariance_m2 + (1e-12 + (1e-6 * 0.2) ** 2 * 0.02) * np.eye(36)
        tendon = np.full(24, np.hypot(1e-5, NoiseSettings().stretching_m))
        R = np.diag(np.concatenate([np.full(6, NoiseSettings().rod_m), tendon, np.full(9, 1e-6)]) ** 2)
        z = np.concatenate([structure.rod_length_m, structure.tendon_length_m(rest.node_position_m) + noise])
        innovation = np.concatenate([z - member_length_m(rest.node_position_m, members), np.zeros(9)])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        moved = (shape.node_position_m - rest.node_position_m).ravel()
        np.testing.assert_allclose(moved, K @ innovation, atol=2e-8)
        np.testing.assert_allclose(
            shape.covariance_m2, (np.eye(36) - K @ H) @ P + 1e-12 * np.eye(36), rtol=1e-3, atol=1e-14
        )

    def test_a_filter_that_breaks_says_so(self, structure, rest, lengths_of) -> None:
        filter_ = UnscentedKalman(structure, rest, Settings())
        filter_._filter.P = -np.eye(36)
        with pytest.raises(IndeterminateError, match=r"t = 1\.500 s: the filter's covariance is no longer one"):
            filter_.update(lengths_of(structure, rest.node_position_m, 1.5))


class TestEllipsoids:
    def test_axes_by_hand(self) -> None:
        """Variances 1, 4, 9 along z, y, x: semi-axes 3, 2, 1 times sqrt(chi2_3(0.95)) = 2.7955."""
        region = ellipsoids(np.diag([9.0, 4.0, 1.0]), 0.95)
        np.testing.assert_allclose(region.semi_axis_m, 2.7954834829 * np.array([3, 2, 1]))
        np.testing.assert_allclose(np.abs(region.axes), np.eye(3), atol=1e-12)

    def test_are_right_handed_and_rebuild_the_covariance(self) -> None:
        a = np.random.default_rng(0).standard_normal((5, 3, 3))
        covariance = a @ a.swapaxes(-1, -2)
        region = ellipsoids(covariance, 0.68)
        np.testing.assert_allclose(np.linalg.det(region.axes), 1)
        scale = chi2.ppf(0.68, 3)
        rebuilt = np.einsum("nij,nj,nkj->nik", region.axes, region.semi_axis_m**2 / scale, region.axes)
        np.testing.assert_allclose(rebuilt, covariance, atol=1e-12)

    def test_hold_their_share(self) -> None:
        rng = np.random.default_rng(0)
        covariance = np.diag([4.0, 1.0, 0.25])
        points = rng.multivariate_normal(np.zeros(3), covariance, 20_000)
        region = ellipsoids(covariance, 0.5)
        inside = (((points @ region.axes) / region.semi_axis_m) ** 2).sum(axis=1) <= 1
        assert inside.mean() == pytest.approx(0.5, abs=0.02)


class TestEvaluation:
    def test_node_rmse_by_hand(self, structure, rest, lengths_of) -> None:
        """Each of 9 free nodes 3 mm off in x and 4 mm in z: 5 mm."""
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
        truth = result.node_position_m + np.array([0.003, 0, 0.004])
        assert node_rmse_m(result, result.t_s, truth) == pytest.approx(0.005)

    def test_truth_is_interpolated(self) -> None:
        at = interpolated(np.array([0.25, 1.5]), np.array([0.0, 1.0, 2.0]), np.array([0.0, 4.0, 8.0])[:, None, None])
        np.testing.assert_allclose(at.ravel(), [1.0, 6.0])


class TestReconstruction:
    def test_innovations(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(4)]
        frames[-1].length_m[7] = np.nan
        frames[-1].sigma_m[7] = np.inf
        result = Reconstruction.of(structure, LiveSmoother(structure, rest, Settings()).estimate(frames))
        np.testing.assert_allclose(result.predicted_m, structure.tendon_length_m(result.node_position_m))
        assert (result.innovation_sigma_m[0] < 0.0005).all()
        jacobian = length_jacobian(result.node_position_m[-1], structure.tendons).reshape(24, -1)
        expected = np.sqrt(jacobian[7] @ result.covariance_m2[-1] @ jacobian[7])
        assert result.innovation_sigma_m[-1, 7] == pytest.approx(expected)

    def test_mechanism_is_seen(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
        assert (result.smallest_singular_value < 1e-3).all()
        assert (result.mechanism_sigma_m > 0.9 * NoiseSettings().shape_prior_m).all()

    def test_iterates_as_shapes(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
        again = Reconstruction.of(structure, iter(result))
        np.testing.assert_array_equal(again.covariance_m2, result.covariance_m2)
        assert len(again) == 3
