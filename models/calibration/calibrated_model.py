"""From what a training found to the sensor model: the curves, the scale of sigma, and the scores."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..sensor.bending import BendingCurve
from ..sensor.lstm import MEMORY_S, Lstm, features, run_lstm
from ..sensor.sensor_model import (
    LEAST_SPREAD,
    BendingCoefficients,
    GoldenVector,
    ModeOdds,
    Provenance,
    SensorModel,
    SigmaScale,
    StretchingNetwork,
    TrainedRanges,
)
from ..sensor.stretching import STRAIN_RATE_S
from .bending_fit import BendingFit
from .gauge_fit import LEAST_GAIN_SIGMA, fit_gauge
from .mode_fit import fit_mode
from .recipe import Trained, TrainingSettings
from .recordings import Recording, Split
from .strain_estimators import NetworkEstimator, StrainEstimator
from .strip_baselines import PolynomialEstimator, StaticEstimator, on_common_curve
from .strip_gains import StripGain, tare_strips
from .strips import StripRun, run_strips

LSTM = "LSTM"
STATIC = "static curve"
POLYNOMIAL = "polynomial of rates"
"""The estimators' names."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated kind of sensor, with what it was scored on."""

    model: SensorModel
    """Its provenance still without scores."""
    trained: Trained
    """The training."""
    split: Split
    """The recordings."""
    bending: BendingFit | None
    """None when no recording bends: the paper's eq. (9) serves."""
    runs: Mapping[str, Sequence[StripRun]]
    """Of each estimator on the recordings held out."""


def calibrate_model(
    split: Split, trained: Trained, bending: BendingFit | None, settings: TrainingSettings
) -> Calibration:
    """Return the sensor model of a training, its sigma scaled on the validation recordings, run on those held out."""
    signed = settings.unified
    mode_odds = _mode_odds(split, bending)
    trained = _with_spread(trained, bending, mode_odds, split, settings)
    common = on_common_curve(split.training, trained.gain_and_offset)
    model = _model(trained, bending, common, mode_odds, settings)
    left = np.zeros((2, 2))
    known = {name: StripGain(found, left) for name, found in trained.gain_and_offset.items()}
    whole = tare_strips(NetworkEstimator(model), split.validation, trained.gauge, signed, seconds=np.inf)
    exact = {name: StripGain(tare.gain_and_offset, left) for name, tare in whole.items()}
    validation = run_strips(NetworkEstimator(model), split.validation, trained.gauge, exact | known, signed)
    model = replace(model, sigma_scale=fit_sigma_scale(validation), lag_s=lag_s(validation))
    estimators: dict[str, StrainEstimator] = {
        LSTM: NetworkEstimator(model),
        STATIC: StaticEstimator.fit(common, signed),
        POLYNOMIAL: PolynomialEstimator.fit(common, signed),
    }
    scored = [r for r in split.held_out if signed or (r.strain >= 0).mean() > 0.3]
    runs = {name: run_strips(e, scored, trained.gauge, known, signed) for name, e in estimators.items()}
    return Calibration(model, trained, split, bending, runs)


def _with_spread(
    trained: Trained,
    bending: BendingFit | None,
    mode_odds: ModeOdds,
    split: Split,
    settings: TrainingSettings,
) -> Trained:
    """Return a training with each strip's gain and offset by all of its recording, and the gain's spread from these.

    A strip of little motion keeps its gain near 1, so that the spread of the gains found is less than that of the
    gains: spread^2 = mean((gain - mean gain)^2 + the variance left of each). The mean of all stays as in the training:
    what is common to all strips is the curve's.
    """
    model = _model(trained, bending, on_common_curve(split.training, trained.gain_and_offset), mode_odds, settings)
    signed = settings.unified
    stretched = [r for r in split.training if r.stretched_share > 0.3]
    tares = tare_strips(NetworkEstimator(model), stretched, trained.gauge, signed, np.inf, trained.gain_and_offset)
    gains, left = np.array([(tare.gain_and_offset[0], tare.covariance[0, 0]) for tare in tares.values()]).T
    found = float(np.sqrt(np.var(gains) + np.mean(left))) if len(gains) > 1 else 0.0  # one strip has no spread
    common = np.mean([trained.gain_and_offset[name] - tare.gain_and_offset for name, tare in tares.items()], axis=0)
    gain_and_offset = dict(trained.gain_and_offset) | {
        name: tare.gain_and_offset + common for name, tare in tares.items()
    }
    gauge = replace(trained.gauge, gain_sigma=max(found, LEAST_GAIN_SIGMA))
    return replace(trained, curve=replace(trained.curve, gauge=gauge), gain_and_offset=gain_and_offset)


def lag_s(runs: Sequence[StripRun]) -> float:
    """Return by how much estimates lag behind strain: -sum e v / sum v^2, e the error about its mean, v the rate."""
    parts = [(run.error - run.error.mean(), run.rate_per_s) for run in runs]
    moved = sum(float(np.nansum(rate**2)) for _, rate in parts)
    return max(-sum(float(np.nansum(error * rate)) for error, rate in parts) / moved, 0.0) if moved else 0.0


def fit_sigma_scale(runs: Sequence[StripRun]) -> SigmaScale:
    """Return the scale of sigma that makes the errors of these runs most likely.

    The strips' gains and offsets are to be known here, by all of each recording: what taring leaves is added apart, and
    so is what the curve leaves, which is little where recordings reach.
    """
    if not runs:
        return SigmaScale()
    error, sigma = (np.concatenate([getattr(run, name) for run in runs]) for name in ("error", "unscaled_sigma"))
    log_spread = np.log(np.maximum(np.concatenate([run.spread for run in runs]), LEAST_SPREAD))

    def negative_log_likelihood(parameters: NDArray[np.float64]) -> float:
        log_scale = parameters[0] + parameters[1] * log_spread
        return float(np.mean(0.5 * (error / (sigma * np.exp(log_scale))) ** 2 + log_scale))

    log_b, p = minimize(negative_log_likelihood, [0.0, 0.0], method="Nelder-Mead").x
    return SigmaScale(float(np.exp(log_b)), float(p))


def _model(
    trained: Trained,
    bending: BendingFit | None,
    common: Sequence[Recording],
    mode_odds: ModeOdds,
    settings: TrainingSettings,
) -> SensorModel:
    """Return the model with sigma as the network has it."""
    trained_on = tuple(sorted(r.name for r in common))
    return SensorModel(
        network=_network(trained),
        curve=trained.curve,
        mode_odds=mode_odds,
        bending=BendingCoefficients(bending.coefficients, bending.covariance) if bending else None,
        ranges=_ranges(common, trained.step_s),
        provenance=Provenance(recipe=asdict(settings), trained_on=trained_on),
        unified=settings.unified,
    )


def _network(trained: Trained) -> StretchingNetwork:
    """Return the network, with a swing of dR/R for a golden vector."""
    t = np.arange(20) * 0.02
    change = 0.1 + 0.05 * np.sin(5 * t)
    means = np.full((len(t), len(MEMORY_S)), 0.1)
    golden_input = features(change, 0.25 * np.cos(5 * t), 0.02, means, trained.scaling)
    golden = GoldenVector(golden_input, run_lstm(Lstm(trained.weights), golden_input))
    return StretchingNetwork(trained.weights, trained.scaling, np.array(MEMORY_S), golden)


def _ranges(common: Sequence[Recording], step_s: tuple[float, float]) -> TrainedRanges:
    change = np.concatenate([r.change for r in common])
    rate = np.concatenate([np.diff(r.change) / np.diff(r.t_s) for r in common])
    return TrainedRanges(
        change=(float(change.min()), float(change.max())),
        rate_per_s=float(np.quantile(np.abs(rate), 0.999)),
        strain=(0.0, float(max(r.strain.max() for r in common))),
        step_s=step_s,
        strain_rate_per_s=_fastest_strain(common),
    )


def _mode_odds(split: Split, bending: BendingFit | None) -> ModeOdds:
    """Return `fit_mode` of all recordings but those held out: nothing is trained here.

    Their gains and offsets are those of the static curves, which hold in both modes; the network's know no bending.
    """
    names = {r.name for r in split.training}
    recordings = [*split.training, *(r for r in split.validation if r.name not in names)]
    _, own = fit_gauge(recordings, bending.curve() if bending else BendingCurve())
    return fit_mode(on_common_curve(recordings, {name: np.array(pair) for name, pair in own.items()}))


def _fastest_strain(recordings: Sequence[Recording]) -> float:
    """Return the rate of strain that 99.9 % of the stretched samples stay under, smoothed as at run time."""
    rates = []
    for r in recordings:
        step_s = float(np.median(np.diff(r.t_s)))
        stretched = r.strain >= 0
        width = max(round(STRAIN_RATE_S / step_s), 1)
        rate = np.abs(r.strain[width:] - r.strain[:-width]) / (r.t_s[width:] - r.t_s[:-width])
        rates.append(rate[stretched[width:] & stretched[:-width]])
    return float(np.quantile(np.concatenate(rates), 0.999))
