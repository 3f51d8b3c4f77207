"""Figures of a calibration: those of Figs. 3 to 5 of the paper, and the coverage of the predicted sigma."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm

from ...models.calibration.calibrated_model import CURVE, LSTM, POLYNOMIAL, STATIC, Calibration
from ...models.calibration.recipe import History
from ...models.calibration.recordings import Recording, on_common_curve
from ...models.calibration.strip_scores import StripScore, by_speed, error_autocorrelation
from ...models.calibration.strips import StripRun
from ...models.sensor.bending import BendingCurve
from .style import (
    BAND,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY_BLUE,
    add_grid,
    add_legend_below,
    save_figure,
)

COLORS = {CURVE: BLACK, LSTM: BLUE, STATIC: ORANGE, POLYNOMIAL: GREEN}
SPEED_COLORS = (BLUE, SKY_BLUE, GREEN, ORANGE, RED, PURPLE, BLACK)
GAP_S = 1.0
"""Time without a sample after which a curve is interrupted."""
LEAST_SAMPLES = 50
"""Least number of samples in a bin of rates for its mean to be drawn."""
MOST_POINTS = 2000
"""Largest number of points drawn of one recording; more could not be distinguished."""
MOST_SHOWN = 8
"""Largest number of recordings whose predictions are drawn, each in panels of its own."""
NARROWEST_STRAIN = 1e-6
"""Least standard deviation of strain that a histogram of errors shows: those of a strip that stands still are alike."""
FINE_PANELS_DPI = 100
"""Resolution of figures with many panels."""


def write_calibration_figures(calibration: Calibration, directory: Path) -> None:
    """Write curves.png, losses.png, predictions.png and errors.png."""
    write_curves_figure(calibration, directory / "curves.png")
    write_losses_figure(calibration.trained.history, directory / "losses.png")
    write_predictions_figure(calibration.runs, directory / "predictions.png")
    write_errors_figure(calibration.runs, directory / "errors.png")


def write_curves_figure(calibration: Calibration, path: Path) -> None:
    """Draw resistance against strain by speed, with the fits (the paper's Figs. 3D and 4G)."""
    bending = calibration.bending
    recordings = on_common_curve(calibration.split.training, calibration.trained.gain_and_offset)
    kinds = [("stretching", [r for r in recordings if r.stretched_share > 0.9])]
    if bending:
        kinds.append(("bending", [r for r in recordings if r.bends]))
    figure = Figure(figsize=(6.2 * len(kinds), 5), layout="constrained")
    for axis, (kind, some) in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        _draw_by_speed(axis, some)
        if kind == "stretching":
            gauge = calibration.trained.gauge
            axis.plot(gauge.strain_knots, gauge.change_knots, color=BLACK, lw=1.6, ls="--", label="static curve")
        elif bending:
            _draw_bending(axis, bending.curve(), bending.lowest_strain, bending.r2)
        axis.set_xlabel("strain [1]")
        axis.set_ylabel("resistance change dR/R, each strip's gain and offset undone [1]")
        axis.set_title(kind, fontsize=10)
        axis.legend(fontsize=8, markerscale=4)
        add_grid(axis)
    figure.suptitle("Resistance against strain, recordings trained on")
    save_figure(figure, path)


def _draw_by_speed(axis: Axes, recordings: Sequence[Recording]) -> None:
    speeds = sorted({f"{r.speed_per_s:.2g}" for r in recordings if np.isfinite(r.speed_per_s)}, key=float)
    color = dict(zip(speeds, SPEED_COLORS, strict=False))
    labels: set[str] = set()
    irregular_first = sorted(recordings, key=lambda r: (np.isfinite(r.speed_per_s), r.speed_per_s))
    for r in irregular_first:
        speed = f"{r.speed_per_s:.2g}"
        label = f"{speed} /s" if np.isfinite(r.speed_per_s) else "irregular motion"
        every = max(len(r.t_s) // MOST_POINTS, 1)
        axis.plot(
            r.strain[r.settled][::every],
            r.change[r.settled][::every],
            ls="",
            marker=".",
            ms=1.2,
            color=color.get(speed, GREY),
            label=None if label in labels else label,
            zorder=1 if speed not in color else 2,
        )
        labels.add(label)


def _draw_bending(axis: Axes, curve: BendingCurve, lowest_strain: float, r2: float) -> None:
    strain = np.linspace(lowest_strain, 0, 300)
    axis.plot(strain, curve.change(strain), color=BLACK, lw=1.6, ls="--", label=f"degree 5, R² = {r2:.5f}")
    fold = curve.polynomial
    axis.axvspan(fold.x_fold, 0, color=GREY, alpha=0.25, label="not invertible (fold)")


def write_losses_figure(history: History, path: Path) -> None:
    """Draw the losses over the epochs (the paper's Fig. 5D)."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    epoch = np.arange(1, len(history.training_loss) + 1)
    training = np.array(history.training_loss)
    checked = np.array(history.validation_epoch)
    validation = np.array(history.validation_loss)
    change = history.likelihood_from
    for axis, early in ((left, True), (right, False)):
        chosen = epoch <= change if early else epoch > change
        chosen_checks = checked <= change if early else checked > change
        axis.plot(epoch[chosen], training[chosen], color=BLUE, lw=1, label="training")
        axis.plot(checked[chosen_checks], validation[chosen_checks], color=ORANGE, marker=".", lw=1, label="validation")
        axis.set_xlabel("epoch")
        add_grid(axis)
    left.set_yscale("log")
    left.set_ylabel("(error of strain / 0.05)² [1]")
    left.set_title("first part: squared error", fontsize=10)
    right.set_ylabel("Gaussian loss, -log likelihood a sample [1]")
    right.set_title("second part: likelihood; sigma learns", fontsize=10)
    right.axvline(history.best_epoch, color=BLACK, lw=0.8, ls=":", label=f"kept: epoch {history.best_epoch}")
    right.legend()
    save_figure(figure, path)


def write_sweep_figure(losses: Mapping[float, float], chosen: float, path: Path) -> None:
    """Draw the validation loss of short trainings against the learning rate (the paper's Fig. 5C)."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axis = figure.subplots()
    axis.plot(list(losses), list(losses.values()), color=BLUE, marker="o")
    axis.axvline(chosen, color=BLACK, lw=0.8, ls=":", label=f"the training's: {chosen:g}")
    axis.set_xscale("log")
    axis.set_xlabel("learning rate (Adam, peak of one cycle)")
    axis.set_ylabel("least validation loss, Gaussian [1]")
    axis.legend()
    add_grid(axis)
    save_figure(figure, path)


def write_predictions_figure(runs: Mapping[str, Sequence[StripRun]], path: Path) -> None:
    """Draw predicted and measured strain over samples, and the error below (the paper's Fig. 5E)."""
    shown = [run for group in by_speed(runs[LSTM]).values() for run in group][:MOST_SHOWN]
    static = {run.name: run for run in runs[STATIC]}
    columns = min(len(shown), 2)
    figure = Figure(figsize=(7 * columns, 3.2 * -(-len(shown) // columns) + 0.6), layout="constrained")
    parts = figure.subfigures(-(-len(shown) // columns), columns, squeeze=False).ravel()
    for part, run in zip(parts, shown, strict=False):
        strain, error = part.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        t_s = run.t_s - run.t_s[0]
        t_s = np.where(np.diff(t_s, append=t_s[-1]) > GAP_S, np.nan, t_s)  # interrupt the curve where nothing is scored
        _draw_strain(strain, t_s, run)
        _draw_error(error, t_s, run, static[run.name])
        for axis in (strain, error):
            add_grid(axis)
            axis.margins(x=0)
    if shown:
        handles = [handle for axis in parts[0].axes for handle in axis.get_legend_handles_labels()[0]]
        add_legend_below(figure, handles, 4)
    figure.suptitle("Held-out recordings")
    save_figure(figure, path, FINE_PANELS_DPI)


def _draw_strain(axis: Axes, t_s: NDArray[np.float64], run: StripRun) -> None:
    axis.plot(t_s, run.strain, color=BLACK, lw=1.2, label="measured by the rig")
    axis.plot(t_s, run.estimate, color=BLUE, lw=0.9, ls="--", label="LSTM")
    axis.set_ylabel("strain [1]")
    score = StripScore.of([run])
    axis.set_title(f"{run.name}: RMSE {score.rmse:.4f}, {score.coverage_95:.0%} within 95 % band", fontsize=9)


def _draw_error(axis: Axes, t_s: NDArray[np.float64], run: StripRun, static: StripRun) -> None:
    band = BAND * run.sigma
    axis.fill_between(t_s, -band, band, color=BLUE, alpha=0.2, lw=0, label="95 % band")
    axis.plot(t_s, static.error, color=ORANGE, lw=0.6, label="static curve")
    axis.plot(t_s, run.error, color=BLUE, lw=0.8)
    axis.set_ylabel("error [1]")
    axis.set_xlabel("time scored [s]")
    widest = 1.3 * max(float(np.quantile(np.abs(run.error), 0.995)), float(np.quantile(band, 0.9)))
    axis.set_ylim(-widest, widest)


def write_errors_figure(runs: Mapping[str, Sequence[StripRun]], path: Path) -> None:
    """Draw the errors' histogram (the paper's Fig. 5F), the coverage of sigma, error against rate, autocorrelation."""
    figure = Figure(figsize=(12, 9), layout="constrained")
    (histogram, coverage), (rates, correlation) = figure.subplots(2, 2)
    for name, some in runs.items():
        error = np.concatenate([run.error for run in some])
        sigma = np.concatenate([run.sigma for run in some])
        rate = np.concatenate([run.rate_per_s for run in some])
        _draw_histogram(histogram, name, error)
        _draw_coverage(coverage, name, np.abs(error) / sigma)
        _draw_rates(rates, name, np.abs(rate), error)
        _draw_autocorrelation(correlation, name, some)
    errors = [np.concatenate([run.error for run in some]) for some in runs.values()]
    widest = max(abs(error.mean()) + 3 * _spread(error) for error in errors)
    histogram.set(xlim=(-widest, widest), xlabel="error of strain [1]", ylabel="probability density [1/strain]")
    histogram.set_title("errors, with the normal curve of the same mean and deviation", fontsize=10)
    coverage.plot([0, 1], [0, 1], color=GREY, lw=0.8, ls="--", label="honest sigma")
    coverage.set(xlabel="nominal probability of the band", ylabel="share of errors inside")
    coverage.set_title("coverage of sigma", fontsize=10)
    rates.set(xlabel="speed [strain/s] (three bins a decade)", ylabel="RMSE of strain [1]")
    rates.set_title("error against rate", fontsize=10)
    correlation.axhline(np.exp(-1), color=GREY, lw=0.8, ls="--", label="1/e")
    correlation.set(xlabel="lag [s]", ylabel="autocorrelation [1]")
    correlation.set_title("autocorrelation of the error, mean over recordings", fontsize=10)
    for axis in (histogram, coverage, rates, correlation):
        axis.legend(fontsize=8)
        add_grid(axis, which="both")
    figure.suptitle("Errors on held-out recordings")
    save_figure(figure, path, FINE_PANELS_DPI)


def _draw_histogram(axis: Axes, name: str, error: NDArray[np.float64]) -> None:
    spread = _spread(error)
    edges = error.mean() + np.linspace(-4, 4, 81) * spread
    axis.hist(error, edges.tolist(), density=True, histtype="step", color=COLORS[name], label=name)
    middle = 0.5 * (edges[1:] + edges[:-1])
    axis.plot(middle, norm.pdf(middle, error.mean(), spread), color=COLORS[name], lw=0.8, ls=":")


def _spread(error: NDArray[np.float64]) -> float:
    """Return the standard deviation of errors, at least that which a histogram can show."""
    return max(float(error.std()), NARROWEST_STRAIN)


def _draw_coverage(axis: Axes, name: str, z: NDArray[np.float64]) -> None:
    nominal = np.linspace(0.02, 0.995, 60)
    axis.plot(nominal, [np.mean(z < norm.ppf(0.5 + 0.5 * p)) for p in nominal], color=COLORS[name], label=name)


def _draw_rates(axis: Axes, name: str, rate: NDArray[np.float64], error: NDArray[np.float64]) -> None:
    bins = np.floor(3 * np.log10(np.maximum(rate, 1e-6)))
    parts = [rate_bin == bins for rate_bin in np.unique(bins[rate > 1e-3])]
    parts = [part for part in parts if part.sum() >= LEAST_SAMPLES]
    rates = [float(np.median(rate[part])) for part in parts]
    rmses = [float(np.sqrt(np.mean(error[part] ** 2))) for part in parts]
    axis.plot(rates, rmses, color=COLORS[name], marker="o", ms=4, label=name)
    if any(rmses):  # an empty axis, of recordings with few samples, has no logarithmic scale
        axis.set(xscale="log", yscale="log")


def _draw_autocorrelation(axis: Axes, name: str, runs: Sequence[StripRun]) -> None:
    lags = np.linspace(0, 30, 301)
    curves = [np.interp(lags, *error_autocorrelation(run)) for run in runs]
    axis.plot(lags, np.mean(curves, axis=0), color=COLORS[name], label=name)
