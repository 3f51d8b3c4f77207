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
