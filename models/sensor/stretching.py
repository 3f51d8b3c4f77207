"""The stretching network running on several sensors at once, and the corrections of its sigma."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.time_series import SmoothedRate, low_pass_weight, low_passed, start_or_first, value_before
from .lstm import LOG_VARIANCE_RANGE, STRAIN_SCALE, features, running_means
from .sensor_model import SensorModel

SPREAD_MEMORY_S = 30.0
"""Time constant of the running mean and variance of strain in `StrainSpread`."""
MOTION_SHARE = 0.06
"""Standard deviation of the model's error at one and the same strain, which taring cannot take off, over that of strain
in the last half minute. In the 18 recordings of irregular motion in calibration it is 0.03 to 0.10, 0.058 in the
median."""
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
NOISE_MEAN_S = 2.0
"""Time over which the mean square of strain is averaged once more, as noise. The network colours noise, so that
averages over `SWING_MEAN_S` scatter: the least of them in 20 s is 0.3 of the mean, and of those over 2 s it is 0.7."""
NOISE_SHARE = 0.4
"""Share of this average that has been read before it tells the noise: one second of readings."""
LEAST_SWING = 2.8e-4
"""Least noise of strain above 3.5 Hz, for a sensor whose code stands still."""
FAULTY = 2
"""Number of sensors that may have a fault at the same time, and swing without the robot."""
USUAL_NOISE = (5e-4, 9e-4)
"""Largest root mean square of noise above 3.5 and 1.2 Hz of strips like those of the calibration."""
UNEVEN = 3.0
"""Factor of the noise beyond that. The network was not trained with it, and answers unevenly: with one code of noise,
the third of 24 sensors at rest has up to nine times the least mean square."""
LARGE_SWING = 2.0
"""Ratio of the mean square of strain above 3.5 Hz to that of noise, above which the rest of it is a swing."""
CERTAIN_SWING = 3.0
"""The same ratio, above which a sensor swings for certain. While a robot is pressed, that of the third of 24 sensors
stays below 1.9, and below 3.2 with an ADC whose noise is a whole code; while it is shaken it is 50 to 5000."""
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
2.2 times the noise; swung by hand at 1 to 4 Hz it is some 40 to 130 times that."""
ONSET_S = 0.15
"""Time for which sensors swing at least in a robot that is shaken; the rate of a press is known after that time."""
STRAIN_RATE_S = 0.2
"""Time constant of the smoothing of strain before its rate is taken, so that noise of a sample is not taken as
motion."""


@dataclass(frozen=True, slots=True, eq=False)
class StretchedStrain:
    """The strain of stretched sensors by the network and the rate curve that it corrects."""

    strain: NDArray[np.float64]
    """(samples, sensors)"""
    sigma: NDArray[np.float64]
    """(samples, sensors) the network's."""
    curve_sigma: NDArray[np.float64]
    """(samples, sensors) the sigma due to the coefficients of the rate curve."""


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

    def run(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], step_s: NDArray[np.float64]
    ) -> StretchedStrain:
        """Return the strain after each of some more readings; inputs must be finite.

        Args:
            change: (samples, sensors) dR/R.
            rate_per_s: (samples, sensors) its rate.
            step_s: (samples, sensors), or (samples, 1) for all, the time before each reading.
        """
        means = running_means(change, step_s, self._memory_s, self._means)
        x = features(change, rate_per_s, step_s, means, self._scaling)
        output, self._state = self._lstm.run(x, self._state)
        self._means = means[-1].copy()
        on_curve, curve_sigma = self._curve.estimate(change, means[..., : self._curve_memories])
        log_variance = np.minimum(np.maximum(output[..., 1], LOG_VARIANCE_RANGE[0]), LOG_VARIANCE_RANGE[1])
        strain = on_curve + STRAIN_SCALE * output[..., 0]
        return StretchedStrain(strain, STRAIN_SCALE * np.exp(0.5 * log_variance), curve_sigma)

    def settle(self, change: NDArray[np.float64], chosen: NDArray[np.bool_], step_s: float) -> None:
        """Put sensors into the state that they have after a long rest at their dR/R.

        Args:
            change: (sensors,) dR/R.
            chosen: (sensors,) which sensors to put into the new state.
            step_s: time step, equal to that of the readings that follow. With another time step a sensor at rest would
                drift by 0.001 of strain in 10 s.
        """
        change = change[chosen]
        means = np.repeat(change[:, None], len(self._memory_s), axis=1)
        x = features(change, np.zeros(len(change)), step_s, means, self._scaling)
        steps = np.broadcast_to(x, (round(SETTLING_S / step_s), *x.shape))
        _, state = self._lstm.run(steps, self._lstm.initial_state(len(change)))
        self._means[chosen], self._state.h[chosen], self._state.c[chosen] = means, state.h, state.c


class StrainSpread:
    """The running standard deviation of strain, with the time constant `SPREAD_MEMORY_S`."""

    def __init__(self, sensors: int) -> None:
        self._mean = np.full(sensors, np.nan)
        self._variance = np.zeros(sensors)

    @property
    def value(self) -> NDArray[np.float64]:
        """(sensors,) the running standard deviation after the latest sample."""
        return np.asarray(np.sqrt(self._variance))

    def run(self, strain: NDArray[np.float64], step_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (samples, sensors) running standard deviations after more samples, of (samples, sensors) strain."""
        weight = low_pass_weight(step_s, SPREAD_MEMORY_S)
        start = start_or_first(self._mean, strain)
        mean = low_passed(strain, weight, start)
        added = weight * (strain - value_before(mean, start)) ** 2
        variance = np.empty_like(strain)
        for k in range(len(strain)):
            variance[k] = self._variance = (1 - weight[k]) * (self._variance + added[k])
        self._mean = mean[-1]
        return np.sqrt(variance)


@dataclass(frozen=True, slots=True, eq=False)
class SigmaGrowth:
    """How sigma grows for inputs beyond those of the training, (samples, sensors) each."""

    factor: NDArray[np.float64]
    """By which sigma is multiplied."""
    added: NDArray[np.float64]
    """What is added to it in quadrature."""
    is_beyond: NDArray[np.bool_]
    """Whether the input is beyond those of the training."""


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

    def run(
        self,
        change: NDArray[np.float64],
        rate_per_s: NDArray[np.float64],
        strain: NDArray[np.float64],
        step_s: NDArray[np.float64],
    ) -> SigmaGrowth:
        """Return the increase of sigma, which decays with `EXTRAPOLATION_MEMORY_S` after an input beyond training.

        Arguments are (samples, sensors); the time step may be (samples, 1) for all.
        """
        fade = np.exp(-(step_s / EXTRAPOLATION_MEMORY_S))
        ratio = np.maximum(np.abs(rate_per_s) / self._ranges.rate_per_s - 1, 0)
        excess = np.maximum(np.abs(self._strain_rate.run(strain, step_s)) - self._ranges.strain_rate_per_s, 0)
        faded_ratio = _fading(ratio, fade, self._ratio)
        faded_excess = _fading(excess, fade, self._excess)
        self._ratio, self._excess = faded_ratio[-1], faded_excess[-1]
        strain_beyond = np.maximum(change - self._ranges.change[1], 0) / self._gauge.slope(strain)
        beyond = (ratio > 0) | (excess > 0) | (strain_beyond > 0)
        return SigmaGrowth(1 + faded_ratio, np.hypot(STRETCHING_LAG_S * faded_excess, strain_beyond), beyond)


def _fading(value: NDArray[np.float64], fade: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (samples, sensors) values, or what is left of a larger one before: m = max(y, m fade)."""
    faded = np.empty_like(value)
    m = start
    for k in range(len(value)):
        faded[k] = m = np.maximum(value[k], m * fade[k])
    return faded


class FastSwing:
    """The standard deviation of strain due to swings that are too fast for the sensors.

    What a sensor shows of such a swing is a small part of it, and the smaller part of noise. The swing s of a sensor is
    the mean square of its strain above 3.5 Hz that exceeds `LARGE_SWING` times that of noise, which is the least
    average over `NOISE_MEAN_S` so far. A shaken robot moves everywhere: with the mean m of s over the sensors, without
    the `FAULTY` that swing most, sigma^2 = SWING_LOSS^2 (s + m).

    The robot is shaken when more than `FAULTY` sensors swing for certain: by more than noise, and by more than a press
    of their rate leaves above 3.5 Hz, or, of a structure that anchors hold, above the lower frequency of
    `SLOW_SWING_S`: one that rolls swings its sensors as slowly.
    """

    def __init__(self, sensors: int, *, is_held: bool = True) -> None:
        self._bands_s = np.array([SWING_S, SLOW_SWING_S] if is_held else [SWING_S])
        shares = np.array([PRESS_SHARE, SLOW_SHARE])[: len(self._bands_s)]
        self._usual_noise = np.array(USUAL_NOISE)[: len(self._bands_s), None] ** 2
        self._press_s2 = (shares * self._bands_s**2)[:, None]
        self._low = np.full((2, len(self._bands_s), sensors), np.nan)  # of the two stages of each band's high-pass
        self._rate = SmoothedRate(sensors, PRESS_RATE_S)
        self._mean_square = np.zeros((len(self._bands_s) + 1, sensors))  # of each band, and of the rate
        self._mean_noise = np.zeros((len(self._bands_s), sensors))
        self._noise_share = np.zeros(sensors)
        self._least = np.full((len(self._bands_s), sensors), np.inf)
        self._swing = np.zeros(sensors)
        self._seconds = np.zeros(sensors)
        self._shaken_s = 0.0
        self._since_shaken_s = np.inf

    def restart(self, chosen: NDArray[np.bool_]) -> None:
        """Start the (sensors,) chosen ones anew: they have their first reading after a gap."""
        self._low[..., chosen] = np.nan
        self._rate.restart(chosen)
        self._mean_square[-1, chosen] = 0.0
        self._seconds[chosen] = 0.0

    def run(
        self, strain: NDArray[np.float64], seen: NDArray[np.bool_], step_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return (samples, sensors) the deviation after more samples, and (samples,) whether the robot is shaken.

        It is shaken, or was within `SWING_MEMORY_S`; most sensors may show nothing of it.

        Args:
            strain: (samples, sensors)
            seen: (samples, sensors) which sensors have a reading; the strain of others is held.
            step_s: (samples, 1) the time before each sample.
        """
        seconds = np.where(seen, step_s, 0.0)
        seconds[0] += self._seconds
        seconds = np.cumsum(seconds, axis=0)
        settled = seen & (seconds >= SWING_START_S)
        mean_square = self._mean_squares(strain, seen, step_s)
        swings, squared_rate = mean_square[:, :-1], mean_square[:, -1:]
        noise = self._noise_of(swings, settled, step_s)
        certain = (swings - self._press_s2 * squared_rate > CERTAIN_SWING * noise).any(axis=1) & settled
        excess = np.where(settled, np.maximum(swings[:, 0] - LARGE_SWING * noise[:, 0], 0), 0.0)
        swing = _fading(excess, np.exp(-(step_s / SWING_MEMORY_S)), self._swing)
        self._seconds, self._mean_square, self._swing = seconds[-1], mean_square[-1], swing[-1]
        others = max(swing.shape[-1] - FAULTY, 1)
        common = np.sort(swing)[:, :others].sum(axis=-1, keepdims=True) / others
        return SWING_LOSS * np.sqrt(swing + common), self._shaken(certain.sum(axis=-1) > FAULTY, step_s[:, 0])

    def _mean_squares(
        self, strain: NDArray[np.float64], seen: NDArray[np.bool_], step_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (samples, bands + 1, sensors) the mean square of strain above each frequency, and of its rate."""
        high = strain[:, None]
        weight = low_pass_weight(step_s[..., None], self._bands_s[:, None])
        for stage in range(2):
            low = low_passed(high, weight, start_or_first(self._low[stage], high))
            self._low[stage] = low[-1]
            high = high - low
        squared = np.concatenate([high, self._rate.run(strain, step_s)[:, None]], axis=1) ** 2
        mean_weight = np.where(seen, low_pass_weight(step_s, SWING_MEAN_S), 0.0)
        return low_passed(squared, mean_weight[:, None], self._mean_square)

    def _noise_of(
        self, swings: NDArray[np.float64], settled: NDArray[np.bool_], step_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (samples, bands, sensors) the mean square that is noise; inf until it is known.

        Args:
            swings: (samples, bands, sensors) the mean square of strain above each frequency.
            settled: (samples, sensors) which sensors tell it.
            step_s: (samples, 1) the time before each sample.
        """
        weight = np.where(settled, low_pass_weight(step_s, NOISE_MEAN_S), 0.0)
        mean = low_passed(swings, weight[:, None], self._mean_noise)
        share = low_passed(np.ones_like(weight), weight, self._noise_share)
        self._mean_noise, self._noise_share = mean[-1], share[-1]
        share = share[:, None]
        known = np.maximum(mean / np.maximum(share, NOISE_SHARE), LEAST_SWING**2)
        least = np.where(share >= NOISE_SHARE, known, np.inf)
        least[0] = np.minimum(least[0], self._least)
        least = np.minimum.accumulate(least, axis=0)
        self._least = least[-1]
        return np.asarray(least + UNEVEN * np.maximum(least - self._usual_noise, 0.0))

    def _shaken(self, swings: NDArray[np.bool_], step_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (samples,) whether the robot is shaken, from (samples,) whether sensors swing for certain."""
        shaken = []
        for certain, step in zip(swings.tolist(), step_s.tolist(), strict=True):
            self._shaken_s = self._shaken_s + step if certain else 0.0
            self._since_shaken_s = 0.0 if self._shaken_s > ONSET_S else self._since_shaken_s + step
            shaken.append(self._since_shaken_s < SWING_MEMORY_S)
        return np.array(shaken)
