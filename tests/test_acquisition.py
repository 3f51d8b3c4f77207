"""From rows of boards to frames: clocks, gates, and the mean over a frame."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph import BoardReading, Flag, ResistanceReading
from tensegraph.models.sensor.clock import BoardClock, ClockSettings, _LowerLine
from tensegraph.models.sensor.frames import FrameAssembler, FrameSettings
from tensegraph.models.sensor.gate import GateSettings, ReadingGate

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


class TestGate:
    def run(self, values, period_s=0.02):
        gate = ReadingGate(GateSettings(), 1)
        out = [
            gate.check(period_s * k, np.array([v]), np.array([0.001]), np.zeros(1, dtype=np.int64))
            for k, v in enumerate(values)
        ]
        return np.array([value[0] for value, _ in out]), np.array([flags[0] for _, flags in out])

    def test_a_spike_is_blanked(self) -> None:
        values = 0.1 + 0.001 * np.random.default_rng(0).standard_normal(100)
        values[50] += 0.5
        believed, flags = self.run(values)
        assert np.flatnonzero(np.isnan(believed)).tolist() == [50]
        assert flags[50] == Flag.OUTLIER

    def test_a_step_that_stays_is_believed_at_the_third_reading(self) -> None:
        values = np.where(np.arange(100) < 50, 0.1, 0.9) + 0.001 * np.random.default_rng(0).standard_normal(100)
        believed, _ = self.run(values)
        assert np.flatnonzero(np.isnan(believed)).tolist() == [50, 51]

    def test_a_stuck_code_is_found_and_taken_back(self) -> None:
        rng = np.random.default_rng(0)
        values = np.round(25 + 0.5 * rng.standard_normal(400)) / 250
        values[150:300] = values[150]
        believed, flags = self.run(values)
        stuck = np.flatnonzero(flags & Flag.STUCK)
        assert 200 <= stuck[0] < 250
        assert np.isfinite(believed[301:]).all()

    def test_quiet_codes_are_not_stuck(self) -> None:
        """A sensor whose noise seldom reaches the next code must stay the same for longer."""
        rng = np.random.default_rng(0)
        values = np.round(25 + 0.2 * rng.standard_normal(3000)) / 250
        _, flags = self.run(values)
        assert not (flags & Flag.STUCK).any()

    @given(st.lists(st.floats(-1, 5), min_size=3, max_size=80))
    def test_believed_values_are_the_given_ones(self, values) -> None:
        believed, flags = self.run(values)
        kept = np.isfinite(believed)
        np.testing.assert_array_equal(believed[kept], np.array(values)[kept])
        assert (flags[~kept] != 0).all()


def reading(
    t_s: float, value: float, source: int = 0, arrival_s: float | None = None, flags: int = 0
) -> ResistanceReading:
    tendon = np.array([2 * source, 2 * source + 1])
    ohm = np.array([value, 2 * value])
    return ResistanceReading(
        source, t_s, t_s if arrival_s is None else arrival_s, tendon, ohm, ohm * 0, np.full(2, flags)
    )


def assembler(sources: int = 1, **settings) -> FrameAssembler:
    return FrameAssembler(np.ones(2 * sources), sources, FrameSettings(**settings), GateSettings(max_rate_per_s=1e9))


class TestFrames:
    @settings(max_examples=40, deadline=None)
    @given(st.floats(0.0, 0.019), st.sampled_from([0.01, 0.02, 0.013, 0.04]))
    def test_a_ramp_stays_a_ramp(self, offset_s: float, period_s: float) -> None:
        """Whatever the boards' rate and phase, the mean over a frame of a straight line is its value at the middle."""
        frames = assembler()
        got = [f for k in range(100) for f in frames.add(reading(offset_s + period_s * k, 5 + k * period_s + offset_s))]
        assert len(got) > 20
        for frame in got[2:]:
            assert frame.resistance_ohm[0] == pytest.approx(5 + frame.t_s, abs=1e-9)

    def test_mean_by_hand(self) -> None:
        """Readings 0, 1, 0 at 0.98, 1.00, 1.02: the mean over [0.99, 1.01] of the two straight lines is 3/4."""
        frames = assembler()
        got = [f for t, v in ((0.98, 1.0), (1.0, 2.0), (1.02, 1.0), (1.04, 1.0)) for f in frames.add(reading(t, v))]
        assert {round(f.t_s, 3): f.resistance_ohm[0] for f in got}[1.0] == pytest.approx(1.75)

    def test_every_reading_counts_once(self) -> None:
        """An impulse in one reading, at any phase, adds one reading's share over all frames."""
        for offset_s in (0.0, 0.004, 0.011):
            frames = assembler()
            values = np.ones(60)
            values[30] = 2.0
            got = [f for k, v in enumerate(values) for f in frames.add(reading(offset_s + 0.02 * k, v))]
            assert sum(f.resistance_ohm[0] - 1 for f in got) == pytest.approx(1.0)

    def test_noise_of_fast_boards_is_averaged(self) -> None:
        rng, frames = np.random.default_rng(0), assembler()
        got = [f for k in range(4000) for f in frames.add(reading(0.005 * k, 1 + 0.01 * rng.standard_normal()))]
        assert np.std([f.resistance_ohm[0] for f in got]) < 0.0055

    def test_a_lost_row_is_bridged_and_a_gap_is_missing(self) -> None:
        frames = assembler()
        kept = [k for k in range(200) if k != 50 and not 100 <= k < 120]
        got = {round(f.t_s, 3): f for k in kept for f in frames.add(reading(0.02 * k, 1 + k))}
        assert got[1.0].resistance_ohm[0] == pytest.approx(51)
        assert np.isnan(got[2.2].resistance_ohm[0])
        assert got[2.2].flags[0] & Flag.MISSING
        assert got[3.0].resistance_ohm[0] == pytest.approx(151)

    def test_a_silent_board_is_not_waited_for(self) -> None:
        frames, got = assembler(2), []
        for k in range(200):
            got += frames.add(reading(0.02 * k, 1 + 0.01 * (k % 2), source=0))
            if not 50 <= k < 150:
                got += frames.add(reading(0.02 * k + 0.007, 3 + 0.01 * (k % 2), source=1, arrival_s=0.02 * k + 0.008))
            late_s = 0.02 * k - (got[-1].t_s if got else 0)
            assert late_s < 0.16
        missing = [f.t_s for f in got if np.isnan(f.resistance_ohm[2])]
        assert 1.0 < missing[0] < 1.2
        assert 2.9 < missing[-1] < 3.05
        assert all(np.isfinite(f.resistance_ohm[0]) for f in got)

    def test_frames_do_not_depend_on_what_comes_later(self) -> None:
        values = 1 + 0.1 * np.sin(np.arange(100))
        runs = []
        for until in (60, 100):
            frames = assembler()
            runs.append([f for k in range(until) for f in frames.add(reading(0.02 * k, values[k]))])
        for short, long in zip(*runs, strict=False):
            assert short.resistance_ohm[0] == long.resistance_ohm[0]

    def test_one_reading_is_one_frame(self) -> None:
        frames = assembler()
        assert list(frames.add(reading(0.0034, 7.0))) == []
        (frame,) = frames.finish()
        assert frame.resistance_ohm[0] == 7.0

    def test_none_is_none(self) -> None:
        assert list(assembler().finish()) == []

    def test_flags_of_the_readings_reach_the_frame(self) -> None:
        frames, got = assembler(), []
        for k in range(20):
            flagged = k == 10
            got += frames.add(
                reading(0.02 * k, np.nan if flagged else 1.0, flags=int(Flag.SATURATED) if flagged else 0)
            )
        flags = {round(f.t_s, 3): int(f.flags[0]) for f in got}
        assert flags[0.2] == Flag.SATURATED
        assert flags[0.1] == 0
