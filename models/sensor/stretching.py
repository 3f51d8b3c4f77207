"""The stretching network at work on several sensors at once, and how far it is to be believed."""

import numpy as np
from numpy.typing import NDArray

from ..values.low_pass import low_pass_weight, smoothed_rate
from .lstm import LOG_VARIANCE_RANGE, STRAIN_SCALE, LstmState, features, next_means
from .sensor_model import SensorModel

Step = float | NDArray[np.float64]
"""A time step in seconds: one for all sensors, or one for each."""
SPREAD_MEMORY_S = 30.0
SETTLING_S = 10.0
"""How long a strip's past motion matters: relaxation takes seconds, hysteresis until it is wiped out."""
EXTRAPOLATION_MEMORY_S = 3.0
"""How long a motion faster than any in training spoils the estimate: the correlation time of the network's error."""
STRETCHING_LAG_S = 0.4
"""Lag of a sensor that the network knows nothing of: the paper's 926 ms to 90 %, over ln 10."""
STRAIN_RATE_S = 0.2
"""Memory of the strain's rate: a sample's noise is no motion."""


class StretchingSensors:
    """The stretching network running on several sensors at once, with their states."""

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._lstm = model.network.lstm()
        self._curve = model.curve
        self._scaling = model.network.scaling
        self._memory_s = model.network.memory_s
        self._curve_memories = len(model.curve.memory_s)
        self._state = self._lstm.initial_state(sensors)
        self._means = np.zeros((sensors, len(self._memory_s)))

    def step(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], step_s: Step
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (sensors,) strain and its sigma after one more reading; inputs must be finite."""
        self._means = next_means(self._means, change, step_s, self._memory_s)
        strain, sigma, self._state = self._evaluate(change, rate_per_s, step_s, self._means, self._state)
        return strain, sigma

    def curve_sigma(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (sensors,) what the curve leaves unknown of strain, after the latest step."""
        return self._curve.sigma(change, self._means[:, : self._curve_memories])

    def settle(self, change: NDArray[np.float64], which: NDArray[np.bool_], step_s: float) -> NDArray[np.float64]:
        """Put some sensors into the state of having rested at a dR/R for long; return the strain they then give.

        In steps as long as those to come: settled in others, a sensor at rest would drift by 0.001 of strain in 10 s.
        """
        state = self._lstm.initial_state(len(change))
        still = np.zeros(len(change))
        strain = np.zeros(len(change))
        means = np.repeat(change[:, None], len(self._memory_s), axis=1)
        for _ in range(round(SETTLING_S / step_s)):
            strain, _, state = self._evaluate(change, still, step_s, means, state)
        keep = which[:, None]
        self._means = np.where(keep, means, self._means)
        self._state = LstmState(np.where(keep, state.h, self._state.h), np.where(keep, state.c, self._state.c))
        return strain

    def _evaluate(
        self,
        change: NDArray[np.float64],
        rate_per_s: NDArray[np.float64],
        step_s: Step,
        means: NDArray[np.float64],
        state: LstmState,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], LstmState]:
        output, state = self._lstm.step(features(change, rate_per_s, step_s, means, self._scaling), state)
        strain = self._curve.strain(change, means[:, : self._curve_memories]) + STRAIN_SCALE * output[:, 0]
        sigma = STRAIN_SCALE * np.exp(0.5 * np.clip(output[:, 1], *LOG_VARIANCE_RANGE))
        return strain, sigma, state


class StrainSpread:
    """The running standard deviation of strain, forgetting with `SPREAD_MEMORY_S`."""

    def __init__(self, sensors: int, initial_spread: float = 0.0) -> None:
        self._mean = np.full(sensors, np.nan)
        self._variance = np.full(sensors, initial_spread**2)

    def step(self, strain: NDArray[np.float64], step_s: Step) -> NDArray[np.float64]:
        """Return (sensors,) the spread after one more strain."""
        weight = low_pass_weight(step_s, SPREAD_MEMORY_S)
        away = np.nan_to_num(strain - self._mean)
        self._mean = np.where(np.isnan(self._mean), strain, self._mean + weight * away)
        self._variance = (1 - weight) * (self._variance + weight * away**2)
        return np.asarray(np.sqrt(self._variance))


class Extrapolation:
    """How far beyond its training the network is asked, sensor by sensor.

    Sigma is multiplied by how much faster dR/R changes than in training, and added to it are the lag times what the
    strain's rate exceeds that of the training by, and the distance beyond the largest dR/R.
    """

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._ranges = model.ranges
        self._gauge = model.gauge
        self._ratio = np.zeros(sensors)
        self._excess = np.zeros(sensors)
        self._smooth: NDArray[np.float64] | None = None

    def step(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], strain: NDArray[np.float64], step_s: Step
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return by what to multiply sigma, what to add to it in quadrature, and whether this is beyond training."""
        fade = np.exp(-np.asarray(step_s) / EXTRAPOLATION_MEMORY_S)
        ratio = np.maximum(np.abs(rate_per_s) / self._ranges.rate_per_s - 1, 0)
        self._ratio = np.maximum(ratio, self._ratio * fade)
        smooth = strain if self._smooth is None else self._smooth
        strain_rate = smoothed_rate(strain, smooth, step_s, STRAIN_RATE_S)
        self._smooth = smooth + strain_rate * step_s
        excess = np.maximum(np.abs(strain_rate) - self._ranges.strain_rate_per_s, 0)
        self._excess = np.maximum(excess, self._excess * fade)
        farther = np.maximum(change - self._ranges.change[1], 0) / self._gauge.slope(strain)
        beyond = (ratio > 0) | (excess > 0) | (farther > 0)
        return 1 + self._ratio, np.hypot(STRETCHING_LAG_S * self._excess, farther), beyond
