"""Figures of a run: lengths over time, the structure in space. Colours are Okabe and Ito's, safe for all eyes."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from ...models.settings import Settings
from ...models.structure.reconstruction import Reconstruction
from ...models.values.readings import LEFT_OUT, Mode

BLUE, ORANGE, GREEN, RED, GREY, BLACK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#999999", "#000000"
PURPLE = "#CC79A7"
LOAD_MM_PER_N = 30.0
"""Length of a load's arrow."""
SURE = 2.0
"""Sigmas above which a load is drawn."""


def write_figures(r: Reconstruction, settings: Settings, title: str, directory: Path) -> None:
    """Draw lengths.png and shape.png of a result, and sensor_drift.png where drift is known."""
    write_lengths_figure(r, title, directory / "lengths.png")
    write_shape_figure(r, settings.probability, settings.load_threshold_n, title, directory / "shape.png")
    if r.drift is not None and r.drift_sigma is not None:
        write_drift_figure(r, r.drift, r.drift_sigma, title, directory / "sensor_drift.png")


def write_lengths_figure(r: Reconstruction, title: str, path: Path) -> None:
    """Draw each tendon's length over time with its 95 % band, and where it bends or has no reading (paper's Fig. 8)."""
    count = len(r.structure.tendons)
    columns = min(count, 4)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 1.55 * rows + 1.2), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    for e in range(count):
        _draw_length(axes[e], r, e)
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[max(count - columns, 0) : count]:
        axis.set_xlabel("time [s]")
    figure.supylabel("tendon length [mm]")
    figure.suptitle(f"{title}: tendon lengths (each panel has its own scale)")
    figure.legend(
        handles=[
            Line2D([], [], color=BLUE, label="measured"),
            Patch(color=BLUE, alpha=0.25, label="its 95 % band"),
            Line2D([], [], color=BLACK, lw=0.8, ls="--", label="of the estimated shape"),
            Patch(color=ORANGE, alpha=0.3, label="bending"),
            Patch(color=GREY, alpha=0.4, label="no usable reading"),
        ],
        loc="outside lower center",
        ncols=5,
        frameon=False,
    )
    figure.savefig(path, dpi=110)


def _draw_length(axis: Axes, r: Reconstruction, e: int) -> None:
    length_mm, sigma_mm = 1e3 * r.length_m[:, e], 1e3 * np.where(np.isfinite(r.sigma_m[:, e]), r.sigma_m[:, e], np.nan)
    axis.fill_between(r.t_s, length_mm - 1.96 * sigma_mm, length_mm + 1.96 * sigma_mm, color=BLUE, alpha=0.25, lw=0)
    axis.plot(r.t_s, length_mm, color=BLUE, lw=0.9)
    axis.plot(r.t_s, 1e3 * r.predicted_m[:, e], color=BLACK, lw=0.6, ls="--")
    missing = (r.flags[:, e] & LEFT_OUT) != 0
    bending = (r.mode[:, e] == Mode.BENDING) & ~missing
    for where, color, alpha in ((bending, ORANGE, 0.3), (missing, GREY, 0.4)):
        axis.fill_between(
            r.t_s, 0, 1, where=where, transform=axis.get_xaxis_transform(), color=color, alpha=alpha, lw=0
        )
    known = np.concatenate([length_mm[np.isfinite(length_mm)], 1e3 * r.predicted_m[:, e]])
    low, high = known.min(), known.max()
    margin = max(0.15 * (high - low), 1.5)
    axis.set_ylim(low - margin, high + margin)
    a, b = r.structure.tendons[e]
    axis.set_title(f"tendon {e} ({a}-{b})", fontsize=8, pad=2)
    axis.tick_params(labelsize=7)
    axis.grid(alpha=0.3, lw=0.4)
    axis.margins(x=0)


def write_drift_figure(
    r: Reconstruction, drift: NDArray[np.float64], sigma: NDArray[np.float64], title: str, path: Path
) -> None:
    """Draw the drift that was taken off each sensor over time, with its 95 % band; reference tendons stand out.

    Args:
        r: all frames.
        drift: (frames, tendons) relative change of resistance.
        sigma: (frames, tendons) of it.
        title: what was reconstructed.
        path: of the PNG.
    """
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    for e in range(drift.shape[1]):
        color = BLUE if r.structure.is_free_tendon[e] else RED
        percent, band = 100 * drift[:, e], 196 * sigma[:, e]
        axis.fill_between(r.t_s, percent - band, percent + band, color=color, alpha=0.03, lw=0)
        axis.plot(r.t_s, percent, color=color, lw=0.9)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("drift of resistance [%]")
    axis.set_title(f"{title}: drift taken off the sensors, with 95 % bands")
    axis.legend(
        handles=[
            Line2D([], [], color=BLUE, label="sensor"),
            Line2D([], [], color=RED, label="sensor of a tendon between anchors, the reference"),
        ],
        frameon=False,
    )
    axis.grid(alpha=0.3, lw=0.4)
    axis.margins(x=0)
    figure.savefig(path, dpi=110)


def write_shape_figure(r: Reconstruction, probability: float, load_threshold_n: float, title: str, path: Path) -> None:
    """Draw the structure at the start and when it was farthest from there, with ellipsoids and loads.

    Args:
        r: all frames.
        probability: of the ellipsoids.
        load_threshold_n: loads are drawn that are larger, and larger than two of their sigmas.
        title: what was reconstructed.
        path: of the PNG.
    """
    frames = interesting_frames(r)
    figure = Figure(figsize=(11, 11.5 if len(frames) > 2 else 6.5), layout="constrained")
    arrows = [load_arrows_mm(r, k, load_threshold_n) for k in frames]
    limits = _limits_mm(r, np.concatenate([tails for tails, _ in arrows]))
    for panel, (k, (tails_mm, pushes_mm)) in enumerate(zip(frames, arrows, strict=True)):
        axis = figure.add_subplot(-(-len(frames) // 2), min(len(frames), 2), panel + 1, projection="3d")
        _draw_structure(axis, r, k, probability, limits)
        axis.quiver(*tails_mm.T, *pushes_mm.T, color=PURPLE, lw=2, arrow_length_ratio=0.2)
        axis.set_title(f"t = {r.t_s[k]:.2f} s", fontsize=10)
    figure.suptitle(f"{title}: shape with {100 * probability:g} % ellipsoids, drawn to scale")
    load_label = f"load over {load_threshold_n:g} N, {LOAD_MM_PER_N:g} mm per N"
    figure.legend(
        handles=[
            Line2D([], [], color=BLACK, lw=3, label="rod"),
            Line2D([], [], color=BLUE, label="tendon, stretched"),
            Line2D([], [], color=ORANGE, label="tendon, bent"),
            Line2D([], [], color=GREY, ls=":", label="tendon without reading"),
            Patch(color=RED, alpha=0.4, label="ellipsoid"),
            Line2D([], [], color=GREEN, marker="^", ls="", label="anchor"),
            Line2D([], [], color=GREY, lw=1, label="at the start"),
            *([Line2D([], [], color=PURPLE, lw=2, label=load_label)] if r.loads else []),
        ],
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )
    figure.savefig(path, dpi=110)


def interesting_frames(r: Reconstruction, count: int = 4) -> list[int]:
    """Return the first frame, and the one farthest from it in each of the following parts of the run."""
    moved = np.sum((r.node_position_m - r.node_position_m[0]) ** 2, axis=(1, 2))
    parts = np.array_split(np.arange(len(r)), count - 1)
    return sorted({0, *(int(part[np.argmax(moved[part])]) for part in parts if len(part))})


def load_arrows_mm(
    r: Reconstruction, k: int, load_threshold_n: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (loads, 3) tails and (loads, 3) arrows of a frame's loads: each ends at the node that it pushes."""
    if r.loads is None:
        return np.empty((0, 3)), np.empty((0, 3))
    force_n = np.nan_to_num(r.loads.force_n[k])
    drawn = np.linalg.norm(force_n, axis=-1) > np.maximum(load_threshold_n, SURE * r.loads.sigma_n[k])
    pushes_mm = LOAD_MM_PER_N * force_n[drawn]
    return 1e3 * r.node_position_m[k, drawn] - pushes_mm, pushes_mm


def _limits_mm(r: Reconstruction, more_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3, 2) limits of a cube that holds every node of every frame, and some points more."""
    points_mm = np.concatenate([1e3 * r.node_position_m.reshape(-1, 3), more_mm])
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    middle, half = 0.5 * (low + high), 0.52 * float(np.max(high - low))
    return np.stack([middle - half, middle + half], axis=1)


def _draw_structure(axis: Axes3D, r: Reconstruction, k: int, probability: float, limits: NDArray[np.float64]) -> None:
    now_mm, start_mm = 1e3 * r.node_position_m[k], 1e3 * r.node_position_m[0]
    for a, b in r.structure.rods:
        axis.plot(*start_mm[[a, b]].T, color=GREY, lw=1, alpha=0.6)
        axis.plot(*now_mm[[a, b]].T, color=BLACK, lw=3, solid_capstyle="round")
    for e, (a, b) in enumerate(r.structure.tendons):
        seen = np.isfinite(r.length_m[k, e])
        color = GREY if not seen else ORANGE if r.mode[k, e] == Mode.BENDING else BLUE
        axis.plot(*now_mm[[a, b]].T, color=color, lw=1.2, ls="-" if seen else ":")
    axis.scatter(*now_mm[r.structure.anchors].T, marker="^", color=GREEN, s=30)
    regions = r.ellipsoids(probability)
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 17), np.linspace(0, np.pi, 9))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    for node in r.structure.free_nodes:
        scaled = 1e3 * regions.axes[k, node] * regions.semi_axis_m[k, node]
        surface = now_mm[node] + sphere @ scaled.T
        axis.plot_surface(*np.moveaxis(surface, -1, 0), color=RED, alpha=0.35, linewidth=0, shade=True)
        axis.text(*(now_mm[node] + 6), str(node), fontsize=7)
    for name, limit in zip("xyz", limits, strict=True):
        getattr(axis, f"set_{name}lim")(*limit)
        getattr(axis, f"set_{name}label")(f"{name} [mm]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.set_box_aspect((1, 1, 1), zoom=0.92)
