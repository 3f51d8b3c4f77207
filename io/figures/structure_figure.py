"""The picture of a structure: rods, rigid bodies, tendons and anchors, with the numbers of the nodes."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ...models.structure_description import DescribedStructure
from .style import BLACK, BLUE, GREEN, GREY, PURPLE, add_legend_below, anchor_handle, save_figure, set_cube


def write_structure_figure(told: DescribedStructure, shape_m: NDArray[np.float64], title: str, path: Path) -> None:
    """Draw a structure at (nodes, 3) positions."""
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    axis = figure.add_subplot(projection="3d")
    at_mm = 1e3 * shape_m
    s, own = told.structure, told.own_rods
    for rods, look in ((s.rods[:own], {"color": BLACK, "lw": 3}), (s.rods[own:], {"color": PURPLE, "lw": 2})):
        for rod in rods:
            axis.plot(*at_mm[rod].T, solid_capstyle="round", **look)
    for tendon, is_sensed in zip(s.tendons, s.is_sensed, strict=True):
        axis.plot(*at_mm[tendon].T, color=BLUE if is_sensed else GREY, ls="-" if is_sensed else ":", lw=1.2)
    axis.scatter(*at_mm[s.anchors].T, marker="^", color=GREEN, s=30)
    for node, place_mm in enumerate(at_mm):
        axis.text(*place_mm, f" {node}", fontsize=8)
    set_cube(axis, at_mm, 0.55, fontsize=8)
    figure.suptitle(title)
    add_legend_below(figure, _handles(told), 3)
    save_figure(figure, path)


def _handles(told: DescribedStructure) -> list[Line2D]:
    s = told.structure
    handles = [Line2D([], [], color=BLACK, lw=3, label="rod")] if told.own_rods else []
    handles += [Line2D([], [], color=PURPLE, lw=2, label="rigid body")] if told.bodies else []
    handles.append(Line2D([], [], color=BLUE, lw=1.2, label="tendon"))
    handles += [Line2D([], [], color=GREY, ls=":", label="tendon without a sensor")] if len(s.unsensed) else []
    return handles + ([anchor_handle()] if len(s.anchors) else [])
