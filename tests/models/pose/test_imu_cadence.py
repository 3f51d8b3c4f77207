"""When inertial sensors have measured, from stamps of arrival."""

import numpy as np
import pytest

from tensegraph.models.pose.imu_cadence import COUNTED, ImuCadence

PERIOD_S = 0.01
MEASURED_S = PERIOD_S * np.arange(3000)
KNOWN = slice(1000, None)


def measured_s(stamps_s) -> np.ndarray:
    cadence = ImuCadence()
    return np.array([cadence.observe(t_s) for t_s in stamps_s])


def test_the_gain_by_hand() -> None:
    """Steps of 6 and 14 ms in turn: var(u) is its least, (0.5 ms)^2, and var(v) = (16 - 0.25) / 2 ms^2."""
    stamps_s = np.cumsum(np.tile([0.006, 0.014], COUNTED))
    last_s = stamps_s[-1] + 0.006
    ratio = 0.25 / 7.875
    gain = (np.sqrt(ratio**2 + 4 * ratio) - ratio) / 2
    before, after = measured_s([*stamps_s, last_s])[-2:]
    assert gain**2 / (1 - gain) == pytest.approx(ratio)
    assert after - before == pytest.approx(0.01 + gain * (last_s - before - 0.01), abs=1e-5)


@pytest.mark.parametrize("kept", [1.0, 0.98])
def test_stamps_of_a_regular_sensor_are_told_better_than_they_scatter(kept) -> None:
    """They scatter by 15 ms and arrive in order; also where 2 % of the samples are lost."""
    rng = np.random.default_rng(1)
    true_s = MEASURED_S[rng.random(len(MEASURED_S)) < kept]
    stamps_s = np.sort(true_s + rng.uniform(-0.015, 0.015, len(true_s)))
    before_s, after_s = stamps_s - true_s, measured_s(stamps_s) - true_s
    assert after_s[KNOWN].std() < 0.7 * before_s[KNOWN].std()
    assert abs(after_s[KNOWN].mean()) < 0.001


def test_samples_of_a_packet_are_spread_over_it() -> None:
    packet, of_packet = np.divmod(np.arange(len(MEASURED_S)), 5)
    stamps_s = 0.05 * (1 + packet) + 1e-5 * of_packet
    error_s = measured_s(stamps_s) - MEASURED_S
    assert (stamps_s - MEASURED_S)[KNOWN].std() > 0.013
    assert error_s[KNOWN].std() < 0.001


def test_stamps_of_a_sensor_that_is_asked_irregularly_stay() -> None:
    """Each 4 to 16 ms, and the stamp is that of the measurement."""
    stamps_s = np.cumsum(np.random.default_rng(2).uniform(0.004, 0.016, 3000))
    assert np.abs(measured_s(stamps_s) - stamps_s)[KNOWN].max() < 0.003


@pytest.mark.parametrize(("scatter_s", "pause_s"), [(0.015, 3.3333), (0.0, 0.11), (0.001, 0.05)])
def test_after_a_pause_the_first_stamp_stands(scatter_s, pause_s) -> None:
    rng = np.random.default_rng(3)
    stamps_s = np.sort(MEASURED_S + rng.uniform(-scatter_s, scatter_s, len(MEASURED_S)))
    stamps_s[2000:] += pause_s
    assert measured_s(stamps_s)[2000] == stamps_s[2000]


def test_samples_that_come_late_are_no_pause() -> None:
    """Delays are exponential, with a mean of 10 ms, and the samples arrive in order."""
    stamps_s = np.maximum.accumulate(MEASURED_S + np.random.default_rng(4).exponential(0.01, len(MEASURED_S)))
    stamps_s += 1e-6 * np.arange(len(stamps_s))
    before_s, after_s = stamps_s - MEASURED_S, measured_s(stamps_s) - MEASURED_S
    assert after_s[KNOWN].std() < 0.4 * before_s[KNOWN].std()
