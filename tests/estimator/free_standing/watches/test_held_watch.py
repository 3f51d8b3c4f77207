"""A robot that a hand holds or carries in the air."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state, samples_of_two
from tensegraph.estimator.free_standing.watches.held_watch import HeldWatch
from tensegraph.models.pose.imu_samples import ImuPreintegration
from tensegraph.models.structure.floor import UP

SAMPLES = ImuPreintegration(2).mean(0.0, samples_of_two(0.0, 9.81 * UP))


@pytest.mark.parametrize(
    ("along_m_per_s", "steady_s", "is_held"),
    [(0.08, 0.9, False), (0.08, 1.1, True), (0.15, 1.1, False), (0.15, 1.9, False), (0.15, 2.1, True)],
)
def test_a_robot_is_held_where_it_may_be_at_rest_or_is_steady_for_long(along_m_per_s, steady_s, is_held) -> None:
    """The velocity has a standard deviation of 0.05 m/s, so that 0.15 m/s is that of a hand which carries it slowly."""
    watch, state = HeldWatch(), replace(any_state(2, 0), velocity_m_per_s=np.array([along_m_per_s, 0.0, 0.0]))
    covariance = 0.05**2 * np.eye(state.layout.size)
    for _ in range(round(steady_s / 0.02)):
        watch.observe(0.02, state, state, covariance, SAMPLES, UP)
    assert bool(watch.rows(state, 0.02)) == is_held


def test_a_robot_has_come_down_after_a_frame_without_samples_too() -> None:
    watch, state = HeldWatch(), replace(any_state(2, 0), velocity_m_per_s=-0.3 * UP)
    watch.observe(0.02, state, state, 0.05**2 * np.eye(state.layout.size), SAMPLES, UP)
    assert watch.has_come_down
    watch.move()
    assert watch.has_come_down
    watch.lift()
    assert not watch.has_come_down
