"""The model of one kind of strain sensor: network, curves, odds of the modes, and the ranges of its training."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.tables import Positive, PositiveOrInfinite
from .bending import BendingCurve
from .gauge import StaticGauge
from .lstm import Lstm, LstmWeights, Scaling, run_lstm
from .rate_curve import RateCurve

GOLDEN_TOLERANCE = 1e-6
"""Largest difference from the golden vector, in units of the network's outputs."""
LEAST_SPREAD = 0.002
"""Spread of strain, that of a strip which hardly moves, below which sigma does not decrease further."""


@dataclass(frozen=True, slots=True, eq=False)
class GoldenVector:
    """An input of the network and the output for it after training; weights from a damaged file give another output."""

    input: NDArray[np.float64]
    """(steps, features)"""
    output: NDArray[np.float64]
    """(steps, 2)"""


@dataclass(frozen=True, slots=True, eq=False)
class StretchingNetwork:
    """The LSTM of eqs. (10)-(15) with the scales of its inputs.

    Raises:
        InputError: for weights that do not fit together, or do not reproduce the golden vector.
    """

    weights: LstmWeights
    scaling: Scaling
    memory_s: NDArray[np.float64]
    """(memories,) time constants of the running means among its inputs."""
    golden: GoldenVector

    def __post_init__(self) -> None:
        try:
            output = run_lstm(self.lstm(), self.golden.input)
        except ValueError as error:
            raise InputError(f"its weights do not fit together ({error})") from error
        difference = float(np.abs(output - self.golden.output).max())
        if not difference < GOLDEN_TOLERANCE:
            raise InputError(f"its golden vector is off by {difference:.2g}: expected less than {GOLDEN_TOLERANCE:g}")

    def lstm(self) -> Lstm:
        """Return the network in the form that can be evaluated."""
        return Lstm(self.weights)


@dataclass(frozen=True, slots=True, eq=False)
class BendingCoefficients:
    """The polynomial of eq. (9), fitted to recordings."""

    coefficients: NDArray[np.float64]
    """(6,) coefficients of dR/R as a polynomial of strain, highest power first."""
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the coefficients."""


@dataclass(frozen=True, slots=True, eq=False)
class ModeOdds:
    """The log likelihood ratio of the modes for a reading: log of p(dR/R | bending) / p(dR/R | stretching)."""

    change: NDArray[np.float64]
    """(bins,) increasing dR/R, corrected for lag by `LagFree`."""
    log_odds: NDArray[np.float64]
    """(bins,) log likelihood ratio at these dR/R."""

    def at(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log likelihood ratio at a dR/R; outside of the bins that of the nearest bin."""
        return np.interp(change, self.change, self.log_odds)


@dataclass(frozen=True, slots=True)
class SigmaScale:
    """The factor b s^p of the network's sigma, where s is the recent spread of strain, see `StrainSpread`.

    The network underestimates its error the more, the more a strip has been moved in the recent past.
    """

    factor: float = 1.0
    """b in b s^p."""
    power: float = 0.0
    """p in b s^p."""

    def at(self, strain_spread: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the scale at a spread of strain."""
        return np.asarray(self.factor * np.maximum(strain_spread, LEAST_SPREAD) ** self.power)


@dataclass(frozen=True, slots=True)
class TrainedRanges:
    """The ranges of the training data; outside of those of dR/R and rates sigma grows and readings are flagged."""

    change: tuple[float, float]
    """Least and largest dR/R."""
    rate_per_s: Positive
    """Rate of dR/R, which 99.9 % of the training samples do not exceed."""
    strain: tuple[float, float]
    """Zero and the largest strain."""
    step_s: tuple[float, float]
    """Shortest and longest time step; frames at other rates are refused."""
    strain_rate_per_s: PositiveOrInfinite = float("inf")
    """Rate of strain, which 99.9 % of the stretched training samples do not exceed."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """How a model was made, for the reader of its model card; no estimate depends on it."""

    recipe: Mapping[str, Any]
    """The settings of the training."""
    trained_on: tuple[str, ...]
    """Names of the recordings in the training."""
    split: str = ""
    """Description of the recordings that were held out."""
    held_out: Mapping[str, Any] = field(default_factory=dict)
    """Scores of the model on each recording that was held out."""
    baselines: Mapping[str, Any] = field(default_factory=dict)
    """Scores of the estimators that the network is compared with, by estimator and recording."""
    data_sha256: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of every file of recordings."""
    command: str = ""
    """The command that makes the same model again."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the packages with which the model was made."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """A sensor model, as `calibrate` makes it and the model file stores it.

    Raises:
        InputError: for a curve whose parts do not fit together, or a bending curve that does not rise.
    """

    network: StretchingNetwork
    curve: RateCurve
    """The curve that the network corrects. Its static gauge curve contains the spread of gain and offset for taring."""
    mode_odds: ModeOdds
    bending: BendingCoefficients | None
    """None when no strip was bent in the recordings; then the paper's eq. (9) is used."""
    ranges: TrainedRanges
    provenance: Provenance
    sigma_scale: SigmaScale = SigmaScale()
    lag_s: float = 0.0
    """Time by which the estimated strain lags behind the true one."""
    unified: bool = False
    """Whether the network estimates the strain of bent tendons, too."""

    def __post_init__(self) -> None:
        change = np.zeros(1)
        try:
            means = np.zeros((1, len(self.curve.memory_s)))
            self.curve.estimate(change, means)
        except ValueError as error:
            raise InputError(f"its curve's parts do not fit together ({error})") from error
        self.bending_curve("strain")

    def check_rate(self, rate_hz: float) -> None:
        """Check that the network was trained at time steps like those of frames at a rate.

        Raises:
            InputError: when it was not: at 2 Hz, for one, lengths would be wrong by several sigmas.
        """
        shortest_s, longest_s = self.ranges.step_s
        if not shortest_s <= 1 / rate_hz <= longest_s:
            raise InputError(
                f"frames.rate_hz: expected {1 / longest_s:.3g} to {1 / shortest_s:.3g}, at which the sensor model was "
                f"trained, got {rate_hz:g}"
            )

    @property
    def gauge(self) -> StaticGauge:
        """The static gauge curve, with the spread of gain and offset over sensors."""
        return self.curve.gauge

    def bending_curve(self, abscissa: Literal["strain", "resistance"]) -> BendingCurve:
        """Return the curve of bent tendons: that fitted to recordings with x = strain, or the paper's eq. (9).

        The paper's is used when no strip was bent in the recordings, or when x is resistance.
        """
        if abscissa == "strain" and self.bending is not None:
            return BendingCurve("strain", self.bending.coefficients)
        return BendingCurve(abscissa)
