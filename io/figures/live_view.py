"""The moving shape in a window of a separate process, because drawing takes longer than one frame."""

from multiprocessing.queues import Queue

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import TensegraphError
from ..viewer.shape_process import ShapeProcess, arrived_shapes
from .structure_view import StructureDrawing

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
