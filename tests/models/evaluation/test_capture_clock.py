"""The clock of a motion capture, from motion alone."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.models.evaluation.capture_clock import (
    LAG_SIGMA_S,
    CaptureClock,
    ClockFit,
    MotionSignals,
    clustered_covariance,
    moving_pairs,
    search_offset,
)

PAIRS = np.array([[0, 1], [1, 2]])


def wandering(t_s: np.ndarray) -> np.ndarray:
    """(times, 3, 3) three points that move in a way that never repeats; the first stands still."""
    wave = 0.02 * np.stack([np.sin(0.9 * t_s) + np.sin(1.7 * t_s + 1), np.sin(0.31 * t_s**1.2)], axis=-1)
    position_m = np.zeros((len(t_s), 3, 3))
    position_m[:, 1, 0], position_m[:, 2, 1] = 0.2 + wave[:, 0], 0.3 + wave[:, 1]
    return position_m


def motions(offset_s: float, rate: float, seconds: float, noise_m: float = 0.0):
    rng = np.random.default_rng(3)
    host_s = np.arange(0, seconds, 0.02)
    capture_s = np.arange(2.0, seconds - 3, 1 / 120)
    seen_m = wandering((capture_s + offset_s) + rate * capture_s) + noise_m * rng.standard_normal(
        (len(capture_s), 3, 3)
    )
    return (
        MotionSignals.of_distances(host_s, wandering(host_s), PAIRS),
        MotionSignals.of_distances(capture_s, seen_m, PAIRS),
    )


def test_host_time_by_hand() -> None:
    clock = CaptureClock(1.5, 0.01, 100.0, 10.0, middle_s=10.0)
    np.testing.assert_allclose(clock.host_s(np.array([10.0, 20.0])), [11.5, 21.501])


@pytest.mark.parametrize("offset_s", [-1.4, 0.0, 2.37])
def test_an_offset_is_found(offset_s) -> None:
    estimated, captured = motions(offset_s, 0.0, 40.0, 0.0002)
    search = search_offset(estimated, captured)
    assert search.is_clear
    assert search.offset_s == pytest.approx(offset_s, abs=0.05)
    clock = ClockFit(estimated, captured, search.offset_s).solve()
    assert clock.offset_s == pytest.approx(offset_s, abs=0.001)
    assert LAG_SIGMA_S <= clock.offset_sigma_s < 1.05 * LAG_SIGMA_S


def test_a_rate_error_is_found_in_a_long_trial() -> None:
    """Ten minutes tell 80 ppm; in half a minute the prior does, and its sigma says so."""
    for seconds, close, sigma in ((600.0, 5.0, 5.0), (30.0, 110.0, 101.0)):
        estimated, captured = motions(1.37, 80e-6, seconds, 0.0002)
        clock = ClockFit(estimated, captured, search_offset(estimated, captured).offset_s).solve()
        assert clock.rate_ppm == pytest.approx(80.0, abs=close)
        assert clock.rate_sigma_ppm < sigma
        offset_s = 1.37 + 80e-6 * clock.middle_s
        assert clock.offset_s == pytest.approx(offset_s, abs=0.002)


@pytest.mark.parametrize("ends_s", [3.5, 4.0])
def test_a_capture_that_ends_in_a_press_is_not_taken_for_later(ends_s: float) -> None:
    """Later by 0.5 s, it would explain more of the press that the estimate shows whole, but not well."""
    host_s = np.arange(0, 8, 0.02)
    position_m = np.zeros((len(host_s), 3, 3))
    position_m[:, 1, 0] = 0.2 - 0.01 * np.clip(host_s - 2.3, 0, 2) ** 2
    position_m[:, 2, 1] = 0.3
    seen = host_s < ends_s
    estimated = MotionSignals.of_distances(host_s, position_m, PAIRS)
    search = search_offset(estimated, MotionSignals.of_distances(host_s[seen], position_m[seen], PAIRS))
    assert 0 <= search.offset_s < 0.25


@pytest.mark.parametrize("shown", [0.6, 0.8, 1.25, 1.6])
def test_an_estimate_that_shows_less_or_more_of_the_motion_is_in_time(shown: float) -> None:
    """With 0.6 and 1.6 of it, 36 % and more are left over at any offset."""
    host_s = np.arange(0, 40, 0.02)
    position_m = wandering(host_s)
    estimated_m = position_m[:1] + shown * (position_m - position_m[:1])
    estimated, captured = (MotionSignals.of_distances(host_s, x, PAIRS) for x in (estimated_m, position_m))
    assert search_offset(estimated, captured).offset_s == pytest.approx(0, abs=0.05)


def test_what_repeats_tells_no_offset() -> None:
    host_s = np.arange(0, 60, 0.02)
    position_m = np.zeros((len(host_s), 3, 3))
    position_m[:, 1, 0], position_m[:, 2, 1] = 0.2 + 0.02 * np.sin(np.pi * host_s), 0.3
    motion = MotionSignals.of_distances(host_s, position_m, PAIRS)
    part = (host_s > 20) & (host_s < 40)
    search = search_offset(motion, MotionSignals.of_distances(host_s[part], position_m[part], PAIRS))
    assert not search.is_clear
    assert (search.offset_s - search.other_offset_s) / 2.0 == pytest.approx(
        round((search.offset_s - search.other_offset_s) / 2.0), abs=0.05
    )


def test_what_stands_still_tells_no_offset() -> None:
    rng = np.random.default_rng(0)
    host_s = np.arange(0, 20, 0.02)
    noisy = [0.1 + 0.3 * np.eye(3) + 0.001 * rng.standard_normal((len(host_s), 3, 3)) for _ in range(2)]
    assert not search_offset(*(MotionSignals.of_distances(host_s, x, PAIRS) for x in noisy)).is_clear


def test_a_capture_that_saw_nothing_tells_no_offset() -> None:
    """Every marker was hidden in every frame: no warning, no division by zero."""
    estimated, captured = motions(0.0, 0.0, 20.0)
    captured.signal_m[:] = np.nan
    search = search_offset(estimated, captured)
    assert not search.is_clear
    assert search.unexplained_share == search.other_unexplained_share == 1


@pytest.mark.parametrize("seen_until_s", [0.0, 20.2])
def test_what_is_hardly_seen_at_the_same_time_tells_no_offset(seen_until_s: float) -> None:
    """A marker that is never seen while the estimate lasts is left out; where all are, that is said."""
    estimated, captured = motions(0.0, 0.0, 40.0)
    known = captured.t_s < seen_until_s
    one = np.where(known[:, None] | [True, False], captured.signal_m, np.nan)
    assert np.isfinite(ClockFit(estimated, replace(captured, signal_m=one), 0.0).solve().offset_s)
    none = np.where((captured.t_s < 0)[:, None], captured.signal_m, np.nan)
    with pytest.raises(InputError, match="no motion of a marker in common: give --offset"):
        ClockFit(estimated, replace(captured, signal_m=none), 0.0).solve()


def test_a_capture_of_another_time_is_refused() -> None:
    estimated, captured = motions(0.0, 0.0, 40.0)
    with pytest.raises(InputError, match="no motion of a marker in common: give --offset"):
        ClockFit(estimated, captured, 1000.0)


def test_what_stands_still_while_both_see_it_is_refused() -> None:
    still = MotionSignals(np.arange(0, 20, 0.05), np.full((400, 1), 0.2))
    with pytest.raises(InputError, match="too little motion in common: give --offset"):
        ClockFit(still, still, 0.0).solve()


def test_jacobian(check_jacobian) -> None:
    estimated, captured = motions(1.37, 80e-6, 30.0)
    fit = ClockFit(estimated, captured, 1.35)
    known = np.isfinite(fit.rows(fit.start)[0]).all(axis=1) & (np.abs(captured.t_s - fit.middle_s) < 8)
    x = np.array([1.36, 1e-4])
    check_jacobian(lambda x: fit.rows(x)[0][known], fit.rows(x)[1][known], x, step=1e-5, tolerance=1e-7)


def test_speeds_do_not_depend_on_axes() -> None:
    t_s = np.arange(0, 10, 0.02)
    position_m = wandering(t_s)
    moved_m = position_m[..., [1, 2, 0]] + np.array([3.0, 0, 1])
    plain, moved = (MotionSignals.of_speeds(t_s, x).signal_m for x in (position_m, moved_m))
    np.testing.assert_allclose(moved, plain, atol=1e-9)
    assert np.nanmax(plain[:, 0]) < 1e-9 < np.nanmax(plain[:, 1])


def test_a_steady_speed_by_hand() -> None:
    """0.1 m/s for the smoothing's 0.3 s are 30 mm."""
    t_s = np.arange(0, 5, 0.02)
    position_m = np.zeros((len(t_s), 1, 3))
    position_m[:, 0, 2] = 0.1 * t_s
    signal_m = MotionSignals.of_speeds(t_s, position_m).signal_m
    np.testing.assert_allclose(signal_m[np.isfinite(signal_m)], 0.03, rtol=1e-6)


@pytest.mark.parametrize("seconds", [0.0, 0.002, 0.05])
def test_a_capture_of_no_duration_is_refused(seconds: float) -> None:
    """As one whose times are in milliseconds, taken for seconds, and the other way round."""
    t_s = np.linspace(0, seconds, 100)
    position_m = np.zeros((100, 3, 3))
    message = r"from a motion of more than 0\.05 s, got .* s: are its times in seconds"
    with pytest.raises(InputError, match=message):
        MotionSignals.of_speeds(t_s, position_m)
    with pytest.raises(InputError, match=message):
        MotionSignals.of_distances(t_s, position_m, np.array([[0, 1]]))


def test_a_capture_of_a_day_is_refused() -> None:
    """At 20 values a second its signals would take gigabytes; it is a stamp that jumps, or a wrong unit."""
    t_s = np.append(np.linspace(0, 10, 100), 86_400.0)
    with pytest.raises(
        InputError, match=r"from a motion of at most 10000 s, got 8\.64e\+04 s: are its times in seconds"
    ):
        MotionSignals.of_speeds(t_s, np.zeros((101, 3, 3)))


def test_a_short_gap_is_bridged_and_a_long_one_is_not() -> None:
    t_s = np.arange(0, 10, 0.02)
    position_m = wandering(t_s)
    position_m[(t_s > 3) & (t_s < 3.3), 1] = np.nan
    position_m[(t_s > 6) & (t_s < 7), 1] = np.nan
    motion = MotionSignals.of_distances(t_s, position_m, PAIRS)
    whole = MotionSignals.of_distances(t_s, wandering(t_s), PAIRS)
    near = (motion.t_s > 2) & (motion.t_s < 4)
    np.testing.assert_allclose(motion.signal_m[near], whole.signal_m[near], atol=0.001)
    assert np.isnan(motion.signal_m[(motion.t_s > 6) & (motion.t_s < 7)]).all()


def test_pairs_that_move() -> None:
    pairs = moving_pairs(wandering(np.arange(0, 20, 0.02)))
    assert [0, 1] in pairs.tolist()
    assert len(pairs) == 3


def test_clustered_covariance_by_hand() -> None:
    """J = 1 at two times of two signals, H = 4. Times (3, -1): 10; signals (2, 0): 4. 14 / 16."""
    residual = np.array([[2.0, 1.0], [0.0, -1.0]])
    covariance = clustered_covariance(residual, np.ones((2, 2, 1)), np.array([0, 1]))
    np.testing.assert_allclose(covariance, [[14 / 16]])
