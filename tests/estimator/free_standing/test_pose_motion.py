"""How a pose changes over a frame."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.pose_motion import PoseMotion, force_sigma_m_per_s2
from tensegraph.factors.imu import ImuArray
from tensegraph.models.pose.imu_samples import ImuSamples
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP
from tensegraph.models.values.aids import Imu
from tensegraph.models.values.rotations import rotation

RODS = np.array([[0, 3], [4, 5], [1, 6], [7, 8], [2, 9], [10, 11]])
IMUS = ImuArray([Imu(0, 0.5, np.array([0.0, 0, 1])), Imu(3, 0.2, np.array([0.6, 0, 0.8]))], RODS)
BODY_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))
STEP_S = 0.02


def samples_of(state, rate_rad_per_s: np.ndarray) -> ImuSamples:
    """Return the samples of sensors that turn at a rate, given in the world, and are accelerated a little."""
    in_sensor = np.einsum("iba,b->ia", state.imu_turn, rate_rad_per_s) / (1 + state.rate_scale)
    in_sensor = in_sensor + state.rate_bias_rad_per_s
    force = np.einsum("iba,b->ia", state.imu_turn, 9.81 * UP + np.array([0.3, -0.2, 0.1]))
    none = np.zeros(2, dtype=np.bool_)
    return ImuSamples(
        in_sensor,
        force + state.force_bias_m_per_s2,
        np.array([2, 2]),
        none,
        np.full(2, STEP_S),
        rate_is_cut_off=none,
        force_is_cut_off=none,
    )


def with_missing(samples: ImuSamples, *missing: int) -> ImuSamples:
    """Return samples without those of some sensors."""
    are_missing = np.isin(np.arange(2), missing)
    return replace(samples, count=np.where(are_missing, 0, samples.count), are_missing=are_missing)


@pytest.mark.parametrize("missing", [None, (), (1,), (0, 1)])
def test_the_transition_is_the_derivative_of_the_motion(missing, check_jacobian) -> None:
    """To first order in the time step: the rows leave out that the weights of the sensors turn with their rods.

    Without sensors, and with two, of which some have no samples.
    """
    state = any_state(imus=2, pairs=1)
    samples = None if missing is None else with_missing(samples_of(state, state.rate_rad_per_s), *missing)
    motion = PoseMotion(IMUS, PoseSettings())
    after = motion.after(state, STEP_S, samples, (BODY_M, BODY_M))

    def errors_after(d):
        return after.state.errors_to(motion.after(state.moved(d), STEP_S, samples, (BODY_M, BODY_M)).state)

    check_jacobian(errors_after, after.transition, np.zeros(state.layout.size), tolerance=0.1)


def test_a_body_without_sensors_turns_on_and_slows_down() -> None:
    """By hand: 1 rad/s about z for 20 ms."""
    state = any_state(imus=0, pairs=0)
    state = replace(state, rate_rad_per_s=np.array([0, 0, 1.0]))
    motion = PoseMotion(ImuArray([], RODS), PoseSettings(motion_holds_s=0.1))
    after = motion.after(state, STEP_S, None, (BODY_M, BODY_M)).state
    assert after.turn == pytest.approx(rotation(np.array([0, 0, 0.02])) @ state.turn)
    assert after.rate_rad_per_s == pytest.approx([0, 0, np.exp(-0.2)])
    assert after.position_m == pytest.approx(state.position_m + STEP_S * state.velocity_m_per_s)


def test_two_sensors_turn_the_body_as_they_turn() -> None:
    """Both sensors turn with the body at 2 rad/s about an axis of the world: so does the body, to within 2 %."""
    rate = np.array([0.8, -1.2, 1.4])
    state = any_state(imus=2, pairs=0)
    samples = samples_of(state, rate)
    after = PoseMotion(IMUS, PoseSettings(spin_rad_per_s=0.1)).after(state, STEP_S, samples, (BODY_M, BODY_M)).state
    assert after.turn == pytest.approx(rotation(rate * STEP_S) @ state.turn, abs=0.02 * 2 * STEP_S)
    assert after.rate_rad_per_s == pytest.approx(rate, abs=0.05)


def test_sensors_that_were_read_through_a_gap_turn_the_body_for_all_of_it() -> None:
    """Three seconds at 0.5 rad/s, of which the pose is known for one: the body has turned by 1.5 rad about the axis."""
    rate = np.array([0.3, 0.0, 0.4])
    state = any_state(imus=2, pairs=0)
    samples = replace(samples_of(state, rate), lasted_s=np.full(2, 3.0))
    motion = PoseMotion(IMUS, PoseSettings(turn_rad_per_s=5.0, spin_rad_per_s=7.0))
    after = motion.after(state, 1.0, samples, (BODY_M, BODY_M)).state
    assert after.turn == pytest.approx(rotation(rate * 3.0) @ state.turn, abs=0.02)
    assert after.imu_turn == pytest.approx(rotation(rate * 3.0) @ state.imu_turn, abs=1e-9)
    assert after.rate_rad_per_s == pytest.approx(rate, abs=0.01)


def test_a_sensor_whose_samples_are_missing_turns_with_the_body() -> None:
    """Its rate, of the sample before, says that it turns at 4 rad/s more than the body, which the other one tells.

    Against the body it has turned by 0.1 rad/s as the rod deforms and 0.2 as it spins, for 20 ms.
    """
    state = any_state(imus=2, pairs=0)
    samples = with_missing(samples_of(state, np.array([0.8, -1.2, 1.4])), 1)
    samples.rate_rad_per_s[1] += 4.0
    motion = PoseMotion(IMUS, PoseSettings()).after(state, STEP_S, samples, (BODY_M, BODY_M))
    turned = motion.state.turn @ state.turn.T
    assert motion.state.imu_turn[1] == pytest.approx(turned @ state.imu_turn[1])
    at, G = state.layout, np.zeros((3, state.layout.size))
    G[:, at.of_imu(at.imu_turn, 1)], G[:, at.turn] = np.eye(3), -np.eye(3)
    assert G @ motion.noise @ G.T == pytest.approx((0.1**2 + 0.2**2) * STEP_S**2 * np.eye(3))


@pytest.mark.parametrize("misalignment_rad", [0.0, 0.02, 0.1, 0.2, 0.3, 3.0])
def test_the_noise_is_a_covariance(misalignment_rad) -> None:
    """However far absurd readings have turned the sensors on their rods, and where little else is known of a turn."""
    state = replace(any_state(imus=1, pairs=0), misalignment=np.full((1, 2), misalignment_rad))
    one = ImuArray([Imu(0, 0.5, np.array([0.0, 0, 1]))], RODS)
    none = np.array([False])
    samples = ImuSamples(
        np.array([[-6.0, 0, 0]]),
        np.array([[0, 0, 9.81]]),
        np.array([2]),
        none,
        np.full(1, STEP_S),
        rate_is_cut_off=none,
        force_is_cut_off=none,
    )
    motion = PoseMotion(one, PoseSettings(turn_rad_per_s=5.0, spin_rad_per_s=7.0))
    noise = motion.after(state, STEP_S, samples, (BODY_M, BODY_M)).noise
    assert noise == pytest.approx(noise.T)
    assert np.linalg.eigvalsh(noise).min() > -1e-12


def test_a_shock_is_hardly_measured() -> None:
    """By hand, two sensors 10 and 30 m/s^2 off gravity: 0.1 / sqrt(2) + 0.1 x 20, and half of 10 in one of two.

    Of one whose range ends there, all of 30 in one of two.
    """
    settings, both = PoseSettings(), np.array([0, 1])
    in_motion = 0.1 / np.sqrt(2) + 0.1 * 20
    none = np.zeros(2, dtype=np.bool_)
    force = np.array([[0, 0, GRAVITY_M_PER_S2 + 10], [0, 0, GRAVITY_M_PER_S2 + 30]])
    samples = ImuSamples(np.zeros((2, 3)), force, np.array([2, 2]), none, np.full(2, STEP_S), none, none)
    assert force_sigma_m_per_s2(samples, both, settings) == pytest.approx(in_motion + 0.5 * 10 / 2)
    samples = replace(samples, force_is_cut_off=np.array([False, True]))
    assert force_sigma_m_per_s2(samples, both, settings) == pytest.approx(in_motion + 30 / 2)
