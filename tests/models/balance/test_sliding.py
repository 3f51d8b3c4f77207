"""Which nodes slide when a structure that stands deforms: those of least friction."""

import numpy as np
import pytest

from tensegraph.models.balance.sliding import least_friction_slides_m
from tensegraph.models.values.rotations import rotation

CORNER_M = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.3]])


def test_the_node_that_carries_least_slides_alone() -> None:
    """Two nodes of 0.3 m move apart by 10 mm: the one with 0.1 of the weight slides by all of it."""
    after_m = np.array([[0, 0], [0.3, 0], [0, 0.31]])
    slide_m = least_friction_slides_m(CORNER_M, after_m, np.array([0.5, 0.4, 0.1]))
    assert slide_m == pytest.approx([0, 0, 0.01], abs=2e-5)


def test_a_rigid_motion_is_no_sliding() -> None:
    """The places of the feet in the body turn and shift with the axes that describe it."""
    turn = rotation(np.array([0, 0, 0.4]))[:2, :2]
    slide_m = least_friction_slides_m(CORNER_M, CORNER_M @ turn.T + [0.1, -0.2], np.full(3, 1 / 3))
    assert slide_m == pytest.approx(np.zeros(3), abs=1e-9)


def test_one_node_does_not_slide() -> None:
    assert least_friction_slides_m(CORNER_M[:1], CORNER_M[:1] + 0.02, np.ones(1)) == pytest.approx([0])


@pytest.mark.parametrize("seed", range(5))
def test_no_other_motion_has_less_friction(seed: int) -> None:
    """Of turns by up to 0.05 rad and shifts by up to 10 mm, none costs less than the solution."""
    rng = np.random.default_rng(seed)
    after_m = CORNER_M + 0.005 * rng.standard_normal((3, 2))
    share = rng.dirichlet([2, 2, 2])
    least = share @ least_friction_slides_m(CORNER_M, after_m, share)
    angle = rng.uniform(-0.05, 0.05, 20000)
    turn = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    shift_m = rng.uniform(-0.01, 0.01, (20000, 1, 2))
    cost = np.linalg.norm(after_m @ np.swapaxes(turn, 1, 2) + shift_m - CORNER_M, axis=2) @ share
    assert 0 < least <= cost.min() + 1e-6
    assert cost.min() < 1.5 * least
