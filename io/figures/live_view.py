"""The moving shape in a window of a separate process, because drawing takes longer than one frame."""

from multiprocessing.queues import Queue

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import TensegraphError
from ..viewer.shape_process import ShapeProcess, arrived_shapes
from .style import (
    BLACK,
    GREEN,
    GREY,
    RED,
    add_legend_below,
    anchor_handle,
    set_cube,
    structure_handles,
    tendon_style,
)

PAUSE_S = 0.05
"""Time between two drawings, in which the window handles its events."""


def check_window() -> None:
    """Check that a window can be opened.

    Raises:
        TensegraphError: when there is no display to open it on.
    """
    if plt.get_backend().lower() == "agg":  # the backend of matplotlib when no other works
        raise TensegraphError("no window can be opened: matplotlib finds no display, or no toolkit (Tk, Qt) for one")


def live_window(structure: Structure, rest_position_m: NDArray[np.float64], probability: float) -> ShapeProcess:
    """Return a process that shows the newest shape in a window, a context manager that closes it at its end."""
    return ShapeProcess(_show, structure, rest_position_m, probability)


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


def _show(
    shapes: "Queue[Shape]", structure: Structure, rest_position_m: NDArray[np.float64], probability: float
) -> None:
    """Draw the newest shape until the window is closed."""
    figure = plt.figure("tensegraph", figsize=(8, 8), layout="constrained")
    drawing = StructureDrawing(figure, structure, rest_position_m, probability)
    figure.show()
    for arrived in arrived_shapes(shapes, PAUSE_S):
        if not plt.fignum_exists(figure.number):
            break
        if arrived:
            drawing.move(arrived[-1])
            figure.canvas.draw_idle()
        figure.canvas.start_event_loop(PAUSE_S)
