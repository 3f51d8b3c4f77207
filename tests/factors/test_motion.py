"""Smooth motion, at any steps."""

import numpy as np
import pytest

from graph_values import KEYS, values_of
from tensegraph.factors.motion import constant_velocity_factors


def test_constant_velocity_by_hand() -> None:
    """x = 0, 1, 3 mm at 0, 20, 40 ms: second difference 1 mm, sigma q dt^1.5."""
    positions = np.zeros((3, 12, 3))
    positions[1, 3, 0], positions[2, 3, 0] = 0.001, 0.003
    (factor,) = constant_velocity_factors([3], KEYS, (0.02, 0.02), 0.3)
    assert factor.error(values_of(positions)) == pytest.approx(0.5 * (0.001 / (0.3 * 0.02**1.5)) ** 2)


@pytest.mark.parametrize("steps", [(0.02, 0.02), (0.01, 0.05), (0.1, 0.02)])
def test_constant_velocity_costs_nothing_at_any_steps(steps) -> None:
    t = np.array([0.0, steps[0], sum(steps)])
    positions = t[:, None, None] * np.random.default_rng(0).standard_normal((12, 3))
    for factor in constant_velocity_factors(range(12), KEYS, steps, 0.3):
        assert factor.error(values_of(positions)) == pytest.approx(0, abs=1e-12)


def test_stamps_a_tenth_of_a_microsecond_apart_are_a_microsecond_apart() -> None:
    (factor,) = constant_velocity_factors([3], KEYS, (1e-7, 0.02), 0.3)
    assert np.isfinite(factor.error(values_of(np.zeros((3, 12, 3)))))


def test_motion_factors_of_several_nodes_do_not_share_keys() -> None:
    factors = constant_velocity_factors(range(3, 12), KEYS, (0.02, 0.02), 0.3)
    assert [list(f.keys()) for f in factors] == [[n, 12 + n, 24 + n] for n in range(3, 12)]
