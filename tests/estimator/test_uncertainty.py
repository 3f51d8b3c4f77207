"""Covariances of shapes, against gtsam and against errors that were drawn."""

from dataclasses import replace

import gtsam
import numpy as np
from scipy.stats import chi2

from noise_settings import with_noise
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.factors.noise import weigh
from tensegraph.models.estimation import NoiseSettings
from tensegraph.models.structure.lengths import length_jacobian


class TestCovariance:
    def test_is_the_inverse_of_the_frame_s_information(self, structure, rest, lengths_of) -> None:
        """gtsam's own linearisation of the frame's factors, plus the rest shape's covariance, is the same."""
        lengths = lengths_of(structure, rest.node_position_m, noise=1e-4)
        settings = with_noise(anchor_m=1e-6)
        shape = FrameEstimator(structure, rest, settings).update(lengths)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        GraphBuilder(structure, rest, settings.noise).add_frame(graph, 0, weigh(lengths, settings.noise))
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
