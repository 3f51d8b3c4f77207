"""Figures of an evaluation: heights measured and estimated (paper's Fig. 6C, D), errors over time, coverage, nodes."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ...models.evaluation.evaluation import Evaluation
from ...models.values.chi_squared import chi_squared_quantile
from .style import (
    BAND,
    BAND_IS_CUT,
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
    cuts,
    finish_panel,
    panels_over_time,
    save_figure,
)

NODE_COLORS = (BLUE, ORANGE, GREEN, PURPLE, BLACK, RED, SKY_BLUE)
"""Colours of the loaded nodes, repeated after seven nodes."""
NODE_MARKERS = "os^vD"
"""Markers of the loaded nodes, repeated after five, so that no pair of colour and marker comes twice in 35 nodes."""
MOST_NODES = len(NODE_COLORS) * len(NODE_MARKERS)
"""Number of nodes that can be told apart; of more, those with the largest loads are drawn."""
MOST_BAND = 3.0
"""Ratio of the highest expected error that is shown to the largest error."""
LEGEND_ROWS = 18
"""Number of rows of a legend beside a panel."""


def write_heights_figure(e: Evaluation, title: str, path: Path) -> None:
    """Draw the height of each free node and of each face's centre over time, estimated and true."""
    free = e.structure.free_nodes
    faces = e.structure.faces
    c = e.compared
    figure, axes = panels_over_time(len(free) + len(faces), 4, 1.75, "height [mm]")
    for axis, node in zip(axes, free, strict=False):
        is_cut = _draw_height(axis, c.t_s, c.estimated_m[:, node, 2], c.true_m[:, node, 2], c.height_sigma_m[:, node])
        axis.set_title(f"node {node}{BAND_IS_CUT if is_cut else ''}", fontsize=8, pad=2, y=1)
    for axis, face in zip(axes[len(free) :], faces, strict=False):
        _draw_height(axis, c.t_s, c.estimated_m[:, face, 2].mean(axis=1), c.true_m[:, face, 2].mean(axis=1), None)
        axis.set_title(f"face {face[0]}-{face[1]}-{face[2]}", fontsize=8, pad=2, y=1)
    figure.suptitle(f"{title}: heights of nodes and of faces' centres (each panel has its own scale)")
    estimated = Line2D([], [], color=BLUE, label="estimated")
    band = Patch(color=BLUE, alpha=0.25, label="its 95 % band (nodes)")
    true = Line2D([], [], color=BLACK, lw=0.9, ls="--", label="true")
    add_legend_below(figure, [estimated, band, true], 3)
    save_figure(figure, path)


def write_errors_figure(e: Evaluation, title: str, path: Path) -> None:
    """Draw the error over time with its expected value, the coverage curve, and the error of each node."""
    figure = Figure(figsize=(12, 8.2), layout="constrained")
    axes = figure.subplot_mosaic([["time", "time"], ["coverage", "nodes"]])
    _draw_error_over_time(axes["time"], e)
    _draw_coverage(axes["coverage"], e)
    _draw_nodes(axes["nodes"], e)
    figure.suptitle(f"{title}: errors against the truth")
    save_figure(figure, path)


def write_loads_figure(e: Evaluation, title: str, path: Path) -> None:
    """Draw the largest load over time and each loaded node's load, estimated against true."""
    c = e.compared
    assert e.loads is not None, "nothing to draw"
    assert c.true_load_n is not None
    assert c.estimated_load_n is not None
    true_n = np.linalg.norm(c.true_load_n, axis=-1)
    estimated_n = np.linalg.norm(c.estimated_load_n, axis=-1)
    threshold_n = e.loads.threshold_n
    top_n = 1.08 * max(float(np.nan_to_num(true_n).max()), float(np.nan_to_num(estimated_n).max()), threshold_n)
    figure = Figure(figsize=(13, 4.8), layout="constrained")
    over_time, pairs = figure.subplots(1, 2, width_ratios=(1.7, 1))
    _draw_largest_load(over_time, c.t_s, estimated_n, true_n, threshold_n)
    over_time.set(xlim=_span_s(c.t_s), ylim=(0, top_n))
    pairs.plot([0, top_n], [0, top_n], color=GREY, lw=1, ls="--", label="as it should be")
    _draw_load_pairs(pairs, e.structure.free_nodes, estimated_n, true_n, threshold_n)
    pairs.set(xlim=(0, top_n), ylim=(0, top_n), aspect="equal")
    columns = -(-len(pairs.get_legend_handles_labels()[1]) // LEGEND_ROWS)
    pairs.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), ncols=columns, frameon=False)
    over_time.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0, -0.11), ncols=3, frameon=False)
    for axis in (over_time, pairs):
        add_grid(axis)
    figure.suptitle(f"{title}: external loads, as far as the balance of forces shows them")
    save_figure(figure, path)


def _draw_largest_load(
    axis: Axes,
    t_s: NDArray[np.float64],
    estimated_n: NDArray[np.float64],
    true_n: NDArray[np.float64],
    threshold_n: float,
) -> None:
    axis.plot(t_s, _largest(estimated_n), color=BLUE, lw=0.9, label="largest estimated load")
    axis.plot(t_s, _largest(true_n), color=BLACK, lw=0.9, ls="--", label="largest true load")
    axis.axhline(threshold_n, color=GREY, lw=1, ls=":", label=f"threshold, {threshold_n:g} N")
    axis.set(xlabel="time [s]", ylabel="|F| at the most loaded node [N]")
    axis.set_title("over time", fontsize=10)


def _draw_load_pairs(
    axis: Axes,
    nodes: NDArray[np.int64],
    estimated_n: NDArray[np.float64],
    true_n: NDArray[np.float64],
    threshold_n: float,
) -> None:
    """Draw (frames, nodes) estimated against true loads where these are above the threshold, each node otherwise."""
    loaded = true_n > threshold_n
    largest_n = np.where(loaded, true_n, 0.0).max(axis=0)
    most = np.argsort(-largest_n, kind="stable")[:MOST_NODES]
    for place, k in enumerate(np.sort(most[largest_n[most] > 0])):
        axis.plot(
            true_n[loaded[:, k], k],
            estimated_n[loaded[:, k], k],
            NODE_MARKERS[place % len(NODE_MARKERS)],
            color=NODE_COLORS[place % len(NODE_COLORS)],
            ms=3,
            alpha=0.5,
            label=f"node {nodes[k]}",
        )
    axis.axhline(threshold_n, color=GREY, lw=1, ls=":")
    axis.set(xlabel="true |F| [N]", ylabel="estimated |F| [N]")
    axis.set_title("frame by frame at the loaded nodes", fontsize=10)


def _largest(load_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames,) the largest of (frames, nodes), nan where none is known."""
    largest = np.where(np.isnan(load_n), -np.inf, load_n).max(axis=1)
    return np.where(np.isfinite(largest), largest, np.nan)


def _draw_height(
    axis: Axes,
    t_s: NDArray[np.float64],
    estimated_m: NDArray[np.float64],
    true_m: NDArray[np.float64],
    sigma_m: NDArray[np.float64] | None,
) -> bool:
    """Draw a height, estimated with its band and true, and return whether the axis cuts the band."""
    estimated_mm = 1e3 * estimated_m
    true_mm = 1e3 * true_m
    half_mm = np.zeros_like(estimated_mm)
    if sigma_m is not None:
        half_mm = 1e3 * BAND * sigma_m
        axis.fill_between(t_s, estimated_mm - half_mm, estimated_mm + half_mm, color=BLUE, alpha=0.25, lw=0)
    axis.plot(t_s, estimated_mm, color=BLUE, lw=0.9)
    axis.plot(t_s, true_mm, color=BLACK, lw=0.9, ls="--")
    finish_panel(axis, np.concatenate([estimated_mm, true_mm[np.isfinite(true_mm)]]))
    return cuts(axis, estimated_mm - half_mm, estimated_mm + half_mm)


def _span_s(t_s: NDArray[np.float64]) -> tuple[float, float]:
    """Return the first and the last of (frames,) times; of a single frame, the second about it."""
    return (t_s[0], t_s[-1]) if len(t_s) > 1 else (t_s[0] - 0.5, t_s[0] + 0.5)


def _draw_error_over_time(axis: Axes, e: Evaluation) -> None:
    c = e.compared
    band_mm = BAND * 1e3 * np.sqrt(np.mean(c.node_sigma_m**2, axis=1))
    largest_mm = 1e3 * float(c.frame_error_m.max())
    highest_mm = float(np.nan_to_num(band_mm).max())
    top = 1.08 * max(largest_mm, min(highest_mm, MOST_BAND * largest_mm)) or 1.0  # an estimate that is the truth
    axis.fill_between(c.t_s, 0, band_mm, color=BLUE, alpha=0.25, lw=0, label="1.96 times the expected RMS")
    axis.plot(c.t_s, 1e3 * c.frame_error_m, color=BLACK, lw=0.9, label="error")
    if c.wrong_branch is not None and c.wrong_branch.any():
        label = "on the wrong branch"
        axis.fill_between(c.t_s, 0, top, where=c.wrong_branch, color=ORANGE, alpha=0.3, lw=0, label=label)
    from_s, until_s = _span_s(c.t_s)
    for k, fault in enumerate(fault for fault in e.faults if from_s <= fault.from_s <= until_s):
        axis.axvline(fault.from_s, color=RED, ls=":", lw=1, label="a fault begins" if k == 0 else None)
        height = (0.98 - 0.06 * (k % 4)) * top  # labels of faults that begin at similar times do not overlap
        axis.text(fault.from_s, height, f" {fault.kind}, {fault.where}", fontsize=7, color=RED, va="top")
    axis.set(xlim=(from_s, until_s), ylim=(0, top), xlabel="time [s]", ylabel="RMS over the free nodes [mm]")
    axis.set_title("error over time" + (BAND_IS_CUT if highest_mm > top else ""), fontsize=10)
    axis.legend(loc="upper left", bbox_to_anchor=(0, -0.09), fontsize=8, ncols=4, frameon=False)
    add_grid(axis)


def _draw_coverage(axis: Axes, e: Evaluation) -> None:
    nominal = np.linspace(0, 0.995, 200)
    nees = e.compared.nees[~np.isnan(e.compared.nees)]
    axis.plot([0, 100], [0, 100], color=GREY, lw=1, ls="--", label="as it should be")
    if len(nees):
        observed = np.searchsorted(np.sort(nees), chi_squared_quantile(nominal, 3), side="right") / len(nees)
        sigma_mm = 1e3 * e.consistency.median_sigma_m
        axis.plot(100 * nominal, 100 * observed, color=BLUE, label=f"observed, median sigma {sigma_mm:.2f} mm")
    axis.set(xlim=(0, 100), ylim=(0, 100), aspect="equal", xlabel="nominal probability [%]", ylabel="within [%]")
    axis.set_title("share of nodes within their ellipsoid; below the line: overconfident", fontsize=10)
    axis.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13), frameon=False)
    add_grid(axis)


def _draw_nodes(axis: Axes, e: Evaluation) -> None:
    free = e.structure.free_nodes
    sigma_m = e.compared.node_sigma_m
    place = np.arange(len(free))
    axis.bar(place - 0.2, 1e3 * e.node_rmse_m, 0.4, color=BLUE, label="RMSE")
    axis.bar(place + 0.2, 1e3 * e.node_height_rmse_m, 0.4, color=GREEN, label="RMSE of height")
    sigma_mm = 1e3 * np.median(sigma_m, axis=0)
    axis.plot(place - 0.2, sigma_mm, color=BLACK, marker="_", ms=22, mew=2, ls="", label="median sigma")
    axis.set_xticks(place, [str(node) for node in free])
    axis.set(xlabel="node", ylabel="RMSE and sigma [mm]")
    axis.set_title("error of each free node, and the sigma it was given", fontsize=10)
    axis.legend(fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.13), frameon=False)
    add_grid(axis, along="y")
