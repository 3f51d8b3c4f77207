"""The covariance of nodes under a turn that may be large, against samples and against the linear one."""

import numpy as np
import pytest

from poses import any_state
from tensegraph.models.pose.large_turn import turned_covariance_m2
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.structure.shape import node_blocks
from tensegraph.models.values.rotations import rotation

STATE = any_state(imus=0, pairs=0)
BODY_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))
PLACED = PlacedShape(STATE, BODY_M, 1e-6 * np.eye(36))
PIVOT_M = PLACED.node_position_m[0]
SIZE = STATE.layout.size


def turned_about_the_pivot(covariance_rad2: np.ndarray) -> np.ndarray:
    """The covariance of the errors of a pose that is turned about the pivot."""
    arm = PIVOT_M - STATE.position_m
    by_turn = np.vstack([np.eye(3), [[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]]])
    covariance = np.zeros((SIZE, SIZE))
    covariance[:6, :6] = by_turn @ covariance_rad2 @ by_turn.T
    return covariance


def test_a_small_turn_is_the_linear_one() -> None:
    covariance = turned_about_the_pivot(np.diag([1e-4, 2e-4, 3e-4]))
    turned = turned_covariance_m2(PLACED, covariance, PIVOT_M)
    assert turned == pytest.approx(PLACED.total_covariance_m2(covariance), abs=2e-8)
    assert node_blocks(turned)[0] == pytest.approx(1e-6 * np.eye(3), abs=1e-10)


@pytest.mark.parametrize("sigma_rad", [0.3, 1.0, 30.0])
def test_a_heading_that_is_lost_has_the_moments_of_samples(sigma_rad: float) -> None:
    """Of an angle about the vertical alone; 30 rad is any angle."""
    covariance = turned_about_the_pivot(np.diag([1e-12, 1e-12, sigma_rad**2]))
    turned = node_blocks(turned_covariance_m2(PLACED, covariance, PIVOT_M))
    angle = sigma_rad * np.random.default_rng(1).standard_normal(200_000)
    turns = rotation(angle[:, None] * np.array([0, 0, 1.0]))
    for node in (3, 7):
        arm = PLACED.node_position_m[node] - PIVOT_M
        away = turns @ arm - arm
        assert turned[node] == pytest.approx(away.T @ away / len(away) + 1e-6 * np.eye(3), abs=2e-3)
