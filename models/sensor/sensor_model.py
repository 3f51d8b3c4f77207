"""All that is known of the strain sensors as a kind: network, curves, modes, ranges."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from .bending import BendingCurve
from .gauge import StaticGauge
from .lstm import Lstm, LstmWeights, Scaling, run_lstm
from .rate_curve import RateCurve

GOLDEN_TOLERANCE = 1e-6
LEAST_SPREAD = 0.002
"""Strain spread of a strip that hardly moves; sigma shrinks no further."""


@dataclass(frozen=True, slots=True, eq=False)
class GoldenVector:
    """An input of the network and the output that it gave when it was made: a file that is damaged gives another."""

    input: NDArray[np.float64]
    """(steps, features)"""
    output: NDArray[np.float64]
    """(steps, 2)"""


@dataclass(frozen=True, slots=True, eq=False)
class StretchingNetwork:
    """The LSTM of eqs. (10)-(15) with what scales its inputs.

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
        """Return the network, ready to run."""
        return Lstm(self.weights)


@dataclass(frozen=True, slots=True, eq=False)
class BendingCoefficients:
    """Eq. (9) as the recordings have it."""

    coefficients: NDArray[np.float64]
    """(6,) highest power first, of dR/R."""
    covariance: NDArray[np.float64]
    """(6, 6) of these."""


@dataclass(frozen=True, slots=True, eq=False)
class ModeOdds:
    """What a reading says of the mode: log p(dR/R | bending) / p(dR/R | stretching)."""

    change: NDArray[np.float64]
    """(bins,) dR/R as `LagFree` gives it, rising."""
    log_odds: NDArray[np.float64]
    """(bins,)"""

    def at(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log odds at a dR/R; beyond the bins the outermost holds."""
        return np.interp(change, self.change, self.log_odds)


@dataclass(frozen=True, slots=True)
class SigmaScale:
    """By what to multiply the network's sigma: b s^p, s being the strain's spread over the last while.

    The error that the network does not know of grows with how much a strip has been moved lately.
    """

    factor: float = 1.0
    """b"""
    power: float = 0.0
    """p"""

    def at(self, strain_spread: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the scale at a spread of strain."""
        return np.asarray(self.factor * np.maximum(strain_spread, LEAST_SPREAD) ** self.power)


@dataclass(frozen=True, slots=True)
class TrainedRanges:
    """Where the training reached; beyond, sigma grows and readings are flagged."""

    change: tuple[float, float]
    """Least and largest dR/R."""
    rate_per_s: float
    """The rate of dR/R that 99.9 % of the training stays under."""
    strain: tuple[float, float]
    """Least and largest strain."""
    step_s: tuple[float, float]
    """Shortest and longest time step."""
    strain_rate_per_s: float = float("inf")
    """The rate of strain that 99.9 % of the stretching stays under."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """How a model was made: for people and for its card; no estimate depends on it."""

    recipe: Mapping[str, Any]
    """The settings of the training."""
    trained_on: tuple[str, ...]
    """Names of the recordings."""
    split: str = ""
    """Which recordings were held out, in words."""
    held_out: Mapping[str, Any] = field(default_factory=dict)
    """Scores of the network, by recording held out."""
    baselines: Mapping[str, Any] = field(default_factory=dict)
    """Scores of what it is compared with, by estimator and recording."""
    data_sha256: Mapping[str, str] = field(default_factory=dict)
    """Of every file of recordings."""
    command: str = ""
    """That makes the same model again."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Of the packages that made it."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """A sensor model, as `calibrate` makes it and the model file keeps it.

    Raises:
        InputError: for a curve whose parts do not fit together.
    """

    network: StretchingNetwork
    curve: RateCurve
    """What the network corrects; its static gauge curve says how much strips differ, for taring."""
    mode_odds: ModeOdds
    bending: BendingCoefficients | None
    """None where no recording bends: the paper's eq. (9) serves."""
    ranges: TrainedRanges
    provenance: Provenance
    sigma_scale: SigmaScale = SigmaScale()
    lag_s: float = 0.0
    """By how much the strain that it gives lags behind."""
    unified: bool = False
    """Whether the network measures bent tendons, too."""

    def __post_init__(self) -> None:
        try:
            nothing = np.zeros(1), np.zeros((1, len(self.curve.memory_s)))
            self.curve.strain(*nothing)
            self.curve.sigma(*nothing)
        except ValueError as error:
            raise InputError(f"its curve's parts do not fit together ({error})") from error

    @property
    def gauge(self) -> StaticGauge:
        """The static curve, by which strips differ."""
        return self.curve.gauge

    def bending_curve(self, abscissa: Literal["strain", "resistance"]) -> BendingCurve:
        """Return the curve of bent tendons: the recordings' own where they bend, else the paper's eq. (9)."""
        if abscissa == "strain" and self.bending is not None:
            return BendingCurve("strain", self.bending.coefficients)
        return BendingCurve(abscissa)
