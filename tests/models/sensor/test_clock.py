"""A board's clock laid onto the host's, from past rows only."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import BoardReading, InputError
from tensegraph.models.sensor.clock import BoardClock, ClockSettings, _LowerLine

COUNTS = np.full(2, 500)


def rows(n: int, *, rate_ppm=100.0, jitter_s=0.003, seed=0, seq0=0, device0_us=0, period_s=0.02, from_s=1.0):
    """Rows of a board with exponential delay behind 2 ms, and their true times."""
    rng = np.random.default_rng(seed)
    t_s = from_s + period_s * np.arange(n)
    device_us = device0_us + np.round(1e6 * (t_s - from_s) * (1 + rate_ppm * 1e-6)).astype(np.int64)
    host_s = np.maximum.accumulate(t_s + 0.002 + rng.exponential(jitter_s, n))
    readings = [BoardReading(0, host_s[k], (seq0 + k) % 2**16, int(device_us[k]) % 2**32, COUNTS) for k in range(n)]
    return readings, t_s


class TestClock:
    def test_is_right_to_a_fraction_of_the_jitter(self) -> None:
        readings, true_s = rows(3000)
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings]) - true_s
        assert np.abs(error_s[250:]).max() < 0.0005
        assert error_s.max() < 0.01
        assert clock.counts.lost_rows == clock.counts.dropped_rows == clock.counts.restarts == 0

    @pytest.mark.parametrize("rate_ppm", [-4000.0, 0.0, 4000.0])
    def test_follows_a_resonator(self, rate_ppm: float) -> None:
        readings, true_s = rows(3000, rate_ppm=rate_ppm)
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings]) - true_s
        assert np.abs(error_s[1000:]).max() < 0.002

    def test_a_computer_that_slept(self) -> None:
        """Its clock stood still for 20 s, the board's did not: no row is dropped, and none is timed in the future."""
        readings, true_s = rows(5000)
        awake = [k for k in range(5000) if not 40 < true_s[k] < 60]
        clock = BoardClock(ClockSettings())
        for k in awake:
            slept_s = 20.0 if true_s[k] > 50 else 0.0
            time_s = clock.time_s(replace(readings[k], host_s=readings[k].host_s - slept_s))
            assert time_s == pytest.approx(true_s[k] - slept_s, abs=0.02)
        assert clock.counts.dropped_rows == 0

    def test_a_clock_that_is_slower_than_its_rate_may_be_is_told(self) -> None:
        """As of an RC oscillator: the rows are timed too early, and right where the setting allows for it."""
        errors_s, clocks = [], [BoardClock(ClockSettings()), BoardClock(ClockSettings(max_rate_error=0.03))]
        readings, true_s = rows(3000, rate_ppm=-20_000.0)
        for clock in clocks:
            errors_s.append(np.array([clock.time_s(row) for row in readings]) - true_s)
        told = "is 2 % slow, which clock.max_rate_error (0.005) does not allow for: its rows are timed up to 0.077 s"
        assert clocks[0].warning() == f"{told} too early"
        assert errors_s[0][1000:].min() < -0.07
        assert clocks[1].warning() == ""
        assert np.abs(errors_s[1][2000:]).max() < 0.003

    @pytest.mark.parametrize("rate_ppm", [-4500.0, 20_000.0])
    def test_other_clocks_are_not(self, rate_ppm: float) -> None:
        """With ten times the usual jitter; of a fast one the times are right."""
        readings, true_s = rows(6000, rate_ppm=rate_ppm, jitter_s=0.03)
        clock = BoardClock(ClockSettings())
        for row, t_s in zip(readings, true_s, strict=True):
            assert clock.time_s(row) == pytest.approx(t_s, abs=0.1)
            assert clock.warning() == ""

    def test_milliseconds_are_no_microseconds(self) -> None:
        """Nor is a clock refused for a silent minute, or for a host whose clock is set an hour ahead."""
        clocks = BoardClock(ClockSettings()), BoardClock(ClockSettings())
        silent = [row for row in rows(6000)[0] if not 30 < row.host_s < 90]
        silent[1000:] = [replace(row, host_s=row.host_s + 3600) for row in silent[1000:]]
        for row in silent:
            clocks[0].time_s(row)
            clocks[0].check_counters(0)
        for row in rows(130)[0]:
            clocks[1].time_s(replace(row, device_us=row.device_us // 1000))
        with pytest.raises(InputError, match=r"board 1: device_us: went on by 0\.002\d* s in 2\.\d+ s .* units of"):
            clocks[1].check_counters(1)

    @pytest.mark.parametrize("digits", [-6, 0.001])
    def test_host_stamps_that_hardly_go_on_are_refused(self, digits) -> None:
        """Those of 2026 that are written with four digits, and kiloseconds."""
        clock = BoardClock(ClockSettings())
        for row in rows(600)[0]:
            host_s = round(1.79e9 + row.host_s, digits) if digits < 0 else digits * row.host_s
            clock.time_s(replace(row, host_s=host_s))
        told = r"board 3: host_s: went on by 0(\.01\d*)? s in 1\d s on the board's clock: .* with all digits"
        with pytest.raises(InputError, match=told):
            clock.check_counters(3)

    def test_the_host_counts_seconds(self) -> None:
        clock = BoardClock(ClockSettings())
        for row in rows(20)[0]:
            clock.time_s(replace(row, host_s=1000 * row.host_s))
        with pytest.raises(InputError, match=r"board 0: device_us: went on by 0\.38 s in 19 s .* units of both right"):
            clock.check_counters(0)

    @pytest.mark.parametrize("changed", [{"seq": 7}, {"device_us": 7}])
    def test_counters_that_do_not_count_are_refused(self, changed) -> None:
        """After the first row all others look like it, sent again; one frame was the whole result."""
        clock = BoardClock(ClockSettings())
        told = "board 2: none of the first 100 rows follows the one before: expected seq to count the rows"
        for row in rows(99)[0]:
            clock.time_s(replace(row, **changed))
            clock.check_counters(2)
        clock.time_s(replace(rows(100)[0][99], **changed))
        with pytest.raises(InputError, match=told):
            clock.check_counters(2)

    def test_is_causal(self) -> None:
        """The time of a row does not depend on later rows."""
        readings, _ = rows(400)
        clocks = BoardClock(ClockSettings()), BoardClock(ClockSettings())
        whole = [clocks[0].time_s(row) for row in readings]
        part = [clocks[1].time_s(row) for row in readings[:200]]
        assert whole[:200] == part

    def test_line_touches_the_lower_hull_by_hand(self) -> None:
        line = _LowerLine(ClockSettings(rate_prior_s=1e-9, max_rate_error=1.0))
        for x, y in [(0.0, 0.0), (1.0, 0.05), (2.0, 0.002), (3.0, 0.07), (4.0, 0.004)]:
            line.add(x, y)
        assert line.value(3.0) == pytest.approx(0.003)

    def test_counters_wrap(self) -> None:
        readings, true_s = rows(600, seq0=2**16 - 300, device0_us=2**32 - 6_000_000)
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings]) - true_s
        assert np.abs(error_s[250:]).max() < 0.001
        assert clock.counts.lost_rows == clock.counts.restarts == 0

    def test_lost_rows_are_counted(self) -> None:
        readings, _ = rows(100)
        clock = BoardClock(ClockSettings())
        for row in readings[:40] + readings[47:]:
            assert clock.time_s(row) is not None
        assert clock.counts.lost_rows == 7

    def test_late_and_double_rows_are_dropped(self) -> None:
        readings, _ = rows(100)
        clock = BoardClock(ClockSettings())
        shuffled = [*readings[:50], readings[49], readings[51], readings[50], *readings[52:]]
        times = [clock.time_s(row) for row in shuffled]
        assert clock.counts.dropped_rows == 2
        kept = [t for t in times if t is not None]
        assert (np.diff(kept) > 0).all()

    @pytest.mark.parametrize("boot", [0, 1])
    def test_a_restarted_board_is_taken_on(self, boot: int) -> None:
        """Its counters begin at zero again; with a boot column at once, without after one row."""
        before, _ = rows(500, seq0=40_000, device0_us=3_000_000_000)
        after, true_s = rows(500, from_s=13.0, seed=1)
        after = [BoardReading(0, r.host_s, r.seq, r.device_us, r.counts, boot) for r in after]
        clock = BoardClock(ClockSettings())
        times = [clock.time_s(row) for row in before + after][500:]
        assert clock.counts.restarts == 1
        assert clock.counts.dropped_rows == 1 - boot
        assert np.abs(np.array(times[100:]) - true_s[100:]).max() < 0.01

    def test_a_long_gap_soon_after_the_start_does_no_harm(self) -> None:
        """The rate is not yet known, and the board runs ahead by 1.2 s meanwhile; it did not count as restarted."""
        readings, true_s = rows(20_000, rate_ppm=4000.0)
        clock = BoardClock(ClockSettings())
        kept = np.r_[:150, 15_150:20_000]
        error_s = np.array([clock.time_s(readings[k]) for k in kept]) - true_s[kept]
        assert clock.counts.restarts == 0
        assert np.abs(error_s).max() < 0.02

    def test_host_stamps_that_go_back_do_no_harm(self) -> None:
        readings, true_s = rows(1000)
        r = readings[500]
        readings[500] = BoardReading(0, r.host_s - 5.0, r.seq, r.device_us, r.counts)
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings]) - true_s
        assert clock.counts.host_steps == 1
        assert np.abs(error_s[250:]).max() < 0.001

    def test_a_host_clock_set_back_for_good_does_no_harm(self) -> None:
        readings, true_s = rows(1500)
        moved = [BoardReading(0, r.host_s - 3600.0, r.seq, r.device_us, r.counts) for r in readings[500:]]
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings[:500] + moved]) - true_s
        assert np.abs(error_s[250:]).max() < 0.01

    def test_rows_that_have_waited_do_no_harm(self) -> None:
        """The host is stopped for 20 s: its port keeps the rows of the first 10 s, and loses those after them."""
        readings, true_s = rows(3000)
        go_on_s = readings[1500].host_s
        waited = [BoardReading(0, go_on_s, r.seq, r.device_us, r.counts) for r in readings[500:1000]]
        clock = BoardClock(ClockSettings())
        times_s = [clock.time_s(row) for row in readings[:500] + waited + readings[1500:]]
        error_s = np.array(times_s) - np.r_[true_s[:1000], true_s[1500:]]
        assert np.abs(error_s[250:]).max() < 0.01
        assert clock.counts.restarts == clock.counts.dropped_rows == 0

    def test_a_host_clock_set_ahead_is_followed(self) -> None:
        readings, true_s = rows(1500)
        moved = [BoardReading(0, r.host_s + 3600.0, r.seq, r.device_us, r.counts) for r in readings[500:]]
        clock = BoardClock(ClockSettings())
        error_s = np.array([clock.time_s(row) for row in readings[:500] + moved]) - true_s
        assert np.abs(error_s[250:500]).max() < 0.01
        assert np.abs(error_s[1000:] - 3600.0).max() < 0.01

    @pytest.mark.parametrize("first_us", [0, 2**32 - 700_000])
    def test_other_stamps_of_the_board_are_on_the_same_line(self, first_us: int) -> None:
        """Half a row before and after the newest row, wherever the counter wraps."""
        readings, true_s = rows(600, device0_us=first_us)
        clock = BoardClock(ClockSettings())
        for row in readings:
            at_s = clock.time_s(row)
            for half_us in (-10_000, 10_000):
                other_s = clock.time_of_stamp_s((row.device_us + half_us) % 2**32, row.boot)
                assert other_s == pytest.approx(at_s + 1e-6 * half_us, abs=2e-4)
        assert other_s == pytest.approx(true_s[-1] + 0.01, abs=0.001)

    def test_a_stamp_that_no_row_explains_has_no_time(self) -> None:
        readings, _ = rows(10)
        clock = BoardClock(ClockSettings())
        assert clock.time_of_stamp_s(readings[0].device_us, 0) is None
        for row in readings:
            clock.time_s(row)
        newest = readings[-1]
        assert clock.time_of_stamp_s(newest.device_us, newest.boot + 1) is None
        assert clock.time_of_stamp_s(newest.device_us + 1_500_000, newest.boot) is None


def test_rows_before_those_of_an_earlier_start_are_left_out_and_counted() -> None:
    """A restart while the host's clock goes back by 5 s: rows count again once they are not earlier than the last."""
    before, _ = rows(500)
    after, true_s = rows(750, from_s=6.0, seed=1)
    clock = BoardClock(ClockSettings())
    for row in before:
        clock.time_s(row)
    times_s = [clock.time_s(row) for row in after]
    told = np.array([t is not None for t in times_s])
    assert clock.counts.restarts == 1
    assert clock.counts.dropped_rows == (~told).sum() == pytest.approx(200, abs=2)
    assert told[200:].all()
    error_s = np.array(times_s[260:]) - true_s[260:]
    assert np.abs(error_s).max() < 0.01
