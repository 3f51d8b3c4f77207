"""Figures of a run: lengths over time, the structure in space."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ...models.settings import Settings
from ...models.structure.reconstruction import Reconstruction
from ...models.values.readings import LEFT_OUT, Mode
from .structure_view import LoadArrows, Scale, draw_structure
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
    add_grid,
    add_legend_below,
    anchor_handle,
    cuts,
    finish_panel,
    panels_over_time,
    save_figure,
    set_cube,
    structure_handles,
    within_margins,
)
from .track_figure import write_track_figure

LONG_FRAMES = 3000
"""Number of frames, a minute at 50 Hz, above which a panel shows the range of many frames in place of each."""
HEIGHT_COLORS = (BLUE, ORANGE, GREEN)
"""Colours of the nodes whose heights are drawn; there are no more such nodes."""
MOST_FRAMES = 4
"""Largest number of frames in which the structure is drawn."""
PIECES = 400
"""Number of such ranges in a panel, which is about as many pixels wide."""


def write_figures(r: Reconstruction, settings: Settings, title: str, directory: Path, suffix: str = "png") -> None:
    """Draw lengths and shapes of a result, the drift of sensors where it is known, and the track on a floor.

    Args:
        r: all frames.
        settings: the settings of the run.
        title: what was reconstructed.
        directory: in which the figures are written.
        suffix: of their names, which is their format.
    """
    write_lengths_figure(r, title, directory / f"lengths.{suffix}")
    write_shape_figure(r, settings.probability, settings.load_threshold_n, title, directory / f"shape.{suffix}")
    if r.drift is not None and r.drift_sigma is not None:
        write_drift_figure(r, r.drift, r.drift_sigma, title, directory / f"sensor_drift.{suffix}")
    if r.contacts is not None:
        write_track_figure(r, settings.probability, title, directory / f"track.{suffix}")


def write_lengths_figure(r: Reconstruction, title: str, path: Path) -> None:
    """Draw each tendon's length over time with its 95 % band, and where it bends or has no reading (paper's Fig. 8).

    Of a long run each panel shows, for each of `PIECES`, the mean and the range of its frames.
    """
    count = len(r.structure.tendons)
    figure, axes = panels_over_time(count, min(count, 4), 1.55, "tendon length [mm]")
    for e, axis in enumerate(axes):
        draw_length(axis, r, e)
    figure.suptitle(f"{title}: tendon lengths (each panel has its own scale)")
    long = len(r) > LONG_FRAMES
    each = f"{(r.t_s[-1] - r.t_s[0]) / PIECES:.2g} s"
    handles = [
        Line2D([], [], color=BLUE, label=f"measured, mean of {each}" if long else "measured"),
        *([Patch(color=BLUE, alpha=0.5, label=f"its range in {each}")] if long else []),
        Patch(color=BLUE, alpha=0.25, label="its 95 % band"),
        Line2D([], [], color=BLACK, lw=0.8, ls="--", label="of the estimated shape"),
        Patch(color=ORANGE, alpha=0.3, label="bending: height is the share of frames" if long else "bending"),
        Patch(color=GREY, alpha=0.4, label="no usable reading: from above" if long else "no usable reading"),
    ]
    add_legend_below(figure, handles, 3 if long else 5)
    save_figure(figure, path)


def draw_length(axis: Axes, r: Reconstruction, e: int) -> None:
    """Draw the length of tendon `e` in mm, with its band, and where it bends or has no reading.

    Of a tendon without a sensor only the length of the estimated shape is drawn.
    """
    has_sensor = r.structure.is_sensed[e]
    length_mm = 1e3 * r.length_m[:, e]
    half_mm = BAND * (1e3 * np.where(np.isfinite(r.sigma_m[:, e]), r.sigma_m[:, e], np.nan))
    predicted_mm = 1e3 * r.predicted_m[:, e]
    missing = has_sensor & ((r.flags[:, e] & LEFT_OUT) != 0)
    bending = has_sensor & (r.mode[:, e] == Mode.BENDING) & ~missing
    if len(r) > LONG_FRAMES:
        band_mm = _draw_pieces(axis, r.t_s, length_mm, half_mm, predicted_mm)
        _draw_shares(axis, r.t_s, bending, missing)
    else:
        band_mm = length_mm - half_mm, length_mm + half_mm
        axis.fill_between(r.t_s, *band_mm, color=BLUE, alpha=0.25, lw=0)
        axis.plot(r.t_s, length_mm, color=BLUE, lw=0.9)
        axis.plot(r.t_s, predicted_mm, color=BLACK, lw=0.6, ls="--")
        for where, color, alpha in ((bending, ORANGE, 0.3), (missing, GREY, 0.4)):
            if where.any():
                across = axis.get_xaxis_transform()
                axis.fill_between(r.t_s, 0, 1, where=where, transform=across, color=color, alpha=alpha, lw=0)
    finish_panel(axis, np.concatenate([length_mm[np.isfinite(length_mm)], predicted_mm]))
    a, b = r.structure.tendons[e]
    told = "" if has_sensor else ", no sensor"
    axis.set_title(f"tendon {e} ({a}-{b}){told}{BAND_IS_CUT if cuts(axis, *band_mm) else ''}", fontsize=8, pad=2, y=1)


def _draw_pieces(
    axis: Axes,
    t_s: NDArray[np.float64],
    length_mm: NDArray[np.float64],
    half_mm: NDArray[np.float64],
    predicted_mm: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw a length in pieces, mean and range, and the mean of the estimated shape; return the mean 95 % band drawn."""
    middle_s, mean_mm, mean_half_mm = (mean_of_pieces(values) for values in (t_s, length_mm, half_mm))
    low_mm, high_mm = (extreme.reduceat(length_mm, _piece_starts(len(t_s))) for extreme in (np.fmin, np.fmax))
    axis.fill_between(middle_s, low_mm, high_mm, color=BLUE, alpha=0.5, lw=0)
    band_mm = mean_mm - mean_half_mm, mean_mm + mean_half_mm
    axis.fill_between(middle_s, *band_mm, color=BLUE, alpha=0.25, lw=0)
    axis.plot(middle_s, mean_mm, color=BLUE, lw=0.9)
    axis.plot(middle_s, mean_of_pieces(predicted_mm), color=BLACK, lw=0.6, ls="--")
    return band_mm


def _draw_shares(axis: Axes, t_s: NDArray[np.float64], bending: NDArray[np.bool_], missing: NDArray[np.bool_]) -> None:
    """Draw the share of frames in each piece that bend, from below, and that have no usable reading, from above."""
    middle_s, bent, left_out = (mean_of_pieces(np.asarray(values, float)) for values in (t_s, bending, missing))
    across = axis.get_xaxis_transform()
    axis.fill_between(middle_s, 0, bent, color=ORANGE, alpha=0.3, lw=0, step="mid", transform=across)
    axis.fill_between(middle_s, 1 - left_out, 1, color=GREY, alpha=0.4, lw=0, step="mid", transform=across)


def mean_of_pieces(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of `PIECES` consecutive pieces of (frames,) values, without those that are nan; nan of none."""
    starts = _piece_starts(len(values))
    known = np.isfinite(values)
    count = np.add.reduceat(known.astype(np.int64), starts)
    total = np.add.reduceat(np.where(known, values, 0.0), starts)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _piece_starts(frames: int) -> NDArray[np.int64]:
    return (np.arange(PIECES) * frames) // PIECES


def write_drift_figure(
    r: Reconstruction, drift: NDArray[np.float64], sigma: NDArray[np.float64], title: str, path: Path
) -> None:
    """Draw the drift of each sensor over time; those of tendons between anchors are red.

    Each of these has its 95 % band; the other sensors have one together, from their lowest to their highest.

    Args:
        r: all frames.
        drift: (frames, tendons) relative change of resistance.
        sigma: (frames, tendons) its standard deviation.
        title: what was reconstructed.
        path: of the file.
    """
    figure = Figure(figsize=(8, 4.5))
    axis = figure.subplots(gridspec_kw=within_margins(figure, left=0.75, right=0.15, bottom=0.85, top=0.4))
    percent, half = 100 * drift, 100 * BAND * sigma
    sensed, is_reference = r.structure.sensed_tendons, r.structure.joins_anchors
    others = [e for e in sensed if not is_reference[e]]
    references = [e for e in sensed if is_reference[e]]
    for band, color in [*(([e], RED) for e in references), (others, BLUE)]:
        if band:
            low, high = (percent - half)[:, band].min(axis=1), (percent + half)[:, band].max(axis=1)
            axis.fill_between(r.t_s, low, high, color=color, alpha=0.15, lw=0)
            axis.plot(r.t_s, percent[:, band], color=color, lw=0.9)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("drift of resistance [%]")
    axis.set_title(f"{title}: drift of the sensors, with 95 % bands", fontsize=11)
    handles = [Line2D([], [], color=BLUE, label="sensors, with one band for all")]
    if (r.structure.joins_anchors & r.structure.is_sensed).any():
        handles.append(Line2D([], [], color=RED, label="references: tendons between anchors, with a band for each"))
    add_legend_below(figure, handles, 2)
    add_grid(axis)
    axis.margins(x=0)
    save_figure(figure, path)


def write_shape_figure(r: Reconstruction, probability: float, load_threshold_n: float, title: str, path: Path) -> None:
    """Draw the structure at the start and when it was farthest from there, and below, heights of nodes over time.

    Args:
        r: all frames.
        probability: of the ellipsoids.
        load_threshold_n: loads are drawn that are larger, and larger than two of their sigmas.
        title: what was reconstructed.
        path: of the file.
    """
    frames = interesting_frames(r)
    scale = Scale.of(r, frames, probability, load_threshold_n)
    arrows = [LoadArrows.of(r, k, load_threshold_n, scale.load_mm_per_n) for k in frames]
    drawn_mm = np.concatenate([1e3 * r.node_position_m.reshape(-1, 3), *(some.tail_mm for some in arrows)])
    rows = -(-len(frames) // 2)
    figure, grid, below = _panels_and_one_below(rows)
    for panel, (k, some) in enumerate(zip(frames, arrows, strict=True)):
        axis = figure.add_subplot(grid[divmod(panel, 2)], projection="3d")
        draw_structure(axis, r, k, probability, scale)
        some.draw(axis)
        set_cube(axis, drawn_mm, 0.52, fontsize=8)
        axis.set_title(f"t = {r.t_s[k]:.2f} s", fontsize=10)
    draw_heights(below, r, nodes_of_interest(r, load_threshold_n), frames)
    figure.suptitle(f"{title}: shape with {100 * probability:g} % ellipsoids × {scale.magnification}")
    load_label = f"load over {load_threshold_n:g} N, {scale.load_mm_per_n:g} mm per N"
    handles = [
        *structure_handles(),
        Patch(color=RED, alpha=0.4, label=f"ellipsoid × {scale.magnification}"),
        *([anchor_handle()] if len(r.structure.anchors) else []),
        Line2D([], [], color=GREY, lw=1, label="at the start"),
        *([Line2D([], [], color=PURPLE, lw=2, label=load_label)] if r.loads else []),
    ]
    add_legend_below(figure, handles, 4)
    save_figure(figure, path)


def _panels_and_one_below(rows: int) -> tuple[Figure, GridSpec, Axes]:
    """Return a figure with the places of rows of two panels, and a wide panel below, with room for legends."""
    figure = Figure(figsize=(11, 5 * rows + 4))
    above = within_margins(figure, left=0.3, right=0.3, bottom=4.0, top=0.9)
    below = within_margins(figure, left=0.7, right=1.0, bottom=1.15, top=5 * rows + 0.45)
    grid = figure.add_gridspec(rows, 2, wspace=0.0, hspace=0.06, **above)
    return figure, grid, figure.add_subplot(figure.add_gridspec(1, 1, **below)[0])


def nodes_of_interest(r: Reconstruction, load_threshold_n: float) -> list[int]:
    """Return the nodes that carry loads in the most frames; where none is loaded, those that move most."""
    loaded = np.zeros(r.structure.node_count) if r.loads is None else r.loads.is_certain(load_threshold_n).sum(axis=0)
    if loaded.any():
        most = np.argsort(-loaded, kind="stable")[: min(len(HEIGHT_COLORS), np.count_nonzero(loaded))]
    else:
        most = np.argsort(-np.ptp(r.node_position_m, axis=0).max(axis=-1), kind="stable")[: len(HEIGHT_COLORS)]
    return sorted(int(node) for node in most)


def draw_heights(axis: Axes, r: Reconstruction, nodes: list[int], frames: list[int]) -> None:
    """Draw the change of height of nodes since the start in mm, with 95 % bands, and mark the frames drawn above."""
    for node, color in zip(nodes, HEIGHT_COLORS, strict=False):
        height_mm = 1e3 * (r.node_position_m[:, node, 2] - r.node_position_m[0, node, 2])
        half_mm = BAND * 1e3 * np.sqrt(r.node_covariance_m2[:, node, 2, 2])
        axis.fill_between(r.t_s, height_mm - half_mm, height_mm + half_mm, color=color, alpha=0.25, lw=0)
        axis.plot(r.t_s, height_mm, color=color, lw=1.1, label=f"node {node}")
    for k in frames:
        axis.axvline(r.t_s[k], color=GREY, lw=0.8, ls=":")
    axis.set_xlabel("time [s]")
    axis.set_ylabel("height since the start [mm]")
    axis.set_title(
        "Height of the nodes that are loaded or move most, with 95 % bands; dotted: the instants above", fontsize=9
    )
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
    axis.margins(x=0 if len(r) > 1 else 0.05)
    add_grid(axis)


def interesting_frames(r: Reconstruction) -> list[int]:
    """Return the first frame, and the one farthest from it in each of the following parts of the run."""
    moved = np.sum((r.node_position_m - r.node_position_m[0]) ** 2, axis=(1, 2))
    parts = np.array_split(np.arange(len(r)), MOST_FRAMES - 1)
    return sorted({0, *(int(part[np.argmax(moved[part])]) for part in parts if len(part))})
