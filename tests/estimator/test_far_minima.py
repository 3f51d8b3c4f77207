"""Other minima, far from a shape that hardly explains its frame."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Settings
from tensegraph.estimator import branches
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import MAX_FRAME_ITERATIONS, GraphBuilder
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.estimator.whole_trial import far_minima as far_minima_module
from tensegraph.estimator.whole_trial import second_shapes
from tensegraph.estimator.whole_trial.far_minima import far_minima, is_unlikely
from tensegraph.estimator.whole_trial.own_minima import own_minima
from tensegraph.estimator.whole_trial.trial_factors import TrialFactors
from tensegraph.factors.noise import weigh
from tensegraph.models.estimation import BranchSettings, NoiseSettings
from tensegraph.models.structure.rest_shape import GeometrySigma, RestSettings
from tensegraph.models.structure.shape import Status

COUNT = 20
FIRST = np.zeros(1, dtype=np.int64)


class PressedFrames:
    """Frames of exact lengths of one pressed shape, without stiffness: two shapes have these lengths."""

    def __init__(self, structure, positions, lengths_of) -> None:
        true_m = positions[np.argmax(np.linalg.norm(positions - positions[0], axis=(1, 2)))]
        rest = rest_step(structure, None, positions[0], GeometrySigma(), RestSettings())
        self.structure, self.rest = structure, replace(rest, at_start=False)
        self.builder = GraphBuilder(structure, self.rest, NoiseSettings())
        frames = [lengths_of(structure, true_m, 0.02 * k, sigma_m=2e-4) for k in range(COUNT)]
        self.measured = [weigh(lengths, NoiseSettings()) for lengths in frames]
        self.factors = TrialFactors(self.builder, self.measured, None)
        minima_m, error = own_minima(self.factors, np.repeat(true_m[None], COUNT, axis=0))
        self.first_m, self.error = minima_m[:1], error[0]


@pytest.fixture
def frames(example_structure, true_positions, lengths_of) -> PressedFrames:
    return PressedFrames(example_structure, true_positions[1], lengths_of)


def test_an_error_beyond_that_of_95_per_cent_is_unlikely(structure) -> None:
    """By the tables, chi^2 with 27 degrees of freedom is below 40.11 in 95 % of all cases."""
    np.testing.assert_array_equal(is_unlikely(structure, np.array([0.0, 20.0, 20.1])), [False, False, True])


def test_the_other_shape_of_the_same_lengths_is_found(frames) -> None:
    numbers = np.array([3, 7])
    other_m, error = far_minima(frames.structure, frames.factors, numbers, np.repeat(frames.first_m, 2, axis=0))
    assert np.linalg.norm(other_m[0] - frames.first_m[0], axis=1).max() > 0.02
    measured_m = frames.measured[0].lengths.length_m
    np.testing.assert_allclose(frames.structure.tendon_length_m(other_m[0]), measured_m, atol=0.001)
    np.testing.assert_allclose(other_m[0], other_m[1], atol=1e-4)
    np.testing.assert_allclose(error, frames.factors.error(other_m, numbers), atol=1e-6)


def test_where_the_shape_is_unlikely_the_far_one_is_told_too(frames, monkeypatch) -> None:
    """Live, batch and single frames tell it, where the search across det J = 0 finds nothing."""
    far_m, error = far_minima(frames.structure, frames.factors, FIRST, frames.first_m)
    monkeypatch.setattr(far_minima_module, "LIKELY", 0.0)
    for module in (branches, second_shapes):
        monkeypatch.setattr(module, "across", lambda structure, node_position_m: node_position_m)
    first_m = np.repeat(frames.first_m, COUNT, axis=0)
    found = second_shapes.second_shapes(frames.structure, BranchSettings(), frames.factors, first_m)
    shape = FrameEstimator(frames.structure, frames.rest, Settings()).update(frames.measured[0].lengths)
    shape = replace(shape, node_position_m=frames.first_m[0], covariance_m2=1e-6 * np.eye(36))
    live = branches.OtherBranch(frames.builder, BranchSettings())
    for _ in range(2 * MAX_FRAME_ITERATIONS):
        told = live.with_other(shape)
    at_once = live.with_other_at_once(shape, frames.error)
    assert at_once.status is Status.TWO_SHAPES
    for other in (found[0], told.other, at_once.other):
        np.testing.assert_allclose(other.node_position_m, far_m[0], atol=1e-3)
        assert other.log_ratio == pytest.approx(error[0] - frames.error, abs=0.02)
