"""The covariance of nodes under a turn that may be large, against samples and against the linear one."""

import numpy as np
import pytest

from poses import any_state
from tensegraph.models.pose.large_turn import heading_pivot_m, turned_covariance_m2
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.structure.floor import UP
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


def test_who_may_head_anywhere_may_have_gone_the_other_way() -> None:
    """By hand: of the way D, E (1 - cos)^2 D^2 = 3/2 D^2 along it and 1/2 D^2 across. The linear variance is 0 along.

    Where it began is uncertain by a tenth of a metre besides.
    """
    way_m, any_rad2 = np.array([1.0, 0.0, 0.0]), 30.0**2
    by_heading = np.concatenate([UP, np.cross(UP, way_m)])
    covariance = np.zeros((SIZE, SIZE))
    covariance[:6, :6] = any_rad2 * np.outer(by_heading, by_heading)
    covariance[3:6, 3:6] += 0.1**2 * np.eye(3)
    pivot_m = heading_pivot_m(STATE, covariance, UP)
    assert pivot_m == pytest.approx(STATE.position_m - way_m, abs=1e-9)
    centre = PlacedShape(STATE, np.zeros((1, 3)), np.zeros((3, 3)))
    total = turned_covariance_m2(centre, covariance, pivot_m)
    assert total == pytest.approx(np.diag([1.51, 0.51, 0.01]), abs=1e-6)
