"""From readings of boards that are not synchronised to frames of all sensors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph import Flag, ResistanceReading
from tensegraph.models.sensor.frames import FrameAssembler, FrameSettings, LengthPauses
from tensegraph.models.sensor.gate import GateSettings
from tensegraph.models.values.readings import Mode, TendonLengths


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
        values = ((0.98, 1.0), (1.0, 2.0), (1.02, 1.0), (1.04, 1.0), (1.06, 1.0))
        got = [f for t, v in values for f in frames.add(reading(t, v))]
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

    @pytest.mark.parametrize("start_s", [0.0, 1e5, 1.7e9])
    def test_readings_as_far_apart_as_the_longest_gap_are_bridged(self, start_s: float) -> None:
        """Most differences of stamps at 10 Hz are a rounding error above 0.1 s, or below."""
        frames = assembler(rate_hz=10)
        got = [f for k in range(200) for f in frames.add(reading(start_s + k / 10, 1.0))]
        assert len(got) > 196
        assert all(np.isfinite(f.resistance_ohm).all() for f in got)

    @pytest.mark.parametrize(
        ("period_s", "rate_hz"), [(0.02, 50), (0.033, 50), (0.0398, 25), (0.0502, 25), (0.067, 50 / 3), (0.1003, 10)]
    )
    def test_slow_boards_have_fewer_frames(self, period_s: float, rate_hz: float) -> None:
        """Never twice as many as rows, but for a tenth of a frame; each has all sensors."""
        frames, got = assembler(2), []
        for k in range(100):
            for source, late_s in ((0, 0.0), (1, 0.007)):
                got += frames.add(reading(period_s * k + late_s, 1.0 + 0.01 * (k % 2), source=source))
        assert frames.rate_hz == pytest.approx(rate_hz)
        assert len(got) == pytest.approx(100 * period_s * rate_hz, abs=3)
        assert all(np.isfinite(f.resistance_ohm).all() for f in got)
        assert len(frames.slow_sources()) == (0 if rate_hz == 50 else 2)

    def test_rows_too_far_apart_are_not_bridged(self) -> None:
        frames = assembler()
        got = [f for k in range(40) for f in frames.add(reading(0.5 * k, 1.0 + 0.01 * (k % 2)))]
        assert np.mean([np.isnan(f.resistance_ohm[0]) for f in got]) > 0.5
        assert frames.slow_sources() == {0: "a row each 0.5 s: frames between them have no reading: send them faster"}

    def test_the_longest_step_of_a_sensor_model(self) -> None:
        frames = FrameAssembler(np.ones(2), 1, FrameSettings(), GateSettings(max_rate_per_s=1e9), 0.1)
        got = [f for k in range(40) for f in frames.add(reading(0.2 * k, 1.0 + 0.01 * (k % 2)))]
        assert frames.rate_hz == 10
        assert all(np.isfinite(f.resistance_ohm).all() for f in got)

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


@pytest.mark.parametrize("after", [1, 3, 50])
@pytest.mark.parametrize("jump_s", [100.0, 1e9])
def test_a_long_silence_has_no_frames(jump_s: float, after: int) -> None:
    frames = assembler()
    made = []
    for k in range(100):
        made += frames.add(reading(0.02 * k + (jump_s if k >= after else 0.0), 1.0))
    made += frames.finish()
    t_s = np.array([frame.t_s for frame in made])
    assert len(made) < 110
    np.testing.assert_allclose(np.diff(t_s).max(), jump_s, atol=0.5)
    assert all(np.isfinite(frame.resistance_ohm).all() for frame in made[60:-1])


def test_slow_rows_after_a_long_silence_are_as_slow_as_before() -> None:
    """The silence is none of the times between rows."""
    frames = assembler()
    times = [*np.arange(0, 20, 1.5), *np.arange(100, 120, 1.5)]
    made = [frame for t_s in times for frame in frames.add(reading(t_s, 1.0))]
    assert frames.rate_hz == pytest.approx(50 / 75)
    assert frames.slow_sources() == {0: "a row each 1.5 s: frames between them have no reading: send them faster"}
    assert sum(frame.t_s > 90 for frame in made) >= 12


def row(t_s: float, *length_m: float) -> TendonLengths:
    length = np.array(length_m)
    flags = np.where(np.isnan(length), int(Flag.MISSING), 0)
    return TendonLengths(
        t_s=t_s,
        length_m=length,
        sigma_m=np.where(np.isnan(length), np.inf, 0.001 + 0.01 * t_s),
        mode=np.full(len(length), Mode.STRETCHING),
        flags=flags,
    )


def test_between_rows_of_lengths_a_robot_that_rolls_has_frames_on_the_line() -> None:
    """By hand: of rows 0.1 s apart there are four at 20, 40, 60 and 80 ms; a tendon that one row misses is missing."""
    pauses = LengthPauses(3, FrameSettings(), bridges=True)
    before, after = row(0.0, 0.1, 0.2, np.nan), row(0.1, 0.2, 0.1, 0.3)
    assert list(pauses.up_to(before)) == [before]
    assert not list(pauses.until(0.1))
    *between, last = pauses.up_to(after)
    assert last is after
    assert [frame.t_s for frame in between] == pytest.approx([0.02, 0.04, 0.06, 0.08])
    for frame in between:
        assert frame.length_m == pytest.approx([0.1 + frame.t_s, 0.2 - frame.t_s, np.nan], nan_ok=True)
        assert frame.sigma_m == pytest.approx([0.002, 0.002, np.inf])
        assert frame.usable.tolist() == [True, True, False]
        assert frame.flags[2] == Flag.MISSING


@pytest.mark.parametrize(("step_s", "bridges", "frames"), [(0.1, False, 0), (0.033, True, 0), (0.041, True, 1)])
def test_rows_of_lengths_at_the_rate_of_the_frames_are_the_frames(step_s, bridges, frames) -> None:
    pauses = LengthPauses(1, FrameSettings(), bridges=bridges)
    made = [frame for k in range(11) for frame in pauses.up_to(row(step_s * k, 0.1))]
    assert len(made) == 11 + 10 * frames


@pytest.mark.parametrize(("bridges", "pause_s"), [(False, 0.15), (True, 0.25)])
def test_a_pause_of_lengths_has_frames_without_them(bridges, pause_s) -> None:
    """None is made when the pause ends, too."""
    pauses = LengthPauses(1, FrameSettings(), bridges=bridges)
    assert len(list(pauses.up_to(row(1.0, 0.1)))) == 1
    made = list(pauses.until(1 + pause_s))
    assert [frame.t_s for frame in made] == pytest.approx(1 + 0.02 * np.arange(1, len(made) + 1))
    assert made[-1].t_s == pytest.approx(1 + pause_s, abs=0.03)
    assert not any(frame.usable.any() for frame in made)
    assert len(list(pauses.up_to(row(1 + pause_s, 0.1)))) == 1


def test_a_long_silence_of_lengths_has_no_frames() -> None:
    pauses = LengthPauses(1, FrameSettings(), bridges=True)
    assert len(list(pauses.up_to(row(1.0, 0.1)))) == 1
    assert not list(pauses.until(1e9))
    assert len(list(pauses.up_to(row(1e9, 0.1)))) == 1
