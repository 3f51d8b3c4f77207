"""Means of inertial sensors over frames."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph.models.pose.imu_cadence import ImuCadence
from tensegraph.models.pose.imu_samples import ImuPreintegration, ImuSamples
from tensegraph.models.values.aids import READING_HOLDS_S, ImuReading

STEP_S = 0.02


def reading(t_s: float, rate: float, imu: int = 0) -> ImuReading:
    """Return a sample with a rate about z, and ten times it as the specific force along z."""
    return ImuReading(imu, t_s, np.array([0, 0, rate]), np.array([0, 0, 10 * rate]))


def test_a_mean_worked_by_hand() -> None:
    """Rate 1 until 0.02 s; then samples 3 at 0.03 s and 5 at 0.035 s.

    3 for 0.01 s, 5 for 0.005 s, and as long after it: 0.08 / 0.02 = 4.
    """
    means = ImuPreintegration(1)
    assert means.mean(0.02, [reading(0.01, 1), reading(0.02, 1)]).rate_rad_per_s[0, 2] == pytest.approx(1)
    found = means.mean(0.04, [reading(0.03, 3), reading(0.035, 5)])
    assert found.rate_rad_per_s[0, 2] == pytest.approx(4)
    assert found.specific_force_m_per_s2[0, 2] == pytest.approx(40)
    assert found.count.tolist() == [2]


@given(
    st.lists(st.tuples(st.floats(0.002, 0.018), st.floats(-5, 5)), min_size=8, max_size=60).filter(
        lambda samples: sum(step for step, _ in samples[1:]) > 2 * STEP_S
    )
)
def test_the_means_of_all_frames_sum_up_to_the_integral(samples: list[tuple[float, float]]) -> None:
    """However many samples fall into each frame; the first frame has the mean of its own."""
    t_s = np.cumsum([step for step, _ in samples])
    rate = np.array([rate for _, rate in samples])
    frames = np.arange(1, int(t_s[-1] / STEP_S) + 1) * STEP_S
    means, turned, first = ImuPreintegration(1), 0.0, None
    for frame_s in frames:
        inside = (t_s > frame_s - STEP_S) & (t_s <= frame_s)
        mean = means.mean(frame_s, [reading(*one) for one in zip(t_s[inside], rate[inside], strict=True)])
        if first is not None:
            turned += mean.rate_rad_per_s[0, 2] * STEP_S
        elif inside.any():
            first = np.flatnonzero(inside)[-1]
            first_s = frame_s
    last = np.flatnonzero(t_s <= frames[-1])[-1]
    told = rate[first + 1 : last + 1] @ np.diff(t_s[first : last + 1])
    expected = told - rate[first] * (first_s - t_s[first]) + rate[last] * (frames[-1] - t_s[last])
    assert turned == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("rates", "is_cut_off"),
    [
        ([0.1, 3.0, 4.36, 4.36, 4.36, 2.0], True),
        ([0.1, -3.0, -4.36, -4.36, -4.36, -2.0], True),
        ([0.1, 3.0, 4.36, 4.35, 4.36, 4.36], False),  # twice in succession may be chance
        ([0.2, 0.2, 0.2, 0.2, 0.2, 0.2], False),  # slow
        ([5.0, 4.0, 4.0, 4.0, 4.0, 3.0], False),  # not the largest
    ],
)
def test_the_largest_rate_again_and_again_is_the_end_of_the_range(rates: list[float], is_cut_off: bool) -> None:
    means = ImuPreintegration(1)
    found = [means.mean(0.01 * k, [reading(0.01 * k, rate)]).rate_is_cut_off[0] for k, rate in enumerate(rates)]
    assert any(found) == is_cut_off


@pytest.mark.parametrize(
    ("tenths", "expected"),
    [
        ([0.98, 1.962, 1.5, 1.962], [False, True, False, True]),
        ([0.98, 2.4, 2.3, 2.4, 2.39], [False, False, False, True, False]),
        ([1.98, 1.94], [True, True]),
        ([0.98, 2.8, 1.962], [False, False, False]),
        ([0.98, 0.98, 0.98], [False, False, False]),
    ],
    ids=["a usual range", "another one", "with a bias", "a larger range", "at rest"],
)
def test_the_largest_force_is_the_end_of_a_usual_range_or_one_that_was_read_before(tenths, expected) -> None:
    means = ImuPreintegration(1)
    found = [means.mean(0.01 * k, [reading(0.01 * k, one)]).force_is_cut_off[0] for k, one in enumerate(tenths)]
    assert found == expected


def test_the_newest_sample_lasts_until_the_next_is_due() -> None:
    """What it was taken to feel meanwhile is made up for with the next one, of which it says less."""
    means = ImuPreintegration(1)
    means.mean(0.02, [replace(reading(0.02, 2), due_s=0.06)])
    between = means.mean(0.04, [])
    assert (between.count[0], between.rate_rad_per_s[0, 2]) == pytest.approx((1, 2))
    assert between.specific_force_m_per_s2[0, 2] == pytest.approx(20)
    again = means.mean(0.06, [reading(0.06, 4)])
    assert again.rate_rad_per_s[0, 2] == pytest.approx((0.04 * 4 - 0.02 * 2) / STEP_S)
    assert again.specific_force_m_per_s2[0, 2] == pytest.approx(10 * (0.04 * 4 - 0.02 * 2) / STEP_S)


def test_a_sensor_whose_sample_is_overdue_keeps_its_rate_and_has_no_force() -> None:
    means = ImuPreintegration(2)
    means.mean(0.02, [replace(reading(0.02, 2), due_s=0.03), reading(0.02, 2, imu=1)])
    silent = means.mean(0.04, [reading(0.04, 2, imu=1)])
    assert (silent.count.tolist(), silent.are_missing.tolist()) == ([0, 1], [True, False])
    assert silent.rate_rad_per_s[:, 2].tolist() == pytest.approx([2, 2])
    assert np.isnan(silent.specific_force_m_per_s2[0]).all()
    again = means.mean(0.06, [reading(0.06, 4), reading(0.06, 2, imu=1)])
    assert again.specific_force_m_per_s2[:, 2].tolist() == pytest.approx([40, 20])


def means_of(stamps_s: list[float], rates: list[float], frames: int) -> list[ImuSamples]:
    """Return the means of one sensor over frames of 20 ms."""
    means, cadence, told = ImuPreintegration(1), ImuCadence(), []
    for t_s, rate in zip(stamps_s, rates, strict=True):
        measured_s = cadence.observe(t_s)
        told.append(replace(reading(measured_s, rate), due_s=cadence.due_s))
    ends_s = STEP_S * np.arange(1, frames + 1) + 1e-6
    return [means.mean(t_s, [one for one in told if t_s - STEP_S < one.t_s <= t_s]) for t_s in ends_s]


def test_samples_that_are_missing_are_not_made_up_for() -> None:
    """100 samples a second of 3 rad/s; none from 1.6 s until the robot has landed and lies still, 0.1 s later.

    Before, the first of 0 rad/s was taken to last for all of the gap, in which 3 rad/s had been held: -15 rad/s.
    """
    stamps = [0.01 * k for k in range(1, 190) if not 160 < k < 171]
    found = means_of(stamps, [3.0 if t_s <= 1.6 else 0.0 for t_s in stamps], frames=90)
    missing = [bool(each.are_missing[0]) for each in found]
    assert [k for k, is_missing in enumerate(missing) if is_missing] == [80, 81, 82, 83, 84]
    assert found[85].rate_rad_per_s[0, 2] == 0.0


@pytest.mark.parametrize("stamps_s", [[0.03 * k for k in range(1, 300)], [0.06 * (k // 6) for k in range(6, 900)]])
def test_nothing_is_missing_of_a_sensor_that_is_slower_than_frames_or_sends_packets(stamps_s) -> None:
    found = means_of(stamps_s, [1.0] * len(stamps_s), frames=400)
    assert all(each.count[0] > 0 for each in found[5:])
    assert not any(each.are_missing[0] for each in found)


def test_after_a_long_silence_only_the_own_samples_count() -> None:
    means = ImuPreintegration(1)
    means.mean(0.02, [reading(0.02, 2)])
    later_s = 0.02 + 1.5 * READING_HOLDS_S
    means.mean(later_s - STEP_S, [])
    found = means.mean(later_s, [reading(later_s - 0.01, 1), reading(later_s, 3)])
    assert found.rate_rad_per_s[0, 2] == pytest.approx(2)


def test_samples_last_for_all_of_a_gap_in_which_they_were_read() -> None:
    """A second between two frames: of one sensor samples throughout it, of the others at its end or beginning alone."""
    means = ImuPreintegration(3)
    first = means.mean(0.02, [reading(0.01, 1, imu) for imu in range(3)])
    assert np.isnan(first.lasted_s).all()
    throughout = [reading(t_s, 1, 0) for t_s in np.arange(0.02, 1.02, 0.01)]
    found = means.mean(1.02, sorted([*throughout, reading(1.01, 1, 1), reading(0.02, 1, 2)], key=lambda one: one.t_s))
    assert found.lasted_s == pytest.approx([1.0, np.nan, np.nan], nan_ok=True)
