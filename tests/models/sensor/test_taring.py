"""What taring learns of each sensor while the structure rests."""

import numpy as np
import pytest

from tensegraph.models.sensor.bending import BendingCurve
from tensegraph.models.sensor.gauge import StaticGauge
from tensegraph.models.sensor.taring import Taring
from tensegraph.models.values.readings import RestLengths


def a_gauge() -> StaticGauge:
    return StaticGauge(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.1, 0.3]), 0.06, 0.003)


class TestTaring:
    def test_splits_between_gain_and_offset_by_hand(self) -> None:
        """At strain 0.1, g = 0.1: gain variance 0.006^2, offset 0.003^2, strain 0, so 4/5 of 0.02 is gain."""
        taring = Taring(a_gauge(), BendingCurve(), RestLengths(1.0, np.array([1.1]), np.array([1e-9])), np.array([1.0]))
        common = taring.common_change(0.0, np.array([0.12]))
        assert taring.gain[0] == pytest.approx(1 + 0.016 / 0.1)
        assert taring.offset[0] == pytest.approx(0.004)
        assert common[0] == pytest.approx(0.1)

    def test_learns_at_rest_only_and_skips_gaps(self) -> None:
        taring = Taring(a_gauge(), BendingCurve(), RestLengths(1.0, np.full(2, 1.1), np.full(2, 1e-4)), np.ones(2))
        taring.common_change(10.0, np.array([0.11, np.nan]))
        assert taring.tared.tolist() == [True, False]
        gain = taring.gain.copy()
        taring.common_change(11.5, np.array([0.5, 0.5]))
        np.testing.assert_array_equal(taring.gain, gain)
        assert taring.gain[1] == 1

    def test_untared_sensors_are_trusted_less(self) -> None:
        gauge, bending = a_gauge(), BendingCurve()
        tared = Taring(gauge, bending, RestLengths(1.0, np.array([1.1]), np.array([1e-4])), np.array([1.0]))
        tared.common_change(0.0, np.array([0.1]))
        untared = Taring(gauge, bending, None, np.array([1.0]))
        strain, change = np.array([0.1]), np.array([0.1])
        assert tared.sigma(strain, change)[0] < untared.sigma(strain, change)[0]
        assert untared.sigma(strain, change)[0] == pytest.approx(np.hypot(0.006, 0.003) / 2)

    def test_exchanged_sensors_are_named_with_their_pair(self) -> None:
        """Natural resistances of 5 to 7 MOhm, all at strain 0.1; the channels of tendons 1 and 2 are exchanged."""
        rest = RestLengths(1.0, np.full(5, 1.1), np.full(5, 1e-4))
        taring, natural_ohm = Taring(a_gauge(), BendingCurve(), rest, np.ones(5)), 1e6 * np.array([5, 6, 7, 6, 5])
        read_ohm = 1.1 * natural_ohm[[0, 2, 1, 3, 4]]
        taring.common_change(0.0, read_ohm / natural_ohm - 1)
        assert np.flatnonzero(taring.misfit).tolist() == [1, 2]
        assert taring.exchanged(natural_ohm) == [(1, 2)]
        taring = Taring(a_gauge(), BendingCurve(), rest, np.ones(5))
        taring.common_change(0.0, np.array([0.1, 0.3, 0.09, 0.1, 0.1]))  # 1.3 of 6 MOhm is not 1.1 of 7
        assert np.flatnonzero(taring.misfit).tolist() == [1]
        assert taring.exchanged(natural_ohm) == []

    def test_a_structure_that_did_not_rest_names_no_sensor(self) -> None:
        rest = RestLengths(1.0, np.full(4, 1.1), np.full(4, 1e-4))
        taring = Taring(a_gauge(), BendingCurve(), rest, np.ones(4))
        taring.common_change(0.0, np.array([0.1, 0.3, 0.3, 0.02]))
        assert taring.in_doubt
        assert not taring.misfit.any()

    @pytest.mark.parametrize("rate_hz", [4, 5, 10, 50])
    def test_noise_of_slow_readings_is_no_motion_and_a_press_is(self, rate_hz) -> None:
        """The noise of a reading is 0.0028 of strain; a press makes 0.03 on half of the tendons."""
        rng = np.random.default_rng(7)
        t_s = np.arange(0, 2.2, 1 / rate_hz)
        pressed = (t_s > 0.9)[:, None] * (np.arange(24) % 2) * 0.03
        found = []
        for of_hand in (0.0, pressed):
            for change in 0.1 + 0.0028 * rng.standard_normal((20, len(t_s), 24)) + of_hand:
                rest = RestLengths(2.0, np.full(24, 1.1), np.full(24, 1e-4))
                taring = Taring(a_gauge(), BendingCurve(), rest, np.ones(24))
                for t, row in zip(t_s.tolist(), change, strict=True):
                    taring.common_change(t, row)
                found.append(taring.moved)
        assert found == 20 * [False] + 20 * [True]
