"""The error of a shape that is shaken, as inertial sensors feel it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poses import robot_with_two_sensors, samples_of_two
from tensegraph.estimator.free_standing.watches.shake_watch import SHAKEN_S, ShakeWatch, shaken
from tensegraph.models.pose.imu_samples import ImuPreintegration, ImuSamples
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP
from tensegraph.models.values.rotations import rotation_vector


def felt(excess_m_per_s2: float) -> ImuSamples:
    """Return the samples of two sensors in one frame, which feel more than gravity."""
    force = (GRAVITY_M_PER_S2 + excess_m_per_s2) * UP
    return ImuPreintegration(2).mean(0.02, samples_of_two(0.02, force))


def test_a_long_push_counts_for_as_long_as_it_is_remembered() -> None:
    """2 m/s^2 for 0.05 s are 0.1 m/s, and 0.0035 s of them 0.35 mm."""
    watch = ShakeWatch(0.0035)
    for _ in range(50):
        watch.observe(felt(2.0), 0.02)
    assert watch.shaken_m2 == pytest.approx(0.00035**2, rel=1e-6)


@given(excess_m_per_s2=st.floats(-9.0, 100.0), frames=st.integers(1, 20), parts=st.integers(2, 5))
def test_the_rate_of_frames_does_not_count(excess_m_per_s2: float, frames: int, parts: int) -> None:
    coarse, fine = ShakeWatch(0.0035), ShakeWatch(0.0035)
    for _ in range(frames):
        coarse.observe(felt(excess_m_per_s2), 0.02)
    for _ in range(frames * parts):
        fine.observe(felt(excess_m_per_s2), 0.02 / parts)
    assert fine.shaken_m2 == pytest.approx(coarse.shaken_m2, rel=1e-6, abs=1e-15)


def test_it_is_forgotten_at_rest_and_where_no_sensor_is_read() -> None:
    for quiet in (felt(0.0), ImuPreintegration(2).mean(0.02, [])):
        watch = ShakeWatch(0.0035)
        watch.observe(felt(20.0), 0.02)
        after_blow_m2 = watch.shaken_m2
        watch.observe(quiet, SHAKEN_S)
        assert watch.shaken_m2 == pytest.approx(np.exp(-2) * after_blow_m2, rel=1e-6)


def test_without_inertial_sensors_nothing_is_felt() -> None:
    watch = ShakeWatch(0.0035)
    watch.observe(None, 0.02)
    assert watch.shaken_m2 == 0.0
    np.testing.assert_array_equal(shaken(np.eye(36), watch.shaken_m2), np.eye(36))


def test_a_blow_that_deforms_the_shape_does_not_tilt_the_robot(balanced) -> None:
    """Struck with 5 g for 0.06 s, its nodes seem to be out of place by 6 mm: inertial sensors feel that it stays."""
    poses, x = robot_with_two_sensors(balanced), balanced.node_position_m
    seems_m = x + 0.006 * np.random.default_rng(3).standard_normal(x.shape)
    for k in range(1, 60):
        t_s, is_struck = 0.02 * k, 50 <= k < 53
        force = (GRAVITY_M_PER_S2 + 49.0 * is_struck) * UP
        shape_m = seems_m if is_struck else x
        step = poses.step(t_s, shape_m, 0.001**2 * np.eye(x.size), samples_of_two(t_s, force))
        assert abs(rotation_vector(step.state.turn)).max() < 0.003
        assert k < 0 or abs(rotation_vector(step.state.turn)).max() < 9
