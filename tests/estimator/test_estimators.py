"""All estimators: exact on exact lengths, agreeing with each other, honest about what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from noise_settings import with_noise
from tensegraph import Reconstruction, Settings, Status, three_strut
from tensegraph.estimator.baselines.least_squares import LeastSquares
from tensegraph.estimator.baselines.unscented_kalman import UnscentedKalman
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import status_of
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.readings import ModelError

ESTIMATORS = [FrameEstimator, LiveSmoother, BatchOptimizer]


BASELINES = [LeastSquares, UnscentedKalman]


def test_a_length_that_tells_nothing_was_not_measured(structure, rest, lengths_of) -> None:
    """A strip that reads far beyond its range has a sigma of its own length."""
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.sigma_m[12] = 0.4 * lengths.length_m[12]
    assert status_of(lengths, structure) is Status.OK
    lengths.sigma_m[12] = 0.6 * lengths.length_m[12]
    assert status_of(lengths, structure) is Status.PARTIAL
    lengths.sigma_m[:] = 0.2
    assert status_of(lengths, structure) is Status.PRIOR_ONLY


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_exact_lengths_give_the_exact_shape(estimator, example_structure, press, lengths_of) -> None:
    """Noise off, priors next to off: what is left is the anchors' own 0.03 mm and the linearisation.

    Where the smallest singular value is below 0.005, 10 um of length are 3 mm of shape.
    """
    t_s, positions, rest = press
    settings = with_noise(shape_prior_m=10.0, stretching_m=1e-5, rod_m=1e-5, anchor_m=1e-5, motion_m_per_s15=30.0)
    frames = [lengths_of(example_structure, x, t, 1e-5) for t, x in zip(t_s, positions, strict=True)]
    shapes = list(estimator(example_structure, rest, settings).estimate(frames))
    error = np.array([s.node_position_m for s in shapes]) - positions
    assert np.sqrt((error**2).sum(-1)).max() < 0.004
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


def test_smoothing_beats_single_frames(example_structure, press, lengths_of) -> None:
    t_s, positions, rest = press
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


@pytest.mark.parametrize(
    "model_error", [None, ModelError(np.full(24, 3e-4), np.full(24, 0.17), np.full(24, 0.01), np.zeros(24))]
)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_missing_tendons_widen_and_are_said(estimator, model_error, structure, rest, lengths_of) -> None:
    frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(10)]
    frames = [replace(frame, model_error=model_error) for frame in frames]
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


def test_any_structure_runs(lengths_of) -> None:
    prism = three_strut(0.3, 0.18)
    variance = np.full((6, 3), 0.0003**2)
    variance[:3] = 0
    rest = RestShape(prism, find_rest_shape(prism), np.diag(variance.ravel()), "measured")
    frames = [lengths_of(prism, rest.node_position_m, 0.02 * k) for k in range(8)]
    for estimator in ESTIMATORS:
        shape = list(estimator(prism, rest, Settings()).estimate(frames))[-1]
        np.testing.assert_allclose(shape.node_position_m, rest.node_position_m, atol=3e-4)
