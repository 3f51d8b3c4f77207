"""The stretching network running on several sensors at once, and the corrections of its sigma."""

import numpy as np
from numpy.typing import NDArray

from ..values.time_series import Floats, SmoothedRate, low_pass_weight
from .lstm import LOG_VARIANCE_RANGE, STRAIN_SCALE, features, next_means
from .sensor_model import SensorModel

SPREAD_MEMORY_S = 30.0
"""Time constant of the running mean and variance of strain in `StrainSpread`."""
SETTLING_S = 10.0
"""Time after which the past motion of a strip has no more effect. The network runs for this time at constant dR/R to
reach its state at rest, and a calibration recording is not scored for this time."""
EXTRAPOLATION_MEMORY_S = 3.0
"""Time for which a motion that is faster than any in training affects the estimate: the correlation time of the
network's error."""
STRETCHING_LAG_S = 0.4
"""Time constant of the lag of a sensor without correction by the network: the paper's time to 90 %, 926 ms, divided by
ln 10."""
SWING_S = 0.045
"""Time constant of the high-pass filters that pass strain which swings faster than 3.5 Hz. Sensors lag by up to 0.4 s,
and no calibration moves a strip so fast."""
SWING_MEAN_S = 0.3
"""Time over which the square of a fast swing is averaged."""
SWING_MEMORY_S = 1.5
"""Time for which a fast swing affects the estimate."""
SWING_START_S = 0.7
"""Time after the first reading in which the filters settle."""
SWING_LOSS = 4.0
"""Ratio of the true to the estimated strain of a fast swing. In simulated trials with shaking at 5 to 8 Hz errors are
three to five times the estimated swing, of the same sensor or, after a force elsewhere, of the others."""
LEAST_SWING = 2e-4
"""Least noise of strain above 3.5 Hz, for a sensor whose code stands still."""
FAULTY = 2
"""Number of sensors that may have a fault at the same time, and swing without the robot."""
CERTAIN_SWING = 6.0
"""Ratio of the mean square of strain above 3.5 Hz to the least one so far, above which a sensor swings for certain."""
PRESS_RATE_S = 0.1
"""Time constant of the smoothing of strain before the rate of a press is taken."""
PRESS_SHARE = 0.5
"""Part of SWING_S^2 v^2 that a press with the rate v leaves above 3.5 Hz, at most: the filters pass the beginning and
the end of a ramp of 0.1 s with half of that. At 50 frames a second it takes half to a third of a swing at 5 to 8 Hz."""
SLOW_SWING_S = 0.1
"""Time constant of the high-pass filters, and of the smoothing before the rate, that tell slower swings from presses.
The filters pass a swing of angular frequency w with the part w^2 T^2 / (1 + w^2 T^2), its rate keeps the part
1 / sqrt(1 + w^2 T^2), so that the mean square above them is `SLOW_SHARE` T^2 v^2 or more where
w^2 T^2 >= SLOW_SHARE / (1 - SLOW_SHARE)."""
SLOW_SHARE = 0.35
"""Part of T^2 v^2 that makes a slow swing: above 1.2 Hz. Sensors are then 0.1 s late, and show half of the swing or
less. In trials with presses, hugs, wind and slack tendons the third of the sensors that swing most stays below
4.3 times the least mean square; swung by hand at 1 to 4 Hz it is 100 to 300 times that."""
ONSET_S = 0.15
"""Time for which sensors swing at least in a robot that is shaken; the rate of a press is known after that time."""
STRAIN_RATE_S = 0.2
"""Time constant of the smoothing of strain before its rate is taken, so that noise of a sample is not taken as
motion."""


class StretchingSensors:
    """The stretching network on several sensors at once, with the state of each sensor."""

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._lstm = model.network.lstm()
        self._curve = model.curve
        self._scaling = model.network.scaling
        self._memory_s = model.network.memory_s
        self._curve_memories = len(model.curve.memory_s)
        self._state = self._lstm.initial_state(sensors)
        self._means = np.zeros((sensors, len(self._memory_s)))
        self.curve_sigma = np.zeros(sensors)
        """(sensors,) the strain sigma due to the coefficients of the rate curve, after the latest step."""

    def step(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], step_s: Floats
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (sensors,) strain and its sigma after one more reading of each sensor; inputs must be finite."""
        means = self._means = next_means(self._means, change, step_s, self._memory_s)
        output, self._state = self._lstm.step(features(change, rate_per_s, step_s, means, self._scaling), self._state)
        on_curve, self.curve_sigma = self._curve.estimate(change, means[:, : self._curve_memories])
        log_variance = np.minimum(np.maximum(output[:, 1], LOG_VARIANCE_RANGE[0]), LOG_VARIANCE_RANGE[1])
        return on_curve + STRAIN_SCALE * output[:, 0], STRAIN_SCALE * np.exp(0.5 * log_variance)

    def settle(self, change: NDArray[np.float64], chosen: NDArray[np.bool_], step_s: float) -> NDArray[np.float64]:
        """Put sensors into the state that they have after a long rest at their dR/R; return their strain in this state.

        Args:
            change: (sensors,) dR/R.
            chosen: (sensors,) which sensors to put into the new state.
            step_s: time step, equal to that of the readings that follow. With another time step a sensor at rest would
                drift by 0.001 of strain in 10 s.
        """
        change = change[chosen]
        state = self._lstm.initial_state(len(change))
        means = np.repeat(change[:, None], len(self._memory_s), axis=1)
        x = features(change, np.zeros(len(change)), step_s, means, self._scaling)
        output = np.zeros((len(change), 2))
        for _ in range(round(SETTLING_S / step_s)):
            output, state = self._lstm.step(x, state)
        self._means[chosen], self._state.h[chosen], self._state.c[chosen] = means, state.h, state.c
        return self._curve.strain(change, means[:, : self._curve_memories]) + STRAIN_SCALE * output[:, 0]


class StrainSpread:
    """The running standard deviation of strain, with the time constant `SPREAD_MEMORY_S`."""

    def __init__(self, sensors: int, initial_spread: float = 0.0) -> None:
        self._mean = np.full(sensors, np.nan)
        self._variance = np.full(sensors, initial_spread**2)

    def step(self, strain: NDArray[np.float64], step_s: Floats) -> NDArray[np.float64]:
        """Return (sensors,) the running standard deviation after one more strain of each sensor."""
        weight = low_pass_weight(step_s, SPREAD_MEMORY_S)
        deviation = strain - self._mean
        deviation = np.where(np.isnan(deviation), 0.0, deviation)
        self._mean = np.where(np.isnan(self._mean), strain, self._mean + weight * deviation)
        self._variance = (1 - weight) * (self._variance + weight * deviation**2)
        return np.asarray(np.sqrt(self._variance))


class Extrapolation:
    """The increase of sigma for inputs outside the range of the training, for each sensor.

    Sigma is multiplied by the ratio of the rate of dR/R to that in training. Two terms are added in quadrature: the
    excess of the strain's rate over that in training times the lag, and the excess of dR/R over its largest value in
    training, converted to strain.
    """

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._ranges = model.ranges
        self._gauge = model.gauge
        self._ratio = np.zeros(sensors)
        self._excess = np.zeros(sensors)
        self._strain_rate = SmoothedRate(sensors, STRAIN_RATE_S)

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start (sensors,) chosen ones anew: what they read before tells no rate of strain."""
        self._strain_rate.restart(chosen)

    def step(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], strain: NDArray[np.float64], step_s: Floats
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return (sensors,) the factor of sigma, the term to add to it, and whether the input is beyond training.

        The factor and the term decay with `EXTRAPOLATION_MEMORY_S` after such an input.
        """
        fade = np.exp(-(step_s / EXTRAPOLATION_MEMORY_S))
        ratio = np.maximum(np.abs(rate_per_s) / self._ranges.rate_per_s - 1, 0)
        self._ratio = np.maximum(ratio, self._ratio * fade)
        strain_rate = self._strain_rate.step(strain, step_s)
        excess = np.maximum(np.abs(strain_rate) - self._ranges.strain_rate_per_s, 0)
        self._excess = np.maximum(excess, self._excess * fade)
        strain_beyond = np.maximum(change - self._ranges.change[1], 0) / self._gauge.slope(strain)
        beyond = (ratio > 0) | (excess > 0) | (strain_beyond > 0)
        return 1 + self._ratio, np.hypot(STRETCHING_LAG_S * self._excess, strain_beyond), beyond


class _HighPass:
    """The mean square of each sensor's strain above a frequency, and the least one so far, which is noise."""

    def __init__(self, sensors: int, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._low = np.full((2, sensors), np.nan)
        self.mean_square = np.zeros(sensors)
        self.least = np.full(sensors, np.inf)

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start the (sensors,) chosen ones anew from their next strain."""
        self._low[:, chosen] = np.nan

    def step(
        self, strain: NDArray[np.float64], mean_weight: NDArray[np.float64], settled: NDArray[np.bool_], step_s: float
    ) -> None:
        """Take one more strain of each sensor, with the weight that it has in the mean.

        Args:
            strain: (sensors,)
            mean_weight: (sensors,) 0 for sensors without a reading.
            settled: (sensors,) whose filters have settled.
            step_s: time step.
        """
        high = strain
        weight = low_pass_weight(step_s, self._time_constant_s)
        for k in range(2):
            low = self._low[k]
            self._low[k] = np.where(np.isnan(low), high, low + weight * (high - low))
            high = high - self._low[k]
        self.mean_square += mean_weight * (high**2 - self.mean_square)
        floor = np.maximum(np.minimum(self.least, self.mean_square), LEAST_SWING**2)
        self.least = np.where(settled, floor, self.least)


class FastSwing:
    """The standard deviation of strain due to swings that are too fast for the sensors.

    What a sensor shows of such a swing is a small part of it, and the smaller part of noise. The swing s of a sensor is
    the mean square of its strain above 3.5 Hz that exceeds four times the least one so far, which is noise. A shaken
    robot moves everywhere: with the mean m of s over the sensors, without the `FAULTY` that swing most,
    sigma^2 = SWING_LOSS^2 (s + m).

    The robot is shaken when more than `FAULTY` sensors swing for certain: by more than noise, and by more than a press
    of their rate leaves above 3.5 Hz, or, of a structure that anchors hold, above the lower frequency of
    `SLOW_SWING_S`: one that rolls swings its sensors as slowly.
    """

    def __init__(self, sensors: int, *, is_held: bool = True) -> None:
        self._is_held = is_held
        self._fast = _HighPass(sensors, SWING_S)
        self._slow = _HighPass(sensors, SLOW_SWING_S)
        self._swing = np.zeros(sensors)
        self._seconds = np.zeros(sensors)
        self._rate = SmoothedRate(sensors, PRESS_RATE_S)
        self._mean_square_rate = np.zeros(sensors)
        self._shaken_s = 0.0
        self._since_shaken_s = np.inf

    def step(
        self, strain: NDArray[np.float64], seen: NDArray[np.bool_], fresh: NDArray[np.bool_], step_s: float
    ) -> NDArray[np.float64]:
        """Return (sensors,) the standard deviation after one more strain of each sensor.

        Args:
            strain: (sensors,)
            seen: (sensors,) which sensors have a reading; the strain of others is held.
            fresh: (sensors,) which have one after a gap; these start anew.
            step_s: time step.
        """
        self._fast.restart(fresh)
        self._slow.restart(fresh)
        self._seconds[fresh] = 0.0
        self._rate.restart(fresh)
        self._mean_square_rate[fresh] = 0.0
        mean_weight = np.where(seen, low_pass_weight(step_s, SWING_MEAN_S), 0.0)
        self._seconds += np.where(seen, step_s, 0.0)
        settled = seen & (self._seconds >= SWING_START_S)
        self._fast.step(strain, mean_weight, settled, step_s)
        self._slow.step(strain, mean_weight, settled, step_s)
        self._mean_square_rate += mean_weight * (self._rate.step(strain, step_s) ** 2 - self._mean_square_rate)
        certain = self._is_certain(self._fast, PRESS_SHARE * SWING_S**2)
        certain |= self._is_held & self._is_certain(self._slow, SLOW_SHARE * SLOW_SWING_S**2)
        certain &= settled
        self._shaken_s = self._shaken_s + step_s if certain.sum() > FAULTY else 0.0
        self._since_shaken_s = 0.0 if self._shaken_s > ONSET_S else self._since_shaken_s + step_s
        excess = np.where(settled, np.maximum(self._fast.mean_square - 4 * self._fast.least, 0), 0.0)
        swing = self._swing = np.maximum(excess, self._swing * np.exp(-(step_s / SWING_MEMORY_S)))
        common = np.sort(swing)[: max(len(swing) - FAULTY, 1)].mean()
        return np.asarray(SWING_LOSS * np.sqrt(swing + common))

    def _is_certain(self, band: _HighPass, press_s2: float) -> NDArray[np.bool_]:
        """Return (sensors,) which swing in a band by more than noise and a press, which leaves press_s2 times v^2."""
        return np.asarray(band.mean_square - press_s2 * self._mean_square_rate > CERTAIN_SWING * band.least)

    @property
    def robot_is_shaken(self) -> bool:
        """Whether the robot is shaken, or was within `SWING_MEMORY_S`; most sensors may show nothing of it."""
        return self._since_shaken_s < SWING_MEMORY_S
