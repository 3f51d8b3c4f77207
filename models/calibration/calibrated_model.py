"""The sensor model from the result of a training: the curves, the scale of sigma, and the scores."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..sensor.bending import BendingCurve
from ..sensor.lstm import MEMORY_S, Lstm, LstmWeights, features, run_lstm
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
from ..values.errors import TensegraphError
from ..values.time_series import median_step_s
from .bending_fit import BendingFit
from .gauge_fit import LEAST_GAIN_SIGMA, fit_gauge
from .mode_fit import fit_mode
from .recipe import Trained, TrainingSettings
from .recordings import Recording, Split, correlated_samples, on_common_curve
from .strain_estimators import NetworkEstimator, StrainEstimator
from .strip_baselines import PolynomialEstimator, StaticEstimator
from .strip_gains import StripGain, tare_strips
from .strip_scores import StripScore
from .strips import StripRun, run_strips

LSTM = "LSTM"
STATIC = "static curve"
POLYNOMIAL = "polynomial of rates"
"""Names of the three estimators that are scored."""
CURVE = "curve of rates alone"
"""Name of the model where the network's correction is off, which is scored as well then."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated sensor model, with the training and the runs from which it is scored."""

    model: SensorModel
    """The sensor model; its provenance does not contain the scores yet."""
    trained: Trained
    """The result of the training."""
    split: Split
    """The recordings for training, validation and test."""
    bending: BendingFit | None
    """None when no strip bends in the recordings; then the paper's eq. (9) is used."""
    runs: Mapping[str, Sequence[StripRun]]
    """Runs of each estimator, by its name, on the recordings held out."""
    validation_rmse: tuple[float, float]
    """RMSE of strain on the recordings for validation, of the network and of the rate curve alone; nan without any.
    The model uses the better one."""

    @property
    def used(self) -> str:
        """The name of the estimator that the model is."""
        return CURVE if CURVE in self.runs else LSTM


def calibrate_model(
    split: Split, trained: Trained, bending: BendingFit | None, settings: TrainingSettings
) -> Calibration:
    """Return the sensor model from a training.

    Its sigma is scaled on the validation recordings, and it is run on the recordings held out.

    Raises:
        TensegraphError: when the training diverged.
    """
    if not trained.history.best_epoch:
        raise TensegraphError(
            f"the training diverged: expected a smaller learning rate, got {settings.learning_rate:g}"
        )
    unified = settings.unified
    mode_odds = _mode_odds(split, bending)
    trained = _with_spread(trained, bending, mode_odds, split, settings)
    common = on_common_curve(split.training, trained.gain_and_offset)
    exact = np.zeros((2, 2))  # the covariance of a gain and offset that are known
    known = {name: StripGain(values, exact) for name, values in trained.gain_and_offset.items()}

    def validated(weights: LstmWeights) -> tuple[SensorModel, list[StripRun]]:
        """Return the model with these weights, and its runs on the recordings for validation."""
        model = _model(replace(trained, weights=weights), bending, common, mode_odds, settings)
        tares = tare_strips(NetworkEstimator(model), split.validation, trained.gauge, unified, seconds=np.inf)
        gains = {name: StripGain(tare.gain_and_offset, exact) for name, tare in tares.items()}
        return model, run_strips(NetworkEstimator(model), split.validation, trained.gauge, gains | known, unified)

    model, validation = validated(trained.weights)
    curve_alone, curve_validation = validated(without_correction(trained.weights))
    rmse, curve_rmse = (StripScore.of(runs).rmse if runs else np.nan for runs in (validation, curve_validation))
    network = model = replace(model, sigma_scale=fit_sigma_scale(validation), lag_s=lag_s(validation))
    used: dict[str, StrainEstimator] = {}
    if curve_rmse < rmse:
        model = replace(curve_alone, sigma_scale=fit_sigma_scale(curve_validation), lag_s=lag_s(curve_validation))
        used = {CURVE: NetworkEstimator(model)}
    estimators: dict[str, StrainEstimator] = {
        **used,
        LSTM: NetworkEstimator(network),
        STATIC: StaticEstimator.fit(common, unified),
        POLYNOMIAL: PolynomialEstimator.fit(common, unified),
    }
    scored = split.scored(unified)
    runs = {name: run_strips(each, scored, trained.gauge, known, unified) for name, each in estimators.items()}
    return Calibration(model, trained, split, bending, runs, (rmse, curve_rmse))


def without_correction(weights: LstmWeights) -> LstmWeights:
    """Return weights with which the network leaves the strain of the rate curve as it is; its sigma stays."""
    only_sigma = np.array([0.0, 1.0])
    return replace(
        weights, head_weight=weights.head_weight * only_sigma[:, None], head_bias=weights.head_bias * only_sigma
    )


def _with_spread(
    trained: Trained,
    bending: BendingFit | None,
    mode_odds: ModeOdds,
    split: Split,
    settings: TrainingSettings,
) -> Trained:
    """Return a training with gain and offset of each strip from its whole recording, and the spread of these gains.

    The estimated gain of a strip with little motion stays near 1, so that the spread of the estimates is less than that
    of the gains: spread^2 = mean((gain - mean gain)^2 + variance of the estimate). The mean over all strips stays as in
    the training, because a change that is common to all strips belongs to the curve.
    """
    model = _model(trained, bending, on_common_curve(split.training, trained.gain_and_offset), mode_odds, settings)
    unified = settings.unified
    stretched = [r for r in split.training if r.stretches]
    tares = tare_strips(NetworkEstimator(model), stretched, trained.gauge, unified, np.inf, trained.gain_and_offset)
    gains = np.array([tare.gain_and_offset[0] for tare in tares.values()])
    variances = np.array([tare.covariance[0, 0] for tare in tares.values()])
    spread = float(np.sqrt(np.var(gains) + np.mean(variances))) if len(gains) > 1 else 0.0  # one strip has no spread
    shift = np.mean([trained.gain_and_offset[name] - tare.gain_and_offset for name, tare in tares.items()], axis=0)
    gain_and_offset = dict(trained.gain_and_offset) | {
        name: tare.gain_and_offset + shift for name, tare in tares.items()
    }
    gauge = replace(trained.gauge, gain_sigma=max(spread, LEAST_GAIN_SIGMA))
    return replace(trained, curve=replace(trained.curve, gauge=gauge), gain_and_offset=gain_and_offset)


def lag_s(runs: Sequence[StripRun]) -> float:
    """Return the lag of estimates behind strain in seconds: -sum e v / sum v^2.

    e is the error minus its mean in each run, v the rate of strain. A negative lag is returned as 0.
    """
    parts = [(run.error - run.error.mean(), run.rate_per_s) for run in runs]
    moved = sum(float(np.nansum(rate**2)) for _, rate in parts)
    return max(-sum(float(np.nansum(error * rate)) for error, rate in parts) / moved, 0.0) if moved else 0.0


def fit_sigma_scale(runs: Sequence[StripRun]) -> SigmaScale:
    """Return the scale of sigma that makes the errors of these runs most likely, with p of 0 to about 1 by a prior.

    Strips that were always moved alike tell nothing of p. Where errors are larger after little motion than after much,
    other things differ, too: with p < 0, the sigma of a strip that rests would grow without bound.

    The gains and offsets of the strips must be known from their whole recordings: the uncertainties of taring and of
    the curve's coefficients are added separately at run time.
    """
    if not runs:
        return SigmaScale()
    error = np.concatenate([run.error for run in runs])
    sigma = np.concatenate([run.unscaled_sigma for run in runs])
    log_spread = np.log(np.maximum(np.concatenate([run.spread for run in runs]), LEAST_SPREAD))
    independent = sum(len(run.t_s) / correlated_samples(run.t_s) for run in runs)

    def negative_log_likelihood(parameters: NDArray[np.float64]) -> float:
        log_scale = parameters[0] + parameters[1] * log_spread
        of_errors = np.mean(0.5 * (error / (sigma * np.exp(log_scale))) ** 2 + log_scale)
        return float(of_errors + 0.5 * parameters[1] ** 2 / independent)

    log_b, p = minimize(negative_log_likelihood, [0.0, 0.0], method="Nelder-Mead").x
    if p < 0:
        return SigmaScale(float(np.sqrt(np.mean((error / sigma) ** 2))))
    return SigmaScale(float(np.exp(log_b)), float(p))


def _model(
    trained: Trained,
    bending: BendingFit | None,
    common: Sequence[Recording],
    mode_odds: ModeOdds,
    settings: TrainingSettings,
) -> SensorModel:
    """Return the sensor model with the unscaled sigma of the network."""
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
    """Return the network with a golden vector, whose input is an oscillation of dR/R."""
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
    """Return `fit_mode` of the recordings for training and validation.

    Gains and offsets are those of the static curves, which are valid in both modes; those of the network are estimated
    without bent samples.
    """
    names = {r.name for r in split.training}
    recordings = [*split.training, *(r for r in split.validation if r.name not in names)]
    _, gains = fit_gauge(recordings, bending.curve() if bending else BendingCurve())
    return fit_mode(on_common_curve(recordings, gains))


def _fastest_strain(recordings: Sequence[Recording]) -> float:
    """Return the rate of strain which 99.9 % of the stretched samples do not exceed, smoothed as at run time."""
    rates = []
    for r in recordings:
        stretched = r.strain >= 0
        width = max(round(STRAIN_RATE_S / median_step_s(r.t_s)), 1)
        rate = np.abs(r.strain[width:] - r.strain[:-width]) / (r.t_s[width:] - r.t_s[:-width])
        rates.append(rate[stretched[width:] & stretched[:-width]])
    return float(np.quantile(np.concatenate(rates), 0.999))
