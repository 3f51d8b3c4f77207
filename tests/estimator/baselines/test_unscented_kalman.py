"""The unscented Kalman filter."""

from dataclasses import replace

import numpy as np
import pytest

from noise_settings import with_noise
from tensegraph import IndeterminateError, Settings
from tensegraph.estimator.baselines.unscented_kalman import UnscentedKalman
from tensegraph.models.estimation import NoiseSettings
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestShape


class TestUnscentedKalman:
    def test_the_ukf_is_the_kalman_filter_where_all_is_linear(self, structure, rest, lengths_of) -> None:
        """One update by hand from a prior so tight that lengths are straight lines: x + K (z - h), (1 - K H) P."""
        settings = with_noise(motion_m_per_s15=1e-4)
        tight = RestShape(rest.structure, rest.node_position_m, 1e-4 * rest.covariance_m2, "measured")
        settings = replace(settings, noise=replace(settings.noise, anchor_m=1e-6))
        noise = 1e-5 * np.random.default_rng(3).standard_normal(24)
        shape = UnscentedKalman(structure, tight, settings).update(
            lengths_of(structure, rest.node_position_m, sigma_m=1e-5, noise=noise)
        )
        members = np.concatenate([structure.rods, structure.tendons])
        H = np.zeros((39, 36))
        H[:30] = length_jacobian(rest.node_position_m, members).reshape(30, -1)
        H[30:, :9] = np.eye(9)
        P = tight.covariance_m2 + (1e-12 + (1e-4 * 0.2) ** 2 * 0.02) * np.eye(36)
        tendon = np.full(24, np.hypot(1e-5, NoiseSettings().stretching_m))
        R = np.diag(np.concatenate([np.full(6, NoiseSettings().rod_m), tendon, np.full(9, 1e-6)]) ** 2)
        z = np.concatenate([structure.rod_length_m, structure.tendon_length_m(rest.node_position_m) + noise])
        innovation = np.concatenate([z - member_length_m(rest.node_position_m, members), np.zeros(9)])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        moved = (shape.node_position_m - rest.node_position_m).ravel()
        np.testing.assert_allclose(moved, K @ innovation, atol=2e-8)
        expected = (np.eye(36) - K @ H) @ P + 1e-12 * np.eye(36) + tight.covariance_m2
        np.testing.assert_allclose(shape.covariance_m2, expected, rtol=1e-3, atol=1e-14)

    def test_a_filter_that_breaks_says_so(self, structure, rest, lengths_of) -> None:
        filter_ = UnscentedKalman(structure, rest, Settings())
        filter_._filter.P = -np.eye(36)
        with pytest.raises(IndeterminateError, match=r"t = 1\.500 s: the filter's covariance is no longer positive"):
            filter_.update(lengths_of(structure, rest.node_position_m, 1.5))
