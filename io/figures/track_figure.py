"""The track of a free-standing structure from above, and the nodes that the floor carries over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch
from numpy.typing import NDArray

from ...models.structure.reconstruction import Reconstruction
from ...models.values.chi_squared import chi_squared_quantile
from ...models.values.time_series import median_step_s
from .style import BLACK, BLUE, GREY, RED, add_grid, add_legend_below, color_of, save_figure

ELLIPSES = 12
"""Number of ellipses along a track."""
MOST_COLUMNS = 4000
"""Largest number of instants at which contacts are drawn."""
FAR_FRAMES = 2.0
"""Number of usual steps from an instant to the nearest frame, from which nothing is drawn there."""


def write_track_figure(r: Reconstruction, probability: float, title: str, path: Path) -> None:
    """Draw the centroid from above with ellipses, and the probability that the floor carries each node over time.

    Args:
        r: all frames, in the world.
        probability: of the ellipses.
        title: what was reconstructed.
        path: of the file.
    """
    figure, track, bars = _track_and_contacts()
    centroid_mm = 1e3 * r.centroid_m
    _draw_ellipses(track, centroid_mm, 1e6 * r.centroid_covariance_m2[:, :2, :2], probability)
    track.plot(*centroid_mm[:, :2].T, color=BLUE, lw=1.2)
    track.plot(*centroid_mm[0, :2], color=BLACK, marker="o", ms=5, ls="")
    if r.contacts is not None:
        _draw_bars(bars, r.t_s, r.contacts, 0.0, 0.8, BLUE)
    slides = r.slides
    bars.plot([slip.t_s for slip in slides], [slip.node - 0.05 for slip in slides], color=RED, marker="x", ms=6, ls="")
    figure.suptitle(f"{title}: track of the centroid from above, and nodes on the floor")
    handles = [
        Line2D([], [], color=BLUE, label="centroid"),
        Line2D([], [], color=BLACK, marker="o", ls="", label="start"),
        Patch(color=RED, alpha=0.3, label=f"{100 * probability:g} % ellipse"),
        Patch(color=BLUE, label="carried by the floor (paler: less probable)"),
        Line2D([], [], color=RED, marker="x", ls="", label="slips"),
    ]
    add_legend_below(figure, handles, 5)
    save_figure(figure, path)


def write_followed_figure(
    t_s: NDArray[np.float64],
    estimated_m: NDArray[np.float64],
    true_m: NDArray[np.float64],
    contacts: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
    title: str,
    path: Path,
) -> None:
    """Draw the estimated and the true track from above, and where they are known, both contacts over time.

    Args:
        t_s: (frames,)
        estimated_m: (frames, nodes, 3) in the world.
        true_m: (frames, nodes, 3) in the world; nan where unknown.
        contacts: (frames, nodes) the estimated probabilities and the true contacts; None where they are not known.
        title: what was evaluated.
        path: of the file.
    """
    figure, track, *bars = _track_and_contacts() if contacts is not None else _track_alone()
    track.plot(*(1e3 * true_m.mean(axis=1)[:, :2]).T, color=BLACK, lw=2.5, alpha=0.5)
    track.plot(*(1e3 * estimated_m.mean(axis=1)[:, :2]).T, color=BLUE, lw=1.2)
    if contacts is not None:
        _draw_bars(bars[0], t_s, contacts[0], 0.05, 0.4, BLUE)
        _draw_bars(bars[0], t_s, np.nan_to_num(contacts[1]), 0.45, 0.4, BLACK)
    figure.suptitle(f"{title}: track of the centroid from above{', and nodes on the floor' if bars else ''}")
    handles = [Line2D([], [], color=BLUE, lw=3, label="estimated"), Line2D([], [], color=BLACK, lw=3, label="true")]
    add_legend_below(figure, handles, 2)
    save_figure(figure, path)


def _track_and_contacts() -> tuple[Figure, Axes, Axes]:
    figure = Figure(figsize=(12, 5.5), layout="constrained")
    track, bars = figure.subplots(1, 2, width_ratios=[1, 1.3])
    _label_track(track)
    bars.set_xlabel("time [s]")
    bars.set_ylabel("node")
    return figure, track, bars


def _track_alone() -> tuple[Figure, Axes]:
    """Return the panel of the track alone, for a robot that no floor carries."""
    figure = Figure(figsize=(7, 5.5), layout="constrained")
    track = figure.subplots()
    _label_track(track)
    return figure, track


def _label_track(track: Axes) -> None:
    track.set_xlabel("x [mm]")
    track.set_ylabel("y [mm]")
    track.set_aspect("equal", adjustable="datalim")
    add_grid(track)


def _draw_ellipses(
    axis: Axes, centroid_mm: NDArray[np.float64], covariance_mm2: NDArray[np.float64], probability: float
) -> None:
    for k in np.unique(np.linspace(0, len(centroid_mm) - 1, ELLIPSES).astype(int)):
        variance, axes = np.linalg.eigh(covariance_mm2[k])
        diameter_mm = 2 * np.sqrt(chi_squared_quantile(probability, 2) * np.maximum(variance, 0))
        angle = float(np.rad2deg(np.arctan2(axes[1, 1], axes[0, 1])))
        axis.add_patch(
            Ellipse(tuple(centroid_mm[k, :2]), diameter_mm[1], diameter_mm[0], angle=angle, color=RED, alpha=0.3, lw=0)
        )


def _draw_bars(
    axis: Axes, t_s: NDArray[np.float64], contacts: NDArray[np.float64], bottom: float, height: float, color: str
) -> None:
    """Draw a row for each node, whose darkness at each time is the probability; none where frames are far apart."""
    nodes = contacts.shape[1]
    frame_s = median_step_s(t_s, of_one=0.02)
    span_s = float(t_s[-1] - t_s[0])
    columns_s = np.linspace(t_s[0], t_s[-1], min(round(span_s / frame_s) + 1, MOST_COLUMNS))
    half_s = 0.5 * span_s / max(len(columns_s) - 1, 1) or 0.5 * frame_s
    nearest = np.searchsorted(0.5 * (t_s[1:] + t_s[:-1]), columns_s)
    is_near = np.abs(t_s[nearest] - columns_s) < FAR_FRAMES * max(frame_s, 2 * half_s)
    for node in range(nodes):
        low = node - 0.45 + bottom
        extent = (float(t_s[0]) - half_s, float(t_s[-1]) + half_s, low, low + height)
        shade = np.zeros((1, len(columns_s), 4))
        shade[:] = color_of(color)
        shade[0, :, 3] = np.where(is_near, contacts[nearest, node], 0.0)
        axis.imshow(shade, extent=extent, aspect="auto", interpolation="nearest", origin="lower")
        axis.axhline(node - 0.5, color=GREY, lw=0.3)
    axis.set_ylim(-0.5, nodes - 0.5)
    axis.set_yticks(range(nodes))
