"""Colours and style of all figures. The colours are Okabe and Ito's, which are told apart by all kinds of eyes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

BLUE = "#0072B2"
SKY_BLUE = "#56B4E9"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#999999"
BLACK = "#000000"

BAND = 1.96
"""Sigmas of a 95 % band."""
DPI = 110


def add_grid(
    axis: Axes, *, along: Literal["both", "x", "y"] = "both", which: Literal["major", "minor", "both"] = "major"
) -> None:
    """Add the thin grid of all figures."""
    axis.grid(alpha=0.3, lw=0.4, axis=along, which=which)


def add_legend_below(figure: Figure, handles: Sequence[Artist], columns: int) -> None:
    """Add one legend for all panels, below them."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def save_figure(figure: Figure, path: Path, dpi: int = DPI) -> None:
    """Write a PNG."""
    figure.savefig(path, dpi=dpi)


def structure_handles() -> list[Line2D]:
    """Return legend entries for rods and tendons, as they are drawn in space."""
    return [
        Line2D([], [], color=BLACK, lw=3, label="rod"),
        Line2D([], [], color=BLUE, label="tendon, stretched"),
        Line2D([], [], color=ORANGE, label="tendon, bent"),
        Line2D([], [], color=GREY, ls=":", label="tendon without reading"),
    ]


def anchor_handle() -> Line2D:
    """Return the legend entry for an anchor."""
    return Line2D([], [], color=GREEN, marker="^", ls="", label="anchor")
