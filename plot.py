"""Plots of a run on axes of matplotlib, which are given or made: `tensegraph.plot`."""

from typing import TYPE_CHECKING

import numpy as np

from .models.structure.reconstruction import Reconstruction
from .models.values.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d import Axes3D


def shape(result: Reconstruction, t_s: float, ax: "Axes3D | None" = None, *, probability: float = 0.95) -> "Axes3D":
    """Draw the structure with its ellipsoids at the frame nearest to a time, and in grey at the start.

    Args:
        result: the run.
        t_s: time on the host's clock.
        ax: axes with `projection="3d"`; new ones in a new figure if None.
        probability: of the ellipsoids.

    Returns:
        The axes, in mm, which show all places where the structure is in the run.

    Raises:
        InputError: for a time outside the run, or axes of two dimensions.
    """
    from .io.figures.structure_view import Scale, draw_structure  # matplotlib takes a third of a second to import
    from .io.figures.style import set_cube

    k = result.frame_at(t_s)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure().add_subplot(projection="3d")
    if ax.name != "3d":
        raise InputError(f"ax: expected axes with projection='3d', got {type(ax).__name__}")
    scale = Scale.of(result, [k], probability)
    draw_structure(ax, result, k, probability, scale)
    set_cube(ax, 1e3 * result.node_position_m.reshape(-1, 3), 0.52)
    ax.set_title(f"t = {result.t_s[k]:.2f} s, ellipsoids × {scale.magnification}")
    return ax


def length(result: Reconstruction, tendon: int, ax: "Axes | None" = None) -> "Axes":
    """Draw a tendon's length over time, measured with its 95 % band and estimated, and where it bends or is left out.

    Args:
        result: the run.
        tendon: number of the tendon, from 0.
        ax: axes; new ones in a new figure if None.

    Returns:
        The axes, in mm over s.

    Raises:
        InputError: when there is no such tendon.
    """
    from .io.figures.shape_figures import draw_length

    count = len(result.structure.tendons)
    if isinstance(tendon, bool) or not isinstance(tendon, int | np.integer) or tendon not in range(count):
        raise InputError(f"tendon: expected a whole number from 0 to {count - 1}, got {tendon!r}")
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure().add_subplot()
    draw_length(ax, result, tendon)
    ax.set_xlabel("time [s]")
    ax.set_ylabel("length [mm]")
    return ax
