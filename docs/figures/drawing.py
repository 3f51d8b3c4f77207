"""What the figures of the documentation share: colours of Okabe and Ito, and a structure in space."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from tensegraph import Structure
from tensegraph.io.figures.style import BLACK as BLACK
from tensegraph.io.figures.style import BLUE as BLUE
from tensegraph.io.figures.style import GREEN as GREEN
from tensegraph.io.figures.style import GREY as GREY
from tensegraph.io.figures.style import ORANGE as ORANGE

HERE = Path(__file__).parent
TRIAL = HERE.parents[1] / "examples" / "press_01"


def draw_structure(
    axes: Axes3D,
    structure: Structure,
    node_position_m: NDArray[np.float64],
    colour: str,
    *,
    dashed: bool = False,
    numbered: bool = False,
) -> None:
    """Draw rods and tendons of a shape, in millimetres."""
    x_mm = 1e3 * node_position_m
    style = "--" if dashed else "-"
    axes.add_collection3d(Line3DCollection(x_mm[structure.rods], colors=colour, linewidths=3.0, linestyles=style))
    axes.add_collection3d(Line3DCollection(x_mm[structure.tendons], colors=colour, linewidths=0.8, linestyles=style))
    axes.scatter(*x_mm[structure.anchors].T, marker="^", s=45, color=BLACK, depthshade=False)
    for node, position in enumerate(x_mm if numbered else ()):
        axes.text(position[0] + 4, position[1] + 4, position[2] + 6, str(node), fontsize=8)


def set_space(axes: Axes3D, node_position_m: NDArray[np.float64]) -> None:
    """Set equal scales around some shape, and name the axes."""
    low = 1e3 * node_position_m.min(axis=0) - 15
    high = 1e3 * node_position_m.max(axis=0) + 15
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.1)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.tick_params(labelsize=7)
    axes.view_init(elev=18, azim=-58)


def save(figure: Figure, name: str) -> None:
    """Write a figure beside its script."""
    figure.savefig(HERE / name, dpi=120)
