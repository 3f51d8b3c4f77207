"""The structure in space, in one frame or moving: rods, tendons, magnified ellipsoids, loads as arrows."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from ...models.structure.external_loads import LOAD_THRESHOLD_N
from ...models.structure.reconstruction import Reconstruction
from ...models.structure.shape import Shape, ellipsoids
from ...models.structure.structure import Structure
from .style import (
    BLACK,
    GREEN,
    GREY,
    PURPLE,
    RED,
    add_legend_below,
    anchor_handle,
    set_cube,
    structure_handles,
    tendon_style,
)

LONGEST_ARROW = 0.4
"""Longest arrow of a load at most, relative to the largest extent of the structure at the start."""
WIDEST_ELLIPSOID = 0.12
"""Semi-axis of the magnified ellipsoids at most, relative to the same extent: they should not cover the structure."""
MAGNIFIED_BY = (1, 2, 5, 10, 20, 50)
DRAWN_FIRST = ("start", "tendon", "rod", "anchor", "ellipsoid", "load", "name")
"""Order in which the parts are drawn, from below to above. Matplotlib would order whole lines by their middle, which
hides rods behind tendons."""


@dataclass(frozen=True, slots=True)
class Scale:
    """How large ellipsoids and loads are drawn in all panels of a figure."""

    extent_mm: float
    """Largest extent of the structure at the start."""
    magnification: int
    """Drawn over true size of the ellipsoids."""
    load_mm_per_n: float
    """Length of the arrow of a load."""

    @classmethod
    def of(
        cls, r: Reconstruction, frames: list[int], probability: float, load_threshold_n: float = LOAD_THRESHOLD_N
    ) -> Self:
        """Return the largest scale of round numbers at which some frames are legible.

        Args:
            r: all frames.
            frames: the frames that are drawn.
            probability: of the ellipsoids.
            load_threshold_n: see `drawn_loads`.
        """
        extent_mm = 1e3 * float(np.max(np.ptp(r.node_position_m[0], axis=0)))
        covariance_m2 = r.node_covariance_m2[frames][:, r.structure.free_nodes]
        semi_axis_mm = 1e3 * ellipsoids(covariance_m2, probability).semi_axis_m
        widest_mm = np.max(semi_axis_mm, initial=0.0, where=np.isfinite(semi_axis_mm))
        fitting = [m for m in MAGNIFIED_BY if m * widest_mm <= WIDEST_ELLIPSOID * extent_mm]
        force_n = [np.linalg.norm(drawn_loads(r, k, load_threshold_n)[1], axis=-1) for k in frames]
        largest_n = float(np.max(np.concatenate(force_n), initial=load_threshold_n))
        return cls(extent_mm, max(fitting, default=1), round_down(LONGEST_ARROW * extent_mm / largest_n))


def round_down(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1, 2, 5) if digit * power <= value * (1 + 1e-12)))


def drawn_loads(r: Reconstruction, k: int, load_threshold_n: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return nodes and (nodes, 3) loads of frame `k` that are certain to be above a threshold."""
    if r.loads is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    certain = r.loads.is_certain(load_threshold_n)[k]
    return np.flatnonzero(certain), r.loads.force_n[k, certain]


@dataclass(frozen=True, slots=True, eq=False)
class LoadArrows:
    """The loads of one frame as arrows, each of which ends at the loaded node."""

    tail_mm: NDArray[np.float64]
    """(loads, 3) positions at which the arrows begin."""
    push_mm: NDArray[np.float64]
    """(loads, 3) vectors from there to the node."""

    @classmethod
    def of(cls, r: Reconstruction, k: int, load_threshold_n: float, mm_per_n: float) -> Self:
        """Return the arrows of the loads of frame `k` that are drawn, see `drawn_loads`."""
        nodes, force_n = drawn_loads(r, k, load_threshold_n)
        push_mm = mm_per_n * force_n
        return cls(1e3 * r.node_position_m[k, nodes] - push_mm, push_mm)

    def draw(self, axis: Axes3D) -> None:
        """Draw them."""
        axis.quiver(*self.tail_mm.T, *self.push_mm.T, color=PURPLE, lw=2, arrow_length_ratio=0.4, zorder=_order("load"))


def draw_structure(axis: Axes3D, r: Reconstruction, k: int, probability: float, scale: Scale) -> None:
    """Draw the structure of frame `k` in mm with its ellipsoids, and in grey the rods at the start."""
    axis.computed_zorder = False
    now_mm = 1e3 * r.node_position_m[k]
    start_mm = 1e3 * r.node_position_m[0]
    rods, tendons = r.structure.rods, r.structure.tendons
    _draw_lines(axis, start_mm[rods], "start", colors=GREY, linewidths=1, alpha=0.6)
    _draw_lines(axis, now_mm[rods], "rod", colors=BLACK, linewidths=3, capstyle="round")
    styles = [tendon_style(length_m, mode) for length_m, mode in zip(r.length_m[k], r.mode[k], strict=True)]
    colors, dashes = ([style[name] for style in styles] for name in ("color", "linestyle"))
    _draw_lines(axis, now_mm[tendons], "tendon", colors=colors, linewidths=1.2, linestyles=dashes)
    axis.scatter(*now_mm[r.structure.anchors].T, marker="^", color=GREEN, s=30, zorder=_order("anchor"), alpha=1)
    _draw_ellipsoids(axis, r, k, probability, scale)
    for node, position_mm in enumerate(now_mm + 0.03 * scale.extent_mm):
        axis.text(*position_mm, str(node), fontsize=7, zorder=_order("name"))
    axis.tick_params(labelsize=7)
    axis.set_box_aspect((1, 1, 1), zoom=0.92)


def _draw_lines(axis: Axes3D, ends_mm: NDArray[np.float64], part: str, **style: Any) -> None:
    """Draw lines between (lines, 2, 3) ends."""
    axis.add_collection3d(Line3DCollection(ends_mm, zorder=_order(part), **style))


def _draw_ellipsoids(axis: Axes3D, r: Reconstruction, k: int, probability: float, scale: Scale) -> None:
    """Draw them at their magnification, the wider the more transparent: one as large as the structure hides it."""
    now_mm = 1e3 * r.node_position_m[k]
    regions = ellipsoids(r.node_covariance_m2[k], probability)
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 17), np.linspace(0, np.pi, 9))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    for node in r.structure.free_nodes:
        semi_axis_mm = 1e3 * scale.magnification * regions.semi_axis_m[node]
        surface = now_mm[node] + sphere @ (regions.axes[node] * semi_axis_mm).T
        alpha = 0.35 * min(1.0, WIDEST_ELLIPSOID * scale.extent_mm / float(np.max(semi_axis_mm)))
        axis.plot_surface(
            *np.moveaxis(surface, -1, 0),
            color=RED,
            alpha=max(alpha, 0.03),
            linewidth=0,
            shade=True,
            zorder=_order("ellipsoid"),
        )


def _order(part: str) -> int:
    return DRAWN_FIRST.index(part)


class StructureDrawing:
    """The structure in a figure: drawn once, then moved. An ellipsoid is shown by its three principal ellipses."""

    def __init__(
        self, figure: Figure, structure: Structure, rest_position_m: NDArray[np.float64], probability: float
    ) -> None:
        self._structure = structure
        self._probability = probability
        axis = figure.add_subplot(projection="3d")
        self.axis = axis
        rest_mm = 1e3 * rest_position_m
        self._rods = [axis.plot(*rest_mm[rod].T, color=BLACK, lw=3)[0] for rod in structure.rods]
        self._tendons = [axis.plot(*rest_mm[tendon].T, color=GREY, lw=1.2)[0] for tendon in structure.tendons]
        self._ellipses = {
            int(node): [axis.plot([], [], [], color=RED, lw=0.8)[0] for _ in range(3)] for node in structure.free_nodes
        }
        axis.scatter(*rest_mm[structure.anchors].T, marker="^", color=GREEN, s=30)
        set_cube(axis, rest_mm, 0.6)
        axis.set_box_aspect((1, 1, 1))
        ellipsoid = Line2D([], [], color=RED, lw=0.8, label=f"{100 * probability:g} % ellipsoid")
        anchors = [anchor_handle()] if len(structure.anchors) else []
        add_legend_below(figure, [*structure_handles(), ellipsoid, *anchors], 3)

    def move(self, shape: Shape) -> None:
        """Show another shape, at the same scale."""
        position_mm = 1e3 * shape.node_position_m
        self._follow(position_mm)
        for line, rod in zip(self._rods, self._structure.rods, strict=True):
            line.set_data_3d(*position_mm[rod].T)
        for e, (line, tendon) in enumerate(zip(self._tendons, self._structure.tendons, strict=True)):
            line.set_data_3d(*position_mm[tendon].T)
            line.set(**tendon_style(shape.lengths.length_m[e], shape.lengths.mode[e]))
        regions = shape.ellipsoids(self._probability)
        angle = np.linspace(0, 2 * np.pi, 33)
        for node, ellipses in self._ellipses.items():
            half_axes_mm = 1e3 * (regions.axes[node] * regions.semi_axis_m[node]).T
            for k, ellipse in enumerate(ellipses):
                a = half_axes_mm[k]
                b = half_axes_mm[(k + 1) % 3]
                ellipse.set_data_3d(*(position_mm[node] + np.outer(np.cos(angle), a) + np.outer(np.sin(angle), b)).T)
        self.axis.set_title(f"t = {shape.t_s:.2f} s")

    def _follow(self, position_mm: NDArray[np.float64]) -> None:
        """Shift the cube that is shown along each axis on which one of the (nodes, 3) positions is outside of it.

        The structure is in the middle then, so that one that rolls on is soon found again.
        """
        for name, along_mm in zip("xyz", position_mm.T, strict=True):
            low, high = getattr(self.axis, f"get_{name}lim")()
            if along_mm.min() < low or along_mm.max() > high:
                shift_mm = 0.5 * (along_mm.min() + along_mm.max()) - 0.5 * (low + high)
                getattr(self.axis, f"set_{name}lim")(low + shift_mm, high + shift_mm)
