"""Running stretch sensors: settled, at any rate, beyond their training."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.sensor.stretching import Extrapolation, FastSwing, StrainSpread, StretchingSensors


def steps(samples: int, step_s: float) -> NDArray[np.float64]:
    """(samples, 1) the same time before each."""
    return np.full((samples, 1), step_s)


class TestStretchingSensors:
    def test_settled_sensors_stay(self, model: SensorModel) -> None:
        sensors, change = StretchingSensors(model, 2), np.array([0.05, 0.12])
        sensors.settle(change, np.array([True, True]), 0.1)
        told = sensors.run(np.tile(change, (200, 1)), np.zeros((200, 2)), steps(200, 0.1))
        np.testing.assert_allclose(told.strain[-1], told.strain[0], atol=5e-4)
        assert (told.sigma > 0).all()

    def test_same_motion_at_any_rate_gives_the_same_strain(self, model: SensorModel) -> None:
        """The true time step is an input: a slow stretch read at 10, 25 and 100 Hz ends at about the same strain."""
        ends = []
        for rate_hz in (10, 25, 100):
            sensors, t_s = StretchingSensors(model, 1), np.arange(0, 4, 1 / rate_hz)[:, None]
            sensors.settle(np.array([0.05]), np.array([True]), 1 / rate_hz)
            told = sensors.run(0.05 + 0.015 * t_s, np.full_like(t_s, 0.015), steps(len(t_s), 1 / rate_hz))
            ends.append(told.strain[-1, 0])
        assert np.ptp(ends) < 0.004

    def test_spread_is_a_running_deviation(self) -> None:
        values = StrainSpread(1).run(np.tile([0.0, 0.1], 5000)[:, None], steps(10_000, 0.1))[:, 0]
        assert values[0] == 0
        assert values[-1] == pytest.approx(0.05, rel=0.01)


class TestExtrapolation:
    def test_widens_at_once_and_forgets_slowly(self, model: SensorModel) -> None:
        """Twice the fastest trained rate doubles sigma; after 3 s of rest 1 + 1/e is left of that."""
        outside, still = Extrapolation(model, 1), np.zeros((2, 1))
        rate = np.array([[2 * model.ranges.rate_per_s], [0.0]])
        growth = outside.run(still, rate, still, np.array([[0.1], [3.0]]))
        assert growth.factor[:, 0] == pytest.approx([2.0, 1 + np.exp(-1)])
        assert growth.is_beyond[:, 0].tolist() == [True, False]
        assert (growth.added == 0).all()

    def test_strain_faster_than_trained_adds_the_lag_times_the_excess(self, model: SensorModel) -> None:
        """Steady strain at the fastest trained rate and 0.1 /s more: sigma 0.4 s * 0.1 /s on top."""
        still, rate = np.zeros((200, 1)), model.ranges.strain_rate_per_s + 0.1
        strain = rate * 0.02 * np.arange(200)[:, None]
        growth = Extrapolation(model, 1).run(still, still, strain, steps(200, 0.02))
        assert (growth.factor == 1).all()
        assert growth.added[-1, 0] == pytest.approx(0.04, rel=0.01)
        assert growth.is_beyond[-1, 0]

    def test_grows_with_the_distance_beyond_the_trained_change(self, model: SensorModel) -> None:
        far = np.array([[model.ranges.change[1] + 0.3]])
        strain = model.gauge.stretched_strain(far)
        growth = Extrapolation(model, 1).run(far, np.zeros((1, 1)), strain, steps(1, 0.02))
        assert growth.is_beyond[0, 0]
        assert growth.added[0, 0] == pytest.approx(0.3 / model.gauge.slope(strain)[0, 0])


def swings_in(swing: FastSwing, strain: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return sigma, and whether the robot is shaken, after each row of strain, 50 times a second without gaps."""
    return swing.run(strain, np.ones(strain.shape, dtype=bool), steps(len(strain), 0.02))


class TestFastSwing:
    def test_noise_and_slow_motion_are_no_swing(self) -> None:
        rng = np.random.default_rng(7)
        swing, t_s = FastSwing(12), np.arange(0, 20, 0.02)
        strain = 0.02 * np.sin(2 * np.pi * 0.5 * t_s)[:, None] + 0.0005 * rng.standard_normal((len(t_s), 12))
        sigma = swings_in(swing, strain)[0]
        assert np.quantile(sigma, 0.99) < 0.005

    def test_shaking_widens_all_sensors_and_fades(self) -> None:
        """Ten of twelve swing by 0.01 at 6 Hz: sigma covers four times that; three seconds later little is left."""
        rng = np.random.default_rng(8)
        swing, t_s = FastSwing(12), np.arange(0, 13, 0.02)
        shaken = (t_s > 4) & (t_s < 7)
        strain = 0.0003 * rng.standard_normal((len(t_s), 12))
        strain[:, 2:] += 0.01 * (shaken * np.sin(2 * np.pi * 6 * t_s))[:, None]
        sigma = swings_in(swing, strain)[0]
        during, later = sigma[(t_s > 5) & shaken], sigma[t_s > 12.9]
        assert 0.01 < during[:, :2].min() < during[:, 2:].min()
        assert during.max() < 0.08
        assert later.max() < 0.2 * during.max()

    def test_one_faulty_sensor_widens_itself_alone(self) -> None:
        rng = np.random.default_rng(9)
        swing, t_s = FastSwing(12), np.arange(0, 6, 0.02)
        strain = 0.0003 * rng.standard_normal((len(t_s), 12))
        strain[t_s > 3, 4] += 0.05 * rng.standard_normal(np.sum(t_s > 3))
        sigma = swings_in(swing, strain)[0][-1]
        assert sigma[4] > 0.05
        assert np.delete(sigma, 4).max() < 0.003

    def test_three_sensors_that_swing_a_little_mean_that_the_robot_is_shaken(self) -> None:
        """They swing by 0.002 at 7 Hz for a second, which is seen within 0.8 s; two that swing may be faulty."""
        rng = np.random.default_rng(11)
        t_s = np.arange(0, 7, 0.02)
        for swinging in (2, 3):
            swing = FastSwing(12)
            strain = 0.0003 * rng.standard_normal((len(t_s), 12))
            strain[:, :swinging] += 0.002 * (((t_s > 3) & (t_s < 4)) * np.sin(2 * np.pi * 7 * t_s))[:, None]
            shaken = swings_in(swing, strain)[1]
            assert not shaken[t_s <= 3].any()
            assert shaken[(t_s > 3.8) & (t_s < 5)].all() == (swinging == 3)
            assert not shaken[t_s > 6].any()

    @settings(max_examples=40, deadline=None)
    @given(seed=st.integers(0, 2**32 - 1), strain=st.floats(0.01, 0.15), ramp_s=st.floats(0.1, 1.0))
    def test_a_press_is_no_shaking(self, seed: int, strain: float, ramp_s: float) -> None:
        """All tendons are stretched and released within a tenth of a second or more."""
        t_s = np.arange(0, 6, 0.02)
        pressed = np.interp(t_s, [3, 3 + ramp_s, 4.5, 4.5 + ramp_s], [0, strain, strain, 0])
        noise = 0.0003 * np.random.default_rng(seed).standard_normal((len(t_s), 12))
        assert not swings_in(FastSwing(12), pressed[:, None] + noise)[1].any()

    @pytest.mark.parametrize(("frequency_hz", "is_shaken"), [(0.5, False), (1.0, False), (2.0, True), (3.0, True)])
    def test_a_hand_that_swings_a_node_is_shaking_above_1_2_hz(self, frequency_hz: float, is_shaken: bool) -> None:
        """Three of twelve sensors swing by 0.01, slower than sensors follow or not."""
        rng = np.random.default_rng(13)
        t_s = np.arange(0, 6, 0.02)
        strain = 0.0003 * rng.standard_normal((len(t_s), 12))
        strain[:, :3] += 0.01 * ((t_s > 2) * np.sin(2 * np.pi * frequency_hz * (t_s - 2)))[:, None]
        shaken = swings_in(FastSwing(12), strain)[1]
        assert not shaken[t_s <= 2].any()
        assert shaken[t_s > 3].all() == shaken.any() == is_shaken

    def test_a_jump_over_a_gap_hides_no_shaking(self) -> None:
        """Strain is 0.2 higher after a gap; a second later shaking is seen within half a second."""
        rng = np.random.default_rng(12)
        swing, t_s = FastSwing(12), np.arange(0, 6, 0.02)
        strain = 0.0003 * rng.standard_normal((len(t_s), 12)) + 0.2 * (t_s > 3)[:, None]
        strain += 0.003 * ((t_s > 4) * np.sin(2 * np.pi * 6 * t_s))[:, None]
        gap_ends = np.argmax(t_s > 3)
        assert not swings_in(swing, strain[:gap_ends])[1].any()
        swing.restart(np.ones(12, dtype=bool))
        _, shaken = swings_in(swing, strain[gap_ends:])
        assert 4 < t_s[gap_ends:][np.argmax(shaken)] < 4.5

    def test_a_jump_over_a_gap_is_no_swing(self) -> None:
        swing = FastSwing(3)
        swings_in(swing, np.full((100, 3), 0.05))
        swing.restart(np.ones(3, dtype=bool))
        assert np.max(swings_in(swing, np.full((50, 3), 0.15))[0]) < 1e-9

    def test_a_held_strain_does_not_lower_the_noise(self) -> None:
        """Six of twelve sensors are missing for 2 s: afterwards no noise is taken for a swing."""
        rng = np.random.default_rng(10)
        swing, t_s = FastSwing(12), np.arange(0, 8, 0.02)
        strain = 0.0005 * rng.standard_normal((len(t_s), 12))
        missing = ((t_s > 3) & (t_s < 5))[:, None] & (np.arange(12) < 6)
        strain[missing] = 0.0
        back = int(np.argmax(missing.any(axis=1))) + int(missing.any(axis=1).sum())
        before, _ = swing.run(strain[:back], ~missing[:back], steps(back, 0.02))
        swing.restart(np.arange(12) < 6)
        after, _ = swing.run(strain[back:], ~missing[back:], steps(len(t_s) - back, 0.02))
        sigma = np.concatenate([before, after])
        assert np.max(sigma[300:]) < 0.005
        assert np.mean(sigma[300:]) < 2 * np.mean(sigma[100:150]) + 2e-4
