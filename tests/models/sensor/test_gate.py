"""Readings that are not believed: spikes, stuck codes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import Flag
from tensegraph.models.sensor.gate import GateSettings, ReadingGate


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

    def test_noise_of_fast_readings_is_no_spike(self) -> None:
        """Readings at 1000 Hz of a converter whose own error is not known, with the noise of sensors at rest."""
        gate, rng = ReadingGate(GateSettings(), 1), np.random.default_rng(0)
        for k in range(1000):
            value = np.array([0.1 + 0.0022 * rng.standard_normal() + 0.5 * (k == 500)])
            _, flags = gate.check(0.001 * k, value, np.zeros(1), np.zeros(1, dtype=np.int64))
            assert bool(flags[0] & Flag.OUTLIER) == (k == 500)

    def test_a_small_spike_is_away_and_back(self) -> None:
        """By hand: 0.07 in 20 ms is 3.5/s, as of fast motion, but that is not back at once; a step is believed."""
        rng = np.random.default_rng(0)
        for change, blank in ((0.07 * (np.arange(100) == 50), [50]), (0.07 * (np.arange(100) >= 50), [50])):
            believed, flags = self.run(0.1 + change + 0.001 * rng.standard_normal(100))
            assert np.flatnonzero(np.isnan(believed)).tolist() == blank
            assert flags[50] == Flag.OUTLIER

    def test_motion_that_begins_at_once_loses_one_reading(self) -> None:
        """At 2.5/s from one reading to the next, up and down; a swing of 6 Hz that comes up to 2.5/s loses none."""
        ramp = np.clip(0.05 * (np.arange(100) - 50), 0, 0.5) - np.clip(0.05 * (np.arange(100) - 70), 0, 0.5)
        believed, _ = self.run(0.1 + ramp)
        assert np.flatnonzero(np.isnan(believed)).tolist() == [51, 71]
        t_s = 0.02 * np.arange(300)
        swing = 0.066 * np.clip(t_s - 1, 0, 1) * np.sin(2 * np.pi * 6 * t_s)
        assert np.isfinite(self.run(0.1 + swing)[0]).all()

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
