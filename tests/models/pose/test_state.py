"""The state of a pose and its errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from poses import any_state
from tensegraph.models.pose.placed import PlacedShape

STATE = any_state(imus=2, pairs=3, tilts=2, own_frames=2)


@given(arrays(np.float64, STATE.layout.size, elements=st.floats(-1, 1, allow_subnormal=False)))
def test_errors_that_are_added_are_found_again(error) -> None:
    assert STATE.errors_to(STATE.moved(error)) == pytest.approx(error, abs=1e-7)


def test_a_shape_is_placed_by_turn_and_shift() -> None:
    """By hand: x = p + R s."""
    body_m = np.random.default_rng(2).standard_normal((12, 3))
    placed = PlacedShape(STATE, body_m, np.zeros((36, 36)))
    assert placed.node_position_m[7] == pytest.approx(STATE.position_m + STATE.turn @ body_m[7])


def test_the_covariance_of_heights_is_that_of_all_coordinates_along_the_normal() -> None:
    root = 1e-3 * np.random.default_rng(3).standard_normal((36, 36))
    placed = PlacedShape(STATE, np.zeros((12, 3)), root @ root.T)
    normal = np.array([0.0, 0.6, 0.8])
    along = np.kron(np.eye(12), normal)
    of_shape = placed.total_covariance_m2(np.zeros((STATE.layout.size,) * 2))
    assert placed.height_covariance_m2(normal) == pytest.approx(along @ of_shape @ along.T)
    assert placed.covariance_m2[3, 5] == pytest.approx(of_shape[9:12, 15:18])


def test_places_of_all_inertial_sensors_are_those_of_each() -> None:
    at = STATE.layout
    for part in (at.imu_turn, at.rate_bias, at.rate_scale, at.force_bias):
        assert at.of_imus(part)[1].tolist() == list(range(part.stop))[at.of_imu(part, 1)]
    assert at.of_imus(at.misalignment).shape == (2, 2)
    assert any_state(imus=0, pairs=0).layout.of_imus(slice(12, 12)).shape == (0, 0)


def test_the_covariance_of_a_placed_shape_is_that_of_pose_and_shape() -> None:
    """Sampled: the covariance of nodes whose state and shape are drawn from their distributions."""
    rng = np.random.default_rng(3)
    body_m = 0.1 * rng.standard_normal((12, 3))
    root = 1e-3 * rng.standard_normal((36, 36)) / 6
    of_shape = root @ root.T
    sigma = np.full(STATE.layout.size, 1e-3)
    total = PlacedShape(STATE, body_m, of_shape).total_covariance_m2(np.diag(sigma**2))
    drawn = [
        PlacedShape(
            STATE.moved(sigma * rng.standard_normal(len(sigma))),
            body_m + (root @ rng.standard_normal(36)).reshape(12, 3),
            of_shape,
        ).node_position_m.ravel()
        for _ in range(4000)
    ]
    assert np.cov(np.transpose(drawn)) == pytest.approx(total, abs=0.12 * total.max())
