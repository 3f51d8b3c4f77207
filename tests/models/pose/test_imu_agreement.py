"""Whether an inertial sensor agrees with gravity and with itself."""

import numpy as np
import pytest

from tensegraph.models.pose.imu_agreement import ImuAgreement, has_size_of_gravity
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP
from tensegraph.models.values.rotations import rotation

STEP_S = 0.02
BIAS = np.array([0.3, -0.2, 0.1])
TIP_RAD = np.array([0.5, 0.9, 0.2])


def told(change, tip_rad=TIP_RAD, acceleration=lambda k: np.zeros(3), frames=150) -> ImuAgreement:
    """Return the agreement of a sensor that rests for a second, is turned within half a second, and rests again.

    Args:
        change: of the true rates and forces, as they are told.
        tip_rad: (3,) the turn, in world axes.
        acceleration: (3,) in the world, in each frame.
        frames: how many.
    """
    agreement = ImuAgreement(1, 1.0, PoseSettings())
    mounted = rotation(np.array([0.4, -0.3, 1.0]))
    rng = np.random.default_rng(1)
    for k in range(frames):
        turn = rotation(np.clip((k - 50) / 25, 0, 1) * tip_rad) @ mounted
        turns = 50 < k <= 75
        rate = BIAS + turn.T @ tip_rad * turns / 0.5 + 1e-3 * rng.standard_normal(3)
        force = turn.T @ (acceleration(k) + GRAVITY_M_PER_S2 * UP) + 0.03 * rng.standard_normal(3)
        rate, force = change(rate, force)
        agreement.observe(k * STEP_S, rate[None], force[None], np.ones(1, dtype=np.bool_))
    return agreement


def test_a_sensor_that_tells_the_truth_agrees() -> None:
    agreement = told(lambda rate, force: (rate, force), frames=250)
    assert agreement.has_size.all()
    assert agreement.moves_as_told.all()
    assert agreement.is_proven.all()


def test_rates_in_degrees_contradict_at_rest() -> None:
    """The bias is 0.37 rad/s; 21 of them, as it is in degrees, are none."""
    assert told(lambda rate, force: (rate, force), frames=50).moves_as_told.all()
    assert not told(lambda rate, force: (np.rad2deg(rate), force), frames=12).moves_as_told.any()


@pytest.mark.parametrize(("sign", "share"), [(1, 0.4), (-1, 1.0)])
def test_a_small_turn_and_a_wrong_one_prove_nothing(sign, share) -> None:
    assert not told(lambda rate, force: (sign * rate, force), share * TIP_RAD, frames=250).is_proven.any()


WRONG_TURNS = {
    "sign": lambda rate, force: (-rate, force),
    "half": lambda rate, force: (rate / 2, force),
    "double": lambda rate, force: (2 * rate, force),
    "degrees": lambda rate, force: (np.rad2deg(rate), force),
    "mirrored": lambda rate, force: (rate * [-1, 1, 1], force),
    "axes": lambda rate, force: (rate[[2, 1, 0]], force),
    "force mirrored": lambda rate, force: (rate, force * [1, -1, 1]),
}


@pytest.mark.parametrize("change", WRONG_TURNS.values(), ids=WRONG_TURNS)
def test_rates_that_do_not_turn_gravity_as_the_force_does_contradict(change) -> None:
    agreement = told(change)
    assert agreement.has_size.all()
    assert not agreement.moves_as_told.any()


@pytest.mark.parametrize("scale", [1 / GRAVITY_M_PER_S2, 0.5, 2.0])
def test_a_force_that_is_not_of_the_size_of_gravity_contradicts(scale) -> None:
    assert not told(lambda rate, force: (rate, scale * force)).has_size.any()


def test_the_limit_is_a_tenth_of_gravity() -> None:
    """By hand: 9.81 m/s^2 within 0.98; 80 mg of offset and 1 % of scale are within."""
    assert has_size_of_gravity(np.array([8.7, 8.9, 10.7, 10.9, np.nan])).tolist() == [False, True, True, False, False]


def test_a_turn_about_the_vertical_tells_nothing_of_the_rates() -> None:
    """Gravity stays where it is, so that wrong rates are not seen: a limit."""
    assert told(WRONG_TURNS["half"], np.array([0, 0, 1.0])).moves_as_told.all()


@pytest.mark.parametrize(("jump_rad_per_s", "agrees"), [(0.1, False), (0.02, True)])
def test_a_bias_that_changes_at_rest_is_told_within_three_seconds(jump_rad_per_s: float, agrees: bool) -> None:
    """By hand: after 2 s gravity would have turned by 0.2 rad, and sigma is 0.03 rad; a drift of 2 b_w is none."""
    agreement = ImuAgreement(1, 1.0, PoseSettings())
    rng = np.random.default_rng(1)
    for k in range(200):
        rate = BIAS + jump_rad_per_s * np.array([1.0, 0.0, 0.0]) * (k > 50) + 1e-3 * rng.standard_normal(3)
        force = GRAVITY_M_PER_S2 * UP + 0.03 * rng.standard_normal(3)
        agreement.observe(k * STEP_S, rate[None], force[None], np.ones(1, dtype=np.bool_))
    assert agreement.moves_as_told.all() == agrees


def test_a_fall_and_its_shock_contradict_nothing() -> None:
    """It falls for 0.4 s, from 0.8 m, and stops within two frames: the size of the force explains the velocity."""

    def acceleration(k: int) -> np.ndarray:
        falls = -GRAVITY_M_PER_S2 * UP
        return falls if 80 <= k < 100 else -10 * falls if 100 <= k < 102 else 0 * falls

    assert told(lambda rate, force: (rate, force), acceleration=acceleration).moves_as_told.all()


def test_what_a_sensor_says_after_a_silence_is_not_compared_with_what_it_said_before() -> None:
    """It was turned by a third of a turn meanwhile."""
    for forgets in (True, False):
        agreement = ImuAgreement(1, 0.5, PoseSettings())
        for k in range(100):
            force = np.array([0, 0, GRAVITY_M_PER_S2] if k < 40 else [0, GRAVITY_M_PER_S2, 0])
            if 40 <= k < 55:
                agreement.forget(np.array([forgets]))
            agreement.observe(k * STEP_S, np.zeros((1, 3)), force[None], np.array([not 40 <= k < 55]))
        assert agreement.moves_as_told.all() == forgets
