"""All that is known of the strain sensors as a kind: curves, stretching network, spread, ranges."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from .bending import BendingCurve
from .gauge import StaticGauge
from .lstm import LOG_VARIANCE_RANGE, STRAIN_SCALE, Lstm, LstmState, Scaling, features, next_means
from .rate_curve import RateCurve

Step = float | NDArray[np.float64]
"""A time step in seconds: one for all sensors, or one for each."""
FORMAT = 2
SPREAD_MEMORY_S = 30.0
SETTLING_S = 10.0
"""How long a strip's past motion matters: relaxation takes seconds, hysteresis until it is wiped out."""
LEAST_SPREAD = 0.002
"""Strain spread of a strip that hardly moves; sigma shrinks no further."""
LSTM_TENSORS = ("weight_ih", "weight_hh", "bias", "head_weight", "head_bias")
CURVE_TENSORS = ("curve_scale", "curve_range", "curve_coefficients", "curve_factor")


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """A trained sensor model, as in the model file.

    Raises:
        InputError: for weights that do not fit together, are not finite, or do not reproduce the golden vector.
    """

    tensors: Mapping[str, NDArray[np.float64]]
    """`LSTM_TENSORS`, the curves of `gauge`, `curve` and `mode_log_odds`, a golden input (steps, inputs), its output
    (steps, 2); where recordings bend, `bending` (6,) and `bending_covariance` (6, 6), eq. (9) fitted anew."""
    metadata: Mapping[str, Any]
    """Units, ranges, spread, recipe and scores: see `calibration.calibrate_model`."""

    def __post_init__(self) -> None:
        if self.metadata.get("format") != FORMAT:
            raise InputError(f"sensor model: expected format {FORMAT}, got {self.metadata.get('format')}")
        curves = ("strain_knots", "change_knots", "mode_change", "mode_log_odds")
        for name in (*LSTM_TENSORS, *CURVE_TENSORS, *curves, "golden_input", "golden_output"):
            if name not in self.tensors:
                raise InputError(f"sensor model: tensor '{name}' is missing")
            if not np.isfinite(self.tensors[name]).all():
                raise InputError(f"sensor model: tensor '{name}' has values that are not finite")
        try:
            output = run_lstm(self.lstm, self.tensors["golden_input"])
            nothing = np.zeros(1), np.zeros((1, len(self.curve.memory_s)))
            self.curve.strain(*nothing), self.curve.sigma(*nothing)
        except ValueError as error:
            raise InputError(f"sensor model: its weights do not fit together ({error})") from error
        difference = float(np.abs(output - self.tensors["golden_output"]).max())
        if not difference < 1e-6:
            raise InputError(f"sensor model: its golden vector is off by {difference:.2g}: expected less than 1e-6")

    @property
    def lstm(self) -> Lstm:
        """The stretching network."""
        return Lstm(*(self.tensors[name].astype(np.float64) for name in LSTM_TENSORS))

    @property
    def curve(self) -> RateCurve:
        """What the network corrects."""
        scale, *rest = (self.tensors[name].astype(np.float64) for name in CURVE_TENSORS)
        return RateCurve(self.gauge, self.memory_s[: len(scale) - 1], scale, *rest)

    @property
    def gauge(self) -> StaticGauge:
        """The static curve, by which strips differ."""
        spread = self.metadata["spread"]
        return StaticGauge(
            self.tensors["strain_knots"].astype(np.float64),
            self.tensors["change_knots"].astype(np.float64),
            float(spread["gain_sigma"]),
            float(spread["offset_sigma"]),
        )

    @property
    def scaling(self) -> Scaling:
        """How the network's inputs are scaled."""
        return Scaling(**self.metadata.get("scaling", {}))

    @property
    def lag_s(self) -> float:
        """By how much the strain that it gives lags behind."""
        return float(self.metadata.get("lag_s", 0.0))

    @property
    def memory_s(self) -> NDArray[np.float64]:
        """Time constants of the running means among the network's inputs."""
        return np.array(self.metadata["memory_s"], dtype=np.float64)

    @property
    def unified(self) -> bool:
        """Whether the network measures bent tendons, too."""
        return bool(self.metadata.get("unified", False))

    def bending_curve(self, abscissa: Literal["strain", "resistance"]) -> BendingCurve:
        """Return the curve of bent tendons: the recordings' own where they bend, else the paper's eq. (9)."""
        if abscissa == "strain" and "bending" in self.tensors:
            return BendingCurve("strain", self.tensors["bending"])
        return BendingCurve(abscissa)

    @property
    def max_change(self) -> float:
        """Largest dR/R in training."""
        return float(self.metadata["ranges"]["change"][1])

    @property
    def max_rate_per_s(self) -> float:
        """The rate of dR/R that 99.9 % of the training stays under."""
        return float(self.metadata["ranges"]["rate_per_s"])

    @property
    def max_strain_rate_per_s(self) -> float:
        """The rate of strain that 99.9 % of the stretching in training stays under."""
        return float(self.metadata["ranges"].get("strain_rate_per_s", np.inf))

    def mode_log_odds(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return log p(dR/R | bending) / p(dR/R | stretching), dR/R as `LagFree` gives it; see `mode.fit_mode`."""
        return np.interp(change, self.tensors["mode_change"], self.tensors["mode_log_odds"])

    def sigma_scale(self, strain_spread: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by what to multiply the network's sigma, after the strain's spread over the last while.

        The error that the network does not know of grows with how much a strip has been moved lately.
        """
        factor, power = self.metadata["sigma_scale"]
        return np.asarray(factor * np.maximum(strain_spread, LEAST_SPREAD) ** power)


class StrainSpread:
    """The running standard deviation of strain, forgetting with `SPREAD_MEMORY_S`."""

    def __init__(self, sensors: int, initial_spread: float = 0.0) -> None:
        self._mean = np.full(sensors, np.nan)
        self._variance = np.full(sensors, initial_spread**2)

    def step(self, strain: NDArray[np.float64], step_s: Step) -> NDArray[np.float64]:
        """Return (sensors,) the spread after one more strain."""
        weight = 1 - np.exp(-step_s / SPREAD_MEMORY_S)
        away = np.nan_to_num(strain - self._mean)
        self._mean = np.where(np.isnan(self._mean), strain, self._mean + weight * away)
        self._variance = (1 - weight) * (self._variance + weight * away**2)
        return np.asarray(np.sqrt(self._variance))


EXTRAPOLATION_MEMORY_S = 3.0
"""How long a motion faster than any in training spoils the estimate: the correlation time of the network's error."""
LAG_S = 0.4
"""Lag of a sensor that the network knows nothing of: the paper's 926 ms to 90 %, over ln 10."""
STRAIN_RATE_S = 0.2
"""Memory of the strain's rate: a sample's noise is no motion."""


class Extrapolation:
    """How far beyond its training the network is asked, sensor by sensor.

    Sigma is multiplied by how much faster dR/R changes than in training, and added to it are the lag times what the
    strain's rate exceeds that of the training by, and the distance beyond the largest dR/R.
    """

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._max_rate_per_s, self._max_change, self._gauge = model.max_rate_per_s, model.max_change, model.gauge
        self._max_strain_rate_per_s = model.max_strain_rate_per_s
        self._ratio, self._excess = np.zeros(sensors), np.zeros(sensors)
        self._smooth: NDArray[np.float64] | None = None

    def step(
        self, change: NDArray[np.float64], rate_per_s: NDArray[np.float64], strain: NDArray[np.float64], step_s: Step
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return by what to multiply sigma, what to add to it in quadrature, and whether this is beyond training."""
        fade = np.exp(-np.asarray(step_s) / EXTRAPOLATION_MEMORY_S)
        ratio = np.maximum(np.abs(rate_per_s) / self._max_rate_per_s - 1, 0)
        self._ratio = np.maximum(ratio, self._ratio * fade)
        smooth = strain if self._smooth is None else self._smooth
        strain_rate = (strain - smooth) * (1 - np.exp(-np.asarray(step_s) / STRAIN_RATE_S)) / step_s
        self._smooth = smooth + strain_rate * step_s
        excess = np.maximum(np.abs(strain_rate) - self._max_strain_rate_per_s, 0)
        self._excess = np.maximum(excess, self._excess * fade)
        farther = np.maximum(change - self._max_change, 0) / self._gauge.slope(strain)
        beyond = (ratio > 0) | (excess > 0) | (farther > 0)
        return 1 + self._ratio, np.hypot(LAG_S * self._excess, farther), beyond


def run_lstm(lstm: Lstm, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (steps, 2) outputs for one sensor's (steps, features) inputs, from a fresh state."""
    state, outputs = lstm.initial_state(1), []
    for row in x:
        output, state = lstm.step(row[None], state)
        outputs.append(output[0])
    return np.array(outputs)


class StretchingSensors:
    """The stretching network running on several sensors at once, with their states."""

    def __init__(self, model: SensorModel, sensors: int) -> None:
        self._lstm, self._curve, self._scaling = model.lstm, model.curve, model.scaling
        self._memory_s, self._curve_memories = model.memory_s, len(self._curve.memory_s)
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
        state, still, strain = self._lstm.initial_state(len(change)), np.zeros(len(change)), np.zeros(len(change))
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
