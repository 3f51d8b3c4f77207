"""The figure of a comparison of methods: error, coverage, sigma and time of each on each trial."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from ...models.evaluation.comparison import ALL, ComparisonRow
from .style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY_BLUE, add_grid, add_legend_below, save_figure

METHOD_COLORS = (GREY, ORANGE, GREEN, SKY_BLUE, BLUE, PURPLE, RED, BLACK)
"""Colours of the methods in the order of the table, repeated if there are more methods."""
PUBLISHED_DASHES = (":", "-.", "--")


def write_comparison_figure(rows: Sequence[ComparisonRow], published_mm: Mapping[str, float], path: Path) -> None:
    """Draw node RMSE, coverage, sigma and time of each method on each trial, with published errors as lines.

    Methods that were run on no trial are left out.
    """
    if len({row.trial for row in rows}) == 2:  # all are the only one
        rows = [row for row in rows if row.trial != ALL]
    trials = list(dict.fromkeys(row.trial for row in rows))
    run = {row.method for row in rows if np.isfinite(row.errors.nodes.rmse_m)}
    rows = [row for row in rows if row.method in run] or rows
    figure = Figure(figsize=(max(10.0, 1.7 * len(trials) + 3), 13), layout="constrained")
    error, covered, sigma, duration = figure.subplots(4, 1, sharex=True, height_ratios=(2, 1.2, 1.2, 1.2))
    _draw_bars(error, rows, lambda row: 1e3 * row.errors.nodes.rmse_m)
    _draw_bars(covered, rows, lambda row: 100 * row.coverage_95)
    _draw_points(sigma, rows, lambda row: 1e3 * row.median_sigma_m)
    _draw_points(duration, rows, lambda row: row.ms_per_frame)
    _draw_published(error, published_mm)
    covered.axhline(95, color=BLACK, ls="--", lw=0.8)
    error.set(ylabel="node RMSE [mm]", title="error (3-D) of the free nodes")
    covered.set(ylabel="within [%]", ylim=(0, 100), title="nodes within their ellipsoid of 95 % (dashed: 95 %)")
    title = "size of these ellipsoids: root of the trace of a node's covariance"
    sigma.set(ylabel="median sigma [mm]", title=title)
    duration.set(ylabel="time [ms per frame]", title="time from lengths to shapes with covariances")
    for axis in (sigma, duration):
        _make_logarithmic(axis)
    duration.set_xticks(np.arange(len(trials)), trials, parse_math=False)
    for axis in (error, covered, sigma, duration):
        add_grid(axis, along="y", which="both")
        axis.set_axisbelow(True)
    add_legend_below(figure, error.get_legend_handles_labels()[0], 3)
    save_figure(figure, path)


def write_spread_figure(rows: Sequence[ComparisonRow], published_mm: Mapping[str, float], path: Path) -> None:
    """Draw the same over many trials: each method's quartiles, the last trial within 1.5 of their distance, the rest.

    Args:
        rows: of all trials together, which are left out, and of each trial.
        published_mm: published errors, as marked lines.
        path: of the PNG.
    """
    single = [row for row in rows if row.trial != ALL]
    methods = list(dict.fromkeys(row.method for row in single))
    count = len({row.trial for row in single})
    figure = Figure(figsize=(10, 13), layout="constrained")
    figure.suptitle(f"{count} trials: each box holds the middle half of them, its line is the median")
    panels: Sequence[tuple[str, str, Callable[[ComparisonRow], float]]] = (
        ("node RMSE [mm]", "linear", lambda row: 1e3 * row.errors.nodes.rmse_m),
        ("within their ellipsoid of 95 % [%]", "linear", lambda row: 100 * row.coverage_95),
        ("median sigma [mm]", "log", lambda row: 1e3 * row.median_sigma_m),
        ("time [ms per frame]", "log", lambda row: row.ms_per_frame),
    )
    axes = figure.subplots(len(panels), 1, sharex=True)
    for axis, (label, scale, value) in zip(axes, panels, strict=True):
        values = [[value(row) for row in single if row.method == method] for method in methods]
        axis.boxplot([[v for v in some if np.isfinite(v)] for some in values], flierprops={"markersize": 3})
        axis.set(ylabel=label)
        if scale == "log":
            _make_logarithmic(axis)
        add_grid(axis, along="y", which="both")
    _draw_published(axes[0], published_mm)
    axes[1].axhline(95, color=BLACK, ls="--", lw=0.8)
    axes[-1].set_xticks(np.arange(1, len(methods) + 1), methods)
    add_legend_below(figure, axes[0].get_legend_handles_labels()[0], 3)
    save_figure(figure, path)


def _draw_bars(axis: Axes, rows: Sequence[ComparisonRow], value: Callable[[ComparisonRow], float]) -> None:
    """Draw a bar for each method on each trial, those of one trial side by side."""
    for group in _groups(rows):
        values = [value(row) for row in group.rows]
        axis.bar(group.place, values, group.width, color=group.color, label=group.method)


def _draw_points(axis: Axes, rows: Sequence[ComparisonRow], value: Callable[[ComparisonRow], float]) -> None:
    """Draw a point where `_draw_bars` has a bar, for an axis without a zero."""
    for group in _groups(rows):
        values = [value(row) for row in group.rows]
        axis.plot(group.place, values, ls="", marker="o", color=group.color, label=group.method)


def _make_logarithmic(axis: Axes) -> None:
    """Make the vertical axis logarithmic, where there is anything on it: no method may have been run.

    It spans a factor of 4 at least, so that a small difference looks small.
    """
    if any(np.isfinite(line.get_ydata()).any() for line in axis.lines):
        axis.set_yscale("log")
        axis.margins(y=0.2)
        low, high = axis.get_ylim()
        axis.set_ylim(min(low, 0.5 * np.sqrt(low * high)), max(high, 2 * np.sqrt(low * high)))
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())


def _draw_published(axis: Axes, published_mm: Mapping[str, float]) -> None:
    """Draw published errors as lines of different dashes, which the legend names."""
    for (source, node_mm), dashes in zip(published_mm.items(), cycle(PUBLISHED_DASHES), strict=False):
        axis.axhline(node_mm, color=BLACK, ls=dashes, lw=0.9, label=f"{node_mm} mm, {source}, another robot")


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """One method on all trials."""

    method: str
    rows: list[ComparisonRow]
    """Row of each trial, in the order of the trials."""
    place: NDArray[np.float64]
    """(trials,) positions along the axis."""
    width: float
    color: str


def _groups(rows: Sequence[ComparisonRow]) -> Iterator[_Group]:
    trials = list(dict.fromkeys(row.trial for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    width = 0.84 / len(methods)
    for k, method in enumerate(methods):
        by_trial = {row.trial: row for row in rows if row.method == method}
        yield _Group(
            method=method,
            rows=[by_trial[trial] for trial in trials],
            place=np.arange(len(trials), dtype=np.float64) + (k - (len(methods) - 1) / 2) * width,
            width=width,
            color=METHOD_COLORS[k % len(METHOD_COLORS)],
        )
