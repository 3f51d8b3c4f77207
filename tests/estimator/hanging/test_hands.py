"""Hands on a structure that hangs: the node and force that were pressed, and the swing that is left."""

import numpy as np
import pytest

from tensegraph.estimator.free_standing.resting_faces import Balance
from tensegraph.estimator.hanging.hands import Hands, Hanging, Swing
from tensegraph.models.estimation import DoubtSettings

ARM_M = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, -0.1], [-0.05, 0.0, -0.1], [0.0, 0.0, -0.2]])
WEIGHT_N = np.full(4, 0.5)
LEVER_M = np.array([0.0, 0.0, -0.1])
UP = np.array([0.0, 0.0, 1.0])
STRAIGHT = Hanging(UP, np.eye(3)[:2], LEVER_M, ARM_M, WEIGHT_N)
FREE = np.array([1, 2, 3])


def balances_of(outer_n: np.ndarray, sigma_n: float) -> list[Balance]:
    """A balance that tells each force to within sigma."""
    information = np.eye(12) / sigma_n**2
    return [Balance(information, -information @ outer_n.ravel(), -0.5 * float(np.sum(outer_n**2)) / sigma_n**2)]


def weights(up: np.ndarray) -> np.ndarray:
    return -WEIGHT_N[:, None] * up


def looked(outer_n: np.ndarray, sigma_n: float, seconds: float = 1.0):
    hands = Hands(FREE, DoubtSettings())
    for _ in range(round(10 * seconds)):
        torque = hands.look(balances_of(outer_n, sigma_n), STRAIGHT, 0.1)
    return torque


def test_a_tilt_by_a_torque_is_that_of_a_pendulum() -> None:
    """By hand: a torque of a hundredth of the weight times 1 m about x tilts a lever of 0.1 m by 0.1 rad about x."""
    assert STRAIGHT.tilt_by_torque @ [0.01, 0.0] == pytest.approx([0.1, 0.0])


def test_a_structure_whose_weight_is_at_the_suspension_is_turned_by_any_torque() -> None:
    """The least lever is 0.2 mm, and the least that restores 0.3 of it."""
    balanced = Hanging(UP, np.eye(3)[:2], np.zeros(3), ARM_M, WEIGHT_N)
    assert np.linalg.svd(balanced.tilt_by_torque, compute_uv=False) == pytest.approx(1 / (0.3 * 0.2e-3))


def test_a_hand_turns_the_weight_too() -> None:
    """The derivative by a force at the lowest node: itself there, and the weight of the tilt that balances it."""
    _, by_force = STRAIGHT.forces_n()
    pushed = by_force[3] @ [0.1, 0.0, 0.0]
    expected = np.outer([0.5, 0.5, 0.5, 0.5], [-0.1, 0.0, 0.0])  # swung to +x by T / (W d) = 0.02 / 0.2 rad
    expected[3, 0] += 0.1
    assert pushed.reshape(4, 3) == pytest.approx(expected)


def test_a_hand_that_forces_show_is_found() -> None:
    _, by_force = STRAIGHT.forces_n()
    force = np.array([0.4, 0.2, 0.0])
    outer = weights(UP) + (by_force[3] @ force).reshape(4, 3)
    torque = looked(outer, 0.02)
    assert torque.lever_m == pytest.approx(np.cross(ARM_M[3], force) / 2.0, abs=0.002)
    assert np.sqrt(np.diag(torque.covariance_m2)).max() < 0.01


def test_without_a_hand_there_is_no_torque_and_what_is_not_seen_is_uncertain() -> None:
    sharp, blind = looked(weights(UP), 0.02), looked(weights(UP), 3.0)
    assert sharp.lever_m == pytest.approx(0, abs=1e-6)
    assert blind.lever_m == pytest.approx(0, abs=1e-6)
    assert np.sqrt(sharp.covariance_m2[0, 0]) < 0.003
    assert np.sqrt(blind.covariance_m2[0, 0]) > 3 * np.sqrt(sharp.covariance_m2[0, 0])


def test_a_swing_dies_out_and_a_slow_push_leaves_none() -> None:
    """A sudden tilt is a swing of this amplitude, and the standard deviation of one is less by the root of two."""
    sudden = Swing(8.0, swing_s=1.0)
    sigma = [sudden.observe(np.array([0.2, 0.0, 0.0]), 0.02) for _ in range(150)]
    assert sigma[0] == pytest.approx(0.2 / np.sqrt(2), rel=0.05)
    assert sigma[-1] == pytest.approx(sigma[0] * np.exp(-149 * 0.02), rel=0.3)
    slow = Swing(8.0, swing_s=1.0)
    sigma = [slow.observe(np.array([0.2 * share, 0.0, 0.0]), 0.02) for share in np.linspace(0, 1, 500)]
    assert max(sigma) < 0.01
