"""Smooth motion, at any steps."""

import numpy as np
import pytest

from graph_values import KEYS, values_of
from tensegraph.factors.motion import constant_velocity_factors, motion_rows


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


@pytest.mark.parametrize("step_s", [0.0, 1e-7])
def test_frames_that_are_closer_are_a_tenth_of_a_millisecond_apart(step_s) -> None:
    """Live and batch: node 3 is 1 mm off in the second frame, so that the second difference is -201 mm."""
    positions = np.zeros((3, 12, 3))
    positions[1, 3, 0] = 0.001
    sigma_m = 0.3 * np.sqrt(0.02) * 0.5 * (1e-4 + 0.02)
    (factor,) = constant_velocity_factors([3], KEYS, (step_s, 0.02), 0.3)
    assert factor.error(values_of(positions)) == pytest.approx(0.5 * (0.201 / sigma_m) ** 2)
    rows = motion_rows(np.array([0.0, step_s, step_s + 0.02]), 0.3, None)
    assert rows[2] == pytest.approx(np.array([200.0, -201.0, 1.0]) / sigma_m)


def test_motion_factors_of_several_nodes_do_not_share_keys() -> None:
    factors = constant_velocity_factors(range(3, 12), KEYS, (0.02, 0.02), 0.3)
    assert [list(f.keys()) for f in factors] == [[n, 12 + n, 24 + n] for n in range(3, 12)]
