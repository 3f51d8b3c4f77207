"""The estimator of single frames: against scipy, and what it says when readings leave a motion free."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from noise_settings import with_noise
from tensegraph import IndeterminateError
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.models.estimation import NoiseSettings
from tensegraph.models.structure.lengths import member_length_m


def test_frame_agrees_with_scipy(example_structure, press, lengths_of) -> None:
    """The same weighted residuals, minimised by another solver: same positions, same covariance.

    A tight prior keeps the shape where lengths are linear in it. It starts where gtsam ended.
    """
    structure, (_, positions, rest) = example_structure, press
    noise = 0.0005 * np.random.default_rng(7).standard_normal(24)
    lengths = lengths_of(structure, positions[75], noise=noise)
    settings, n = with_noise(shape_prior_m=0.002), NoiseSettings()
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
                ((x[free] - rest.node_position_m[free]) / 0.002).ravel(),
            ]
        )

    solution = least_squares(residual, shape.node_position_m.ravel(), xtol=1e-14, ftol=1e-14)
    covariance = np.linalg.inv(solution.jac.T @ solution.jac) + rest.covariance_m2
    apart = (shape.node_position_m.ravel() - solution.x) / np.sqrt(np.diag(covariance))
    assert np.abs(apart).max() < 0.1
    ratio = np.sqrt(np.diag(shape.covariance_m2) / np.diag(covariance))
    np.testing.assert_allclose(ratio, 1, atol=0.05)


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
