"""A robot that is lifted."""

from dataclasses import replace

import numpy as np
import pytest

from poses import robot_with_two_sensors, samples_of_two
from tensegraph.estimator.free_standing.contacts import Standing
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.structure.floor import UP

SHAPE_M2 = 1e-6 * np.eye(36)


def lifted(
    balanced, lift_m_per_s2: float, until_s: float, down_s: float = 2.2, error_m_per_s2: float = 0.0
) -> tuple[PoseFilter, list]:
    """Return the filter of a robot that is lifted within 0.8 s from 1 s on, and put down from `down_s` on, and steps.

    In the air, from 1.4 s until it is down, the sensors have an error.
    """
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    steps = []
    for t_s in np.arange(0.0, until_s, 0.02):
        up = [(1.0, 1.0), (1.4, -1.0), (down_s, -1.0), (down_s + 0.4, 1.0)]
        sign = next((sign for from_s, sign in up if from_s <= t_s < from_s + 0.4), 0.0)
        error = error_m_per_s2 * (1.4 < t_s < down_s + 0.8)
        force = (9.81 + sign * lift_m_per_s2 + error) * UP
        steps.append(poses.step(float(t_s), x, SHAPE_M2, samples_of_two(float(t_s), force)))
    return poses, steps


def test_a_robot_that_is_lifted_is_followed_in_the_air(balanced) -> None:
    """At 0.8 m/s^2 up for 0.4 s, and as much down: 128 mm, within the ellipsoid, while the floor carries nothing."""
    poses, steps = lifted(balanced, 0.8, 2.1)
    rise_m, sigma_m = poses.state.position_m[2] - poses.centre_m[2], float(np.sqrt(poses.covariance[5, 5]))
    assert abs(rise_m - 0.128) < 3 * sigma_m < 0.11
    assert not steps[-1].standing.nodes.any()
    assert steps[-1].standing.contradicted
    assert steps[-1].lifted_since_s == pytest.approx(1.0, abs=0.5), "the last watch that began before it"
    assert len({step.lifted_since_s for step in steps}) == 2, "inf before, and one lift"


def test_a_robot_that_is_put_down_stands_again_and_is_doubted_for_a_while(balanced) -> None:
    poses, steps = lifted(balanced, 0.8, 5.6)
    assert np.flatnonzero(steps[-1].standing.nodes).tolist() == [0, 1, 2]
    assert poses.state.position_m[2] == pytest.approx(poses.centre_m[2], abs=0.005)
    assert poses.covariance[3, 3] > 0.005**2, "where it was put down is not known well"
    assert not steps[-1].standing.contradicted
    assert next(step for step in steps if step.standing.contradicted).standing.nodes.sum() == 0


def test_a_robot_that_is_told_to_stand_is_lifted_no_more(balanced) -> None:
    """Its sensors are silent meanwhile; the faces tell that it stands."""
    poses, steps = lifted(balanced, 0.8, 2.0)
    assert np.isfinite(steps[-1].lifted_since_s)
    stands = np.isin(np.arange(12), [0, 1, 2])
    step = poses.step(2.02, balanced.node_position_m, SHAPE_M2, (), Standing(stands, stands.astype(np.float64)))
    assert np.isinf(step.lifted_since_s)


def test_a_slow_lift_is_felt_by_the_velocity_that_sensors_tell(balanced) -> None:
    """At 0.3 m/s^2, by 48 mm in all. The filter, which the floor holds, follows a part of that velocity."""
    poses, steps = lifted(balanced, 0.3, 2.1)
    rise_m, sigma_m = poses.state.position_m[2] - poses.centre_m[2], float(np.sqrt(poses.covariance[5, 5]))
    assert np.isfinite(steps[70].lifted_since_s)
    assert abs(rise_m - 0.048) < 3 * sigma_m < 0.11


def test_a_robot_that_trembles_on_the_floor_is_not_lifted(balanced) -> None:
    _, steps = lifted(balanced, 0.05, 2.0)
    assert all(np.isinf(step.lifted_since_s) and step.standing.nodes.any() for step in steps)
    assert not any(step.standing.contradicted for step in steps)


@pytest.mark.parametrize("from_s", [1.0, 1.3, 1.6, 1.9])
@pytest.mark.parametrize("lift_m_per_s2", [1.0, 4.0])
def test_a_robot_that_rises_steadily_is_lifted_whenever_that_begins(balanced, from_s, lift_m_per_s2) -> None:
    """It is accelerated for 0.6 s by less than a shock, and feels what a robot at rest feels from then on."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    for t_s in np.arange(0.0, from_s + 1.2, 0.02):
        sign = float(from_s <= t_s < from_s + 0.6)
        poses.step(float(t_s), x, SHAPE_M2, samples_of_two(float(t_s), (9.81 + sign * lift_m_per_s2) * UP))
    rise_m = poses.state.position_m[2] - poses.centre_m[2]
    assert not poses.standing.nodes.any()
    assert rise_m == pytest.approx(0.54 * lift_m_per_s2, rel=0.1)


def test_a_robot_whose_height_is_too_low_is_not_stopped_in_the_air(balanced) -> None:
    """Sensors that are wrong by 0.04 m/s^2 bring it to the floor too early; there it stands, and rises no more."""
    poses, steps = lifted(balanced, 0.8, 5.0, error_m_per_s2=-0.04)
    landed = next(step for step in steps[120:] if step.standing.nodes.any())
    assert steps.index(landed) * 0.02 > 2.85
    assert poses.state.position_m[2] == pytest.approx(poses.centre_m[2], abs=0.005)
    assert np.abs(poses.state.velocity_m_per_s[2]) < 0.05
    assert poses.standing.nodes.any()


def test_a_robot_that_is_held_still_in_the_air_has_no_velocity(balanced) -> None:
    """Its sensors, which are wrong by 0.03 m/s^2, would move it by 0.4 m in five seconds."""
    poses, steps = lifted(balanced, 0.8, 7.0, down_s=10.0, error_m_per_s2=0.03)
    rise_m, sigma_m = poses.state.position_m[2] - poses.centre_m[2], float(np.sqrt(poses.covariance[5, 5]))
    assert abs(rise_m - 0.128) < 3 * sigma_m < 0.3
    assert not any(step.standing.nodes.any() for step in steps[120:])


@pytest.mark.parametrize("lift_m_per_s2", [0.5, 0.7])
def test_a_robot_that_has_not_come_down_does_not_stand(balanced, lift_m_per_s2) -> None:
    """It is lifted by 80 or 112 mm, and held for a second, in which the standard deviation of its height grows."""
    _, steps = lifted(balanced, lift_m_per_s2, 2.8, down_s=10.0)
    air = [step for step in steps if not step.standing.nodes.any()]
    assert air
    assert air == steps[-len(air) :]


@pytest.mark.parametrize(("rests_s", "follows"), [(0.2, False), (0.5, True)])
def test_a_robot_that_has_rested_for_a_moment_may_be_lifted_fast(balanced, rests_s, follows) -> None:
    """It is accelerated by 6 m/s^2 for 0.16 s after a moment of rest behind a shock, that of feet on the floor."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    for t_s in np.arange(0.0, 1.3 + rests_s, 0.02):
        shock, lift = 0.98 <= t_s < 1.02, 1.02 + rests_s <= t_s < 1.18 + rests_s
        poses.step(float(t_s), x, SHAPE_M2, samples_of_two(float(t_s), (9.81 + 30.0 * shock + 6.0 * lift) * UP))
    assert poses.standing.nodes.any() != follows


@pytest.mark.parametrize(("calm_s", "follows"), [(0.06, True), (0.0, False)])
def test_a_robot_that_rises_already_is_followed_through_a_shock(balanced, calm_s, follows) -> None:
    """A hand accelerates it by 4 m/s^2 for 0.06 s, then by 22 and more; what begins with that is a blow."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    rise_m = m_per_s = 0.0
    for t_s in np.arange(0.0, 1.2, 0.02):
        calm, shock = 1.0 <= t_s < 1.0 + calm_s, 1.0 + calm_s <= t_s < 1.06 + calm_s
        lift_m_per_s2 = 4.0 * calm + (22.0 + 20.0 * (t_s - 1.0)) * shock
        rise_m, m_per_s = rise_m + 0.02 * m_per_s + 0.0002 * lift_m_per_s2, m_per_s + 0.02 * lift_m_per_s2
        samples = samples_of_two(float(t_s), (9.81 + lift_m_per_s2) * UP)
        last = [replace(one, specific_force_m_per_s2=1.001 * one.specific_force_m_per_s2) for one in samples[2:]]
        poses.step(float(t_s), x, SHAPE_M2, [*samples[:2], *last])  # equal ones would be at the end of the range
    assert poses.standing.nodes.any() != follows
    if follows:
        sigma_m = float(np.sqrt(poses.covariance[5, 5]))
        assert abs(poses.state.position_m[2] - poses.centre_m[2] - rise_m) < 3 * sigma_m < 0.2


@pytest.mark.parametrize("lost", [0, 1])
def test_a_lift_is_followed_through_a_frame_in_which_a_sensor_was_not_read(balanced, lost) -> None:
    """It is accelerated by 2 m/s^2 for 0.3 s; the samples of one of two sensors are missing in the third frame."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    for k in range(66):
        t_s = 0.02 * k
        samples = samples_of_two(t_s, (9.81 + 2.0 * (k >= 50)) * UP)
        due = [replace(reading, due_s=t_s + 0.01) for reading in samples]
        poses.step(t_s, x, SHAPE_M2, [reading for reading in due if k != 53 or reading.imu != lost])
    assert not poses.standing.nodes.any()
    assert poses.state.position_m[2] - poses.centre_m[2] == pytest.approx(0.102, abs=0.01)


@pytest.mark.parametrize(("flies", "is_above"), [(True, False), (False, True), (False, False)])
def test_a_rise_of_a_robot_that_nothing_carries_needs_no_height(balanced, flies, is_above) -> None:
    """At 1 m/s^2 for 0.12 s it has risen by 7 mm while the floor held it, and by 0.12 m/s."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    for t_s in np.arange(0.0, 1.09, 0.02):
        sign = float(t_s >= 1.0)
        poses.step(float(t_s), x, SHAPE_M2, samples_of_two(float(t_s), (9.81 + sign) * UP))
    assert poses.standing.nodes.any()
    held = replace(poses.state, position_m=poses.centre_m, velocity_m_per_s=np.zeros(3))
    placed, samples = PlacedShape(held, x - poses.centre_m, SHAPE_M2), poses._samples
    rise = poses._rise_watch.observe(1.1, 0.02, placed, poses.covariance, samples, flies=flies, is_above=is_above)
    assert (rise is not None) == (flies or is_above)
    if rise is not None:
        np.testing.assert_allclose(rise.way, [0.007, 0.12], atol=0.004)


@pytest.mark.parametrize(("sigma_m_per_s", "rises"), [(0.005, True), (0.1, False)])
def test_a_robot_that_may_have_come_down_just_now_does_not_rise_where_it_stops(balanced, sigma_m_per_s, rises) -> None:
    """A force that stops it looks like a rise by 0.12 m/s, which is less than five sigmas of its velocity before."""
    x, poses = balanced.node_position_m, robot_with_two_sensors(balanced)
    for t_s in np.arange(0.0, 1.0, 0.02):
        poses.step(float(t_s), x, SHAPE_M2, samples_of_two(float(t_s), 9.81 * UP))
    held = replace(poses.state, position_m=poses.centre_m, velocity_m_per_s=np.zeros(3))
    placed, covariance = PlacedShape(held, x - poses.centre_m, SHAPE_M2), poses.covariance.copy()
    velocity = held.layout.velocity
    covariance[velocity, velocity] = sigma_m_per_s**2 * np.eye(3)
    watch = poses._rise_watch
    watch.forget()
    found = []
    for k in range(8):
        samples = replace(poses._samples, specific_force_m_per_s2=np.tile((9.81 + (k > 0)) * UP, (2, 1)))
        found.append(watch.observe(1.0 + 0.02 * k, 0.02, placed, covariance, samples, flies=True, is_above=False))
    assert any(rise is not None for rise in found) == rises
