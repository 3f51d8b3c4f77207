"""Strips that remember more than those of the calibration: each press is followed by a pull that no hand makes."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from one_hand import NODE, STEP_S, Hand
from pipelines import pipeline_of
from plan_edits import CAUSES, PLANS, SHORT, replaced
from tensegraph import Status, simulate
from tensegraph.estimator.watches.rebound_watch import DEFORMATION_MEMORY_S, ReboundWatch
from tensegraph.models.structure.shape import Reason

FINGER_N = 1.5
LONGER = (("duration_s = 6.0", "duration_s = 13.0"), ("until_s = 6.0", "until_s = 13.0"))


@pytest.fixture
def hand(balanced, lengths_of) -> Hand:
    return Hand(ReboundWatch(balanced, FINGER_N), balanced, lengths_of)


def test_the_second_press_with_a_rebound_raises_the_doubt(hand) -> None:
    """The ratio is 1 N over 2 N; the shape is not moved."""
    assert hand.press(rebound_n=1.0).doubt is None
    shape = hand.press(rebound_n=1.0)
    assert (shape.status, shape.doubt) == (Status.DOUBT, Reason.MEMORY)
    assert hand.watch.ratio == pytest.approx(0.5)
    np.testing.assert_array_equal(shape.node_position_m, hand.rest.node_position_m)


def test_the_doubt_stays_until_it_is_less_probable_than_at_the_start(hand) -> None:
    """A pull of a hand, as strong as the press, does not end it."""
    found = [hand.press(rebound_n).doubt is Reason.MEMORY for rebound_n in (1.0, 1.0, 2.2, *[0.2] * 9)]
    assert found[:5] == [False, True, True, True, True]
    assert not any(found[-4:])


def test_presses_whose_end_is_not_seen_tell_nothing(hand) -> None:
    """Without readings, or in a gap of time; afterwards all is as it was."""
    for unseen in (True, False) * 4:
        hand.load(-2.0, 1.0)
        if unseen:
            hand.lengths = replace(hand.lengths, sigma_m=np.full_like(hand.lengths.sigma_m, np.inf))
            hand.load(0.0, 2.0)
            hand.lengths = replace(hand.lengths, sigma_m=np.full_like(hand.lengths.sigma_m, 5e-4))
        else:
            hand.t_s += 2.0
    hand.press(rebound_n=1.0)
    assert hand.press(rebound_n=1.0).doubt is Reason.MEMORY


def test_any_other_reason_is_told_in_place_of_it(hand) -> None:
    for _ in range(2):
        shape = hand.press(rebound_n=1.0)
    assert shape.in_doubt(Reason.IMU).doubt is Reason.IMU
    assert shape.in_doubt(Reason.IMU).in_doubt(Reason.MEMORY).doubt is Reason.IMU


def test_the_ellipsoid_grows_by_the_deformation_that_is_remembered(hand) -> None:
    """After one time constant at u = 10 mm: m = (1 - 1/e) u, so that rho^2 (m^2 + (u - m)^2) = (3.66 mm)^2 along z."""
    for _ in range(2):
        hand.press(rebound_n=1.0)
    assert DEFORMATION_MEMORY_S == 1.0
    shape = hand.load(0.0, 1.0, moved_m=0.010)
    added_m2 = shape.node_covariance_m2[NODE] - 1e-6 * np.eye(3)
    assert np.sqrt(added_m2[2, 2]) == pytest.approx(3.66e-3, rel=1e-3)
    assert np.abs(np.delete(added_m2.ravel(), 8)).max() < 1e-12
    still = hand.load(0.0, 10.0)
    np.testing.assert_allclose(still.node_covariance_m2[NODE], 1e-6 * np.eye(3), atol=1e-12)


@pytest.mark.parametrize("rebound_n", [0.0, 0.5], ids=["none", "small"])
def test_presses_as_in_calibration_raise_no_doubt(hand, rebound_n) -> None:
    assert {hand.press(rebound_n).doubt for _ in range(8)} == {None}


def test_rebounds_of_a_third_of_the_presses_raise_no_doubt(hand) -> None:
    assert {hand.press(rebound_n).doubt for rebound_n in (0.0, 0.0, 1.0) * 3} == {None}


def test_small_rebounds_of_all_presses_raise_the_doubt(hand) -> None:
    """0.3 is improbable with strips like those of the calibration, and the more so each time."""
    found = [hand.press(rebound_n=0.6).doubt for _ in range(6)]
    assert found[0] is None
    assert found[-1] is Reason.MEMORY


def test_a_hand_that_presses_and_pulls_raises_no_doubt(hand) -> None:
    """It pulls harder than it pressed at times, as no rebound does."""
    assert {hand.press(rebound_n).doubt for rebound_n in (1.8, 2.2, 1.9, 2.1) * 2} == {None}


def test_inertia_is_no_press(hand) -> None:
    for _ in range(8):
        hand.load(-2.0, 0.5, Reason.MOTION)
        shape = hand.load(1.0, 0.5, Reason.MOTION)
    assert (shape.doubt, hand.watch.ratio) == (Reason.MOTION, 0.0)


def test_a_worse_status_stands_and_without_forces_nothing_is_told(hand) -> None:
    for _ in range(2):
        shape = hand.press(rebound_n=1.0)
    worse = replace(shape, t_s=shape.t_s + STEP_S, status=Status.NOT_CONVERGED, doubt=None)
    assert hand.watch.observe(worse).status is Status.NOT_CONVERGED
    fresh = ReboundWatch(hand.rest, FINGER_N)
    without = replace(shape, loads=None, status=Status.OK, doubt=None)
    assert fresh.observe(without) is without


@pytest.mark.parametrize("plan", ["hysteresis", "healthy"])
def test_strips_with_three_times_the_memory_are_found_out(plan, tmp_path) -> None:
    """In batch in all frames, live after two presses; strips like those of the calibration in none."""
    (tmp_path / "causes").mkdir()
    for name in {"healthy", plan}:
        shutil.copy(CAUSES[name], tmp_path / "causes")
    (tmp_path / "press.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT, *LONGER))
    trial = simulate(tmp_path / "causes" / f"{plan}.toml", tmp_path / plan, 2)
    pipeline = pipeline_of(trial.description)
    frames = list(pipeline.lengths(trial.readings(), 500))
    batch = [shape.doubt for shape in pipeline.shapes(frames, "batch")]
    live = [shape.doubt for shape in pipeline.shapes(frames, "live")]
    if plan == "healthy":
        assert set(batch) == set(live) == {None}
    else:
        assert set(batch) == {Reason.MEMORY}
        assert live[0] is None
        assert set(live[-100:]) == {Reason.MEMORY}
