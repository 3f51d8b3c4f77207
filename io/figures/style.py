"""Colours and style of all figures. The colours are Okabe and Ito's, which are told apart by all kinds of eyes."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from ...models.values.readings import Mode

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
BAND_IS_CUT = "; the band is cut at the axis"
"""What a title says of a band that leaves its axis."""
DPI = 110
TICKS = 4
"""Largest number of steps between ticks of a small panel; ticks take most of the time of a figure of many panels."""
QUICK = 1
"""Level of compression of a PNG: a tenth of the time of a figure less than with level 6, and a file larger by 6 %."""


def add_grid(
    axis: Axes, *, along: Literal["both", "x", "y"] = "both", which: Literal["major", "minor", "both"] = "major"
) -> None:
    """Add the thin grid of all figures."""
    axis.grid(alpha=0.3, lw=0.4, axis=along, which=which)


def cuts(axis: Axes, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Return whether the vertical axis cuts a band from (n,) low to high values, nan where there is none."""
    bottom, top = axis.get_ylim()
    return bool((np.isfinite(low) & (low < bottom)).any() or (np.isfinite(high) & (high > top)).any())


def add_legend_below(figure: Figure, handles: Sequence[Artist], columns: int) -> None:
    """Add one legend for all panels, below them."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def save_figure(figure: Figure, path: Path, dpi: int = DPI) -> None:
    """Write a PNG, or a PDF, by the name of the file.

    Names of trials and faults may have any sign: a `$` is one, and what the font lacks is drawn as a box.
    """
    for text in (*figure.texts, *(text for axis in figure.axes for text in (axis.title, *axis.texts))):
        text.set_parse_math(False)
    options: dict[str, Any] = {"pil_kwargs": {"compress_level": QUICK}} if path.suffix == ".png" else {}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph")
        figure.savefig(path, dpi=dpi, **options)


def within_margins(figure: Figure, *, left: float, right: float, bottom: float, top: float) -> dict[str, float]:
    """Return the place of panels within margins in inches, as a grid of panels takes it: in parts of the figure.

    A layout that is searched for ("constrained") draws the figure twice and measures every text, which takes longer
    than all else in a figure of many panels.
    """
    width, height = figure.get_size_inches()
    return {"left": left / width, "right": 1 - right / width, "bottom": bottom / height, "top": 1 - top / height}


def panels_over_time(count: int, columns: int, height: float, ylabel: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with a grid of panels over the same time, each `height` inches high with its title."""
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, height * rows + 1.4))
    place = within_margins(figure, left=0.75, right=0.12, bottom=0.98, top=0.55)
    grid = figure.add_gridspec(rows, columns, wspace=0.14, hspace=0.22, **place)
    figure.supylabel(ylabel, x=0.1 / figure.get_figwidth())
    axes = [figure.add_subplot(grid[divmod(k, columns)]) for k in range(count)]
    for axis in axes:
        axis.locator_params(nbins=TICKS)
    for axis in axes[:-columns]:
        axis.tick_params(labelbottom=False)
    for axis in axes[-columns:]:
        axis.set_xlabel("time [s]")
    return figure, axes


def finish_panel(axis: Axes, drawn: NDArray[np.float64]) -> None:
    """Show (n,) finite values in mm and a margin in a panel of `panels_over_time`, with small labels and a grid."""
    margin = max(0.15 * float(np.ptp(drawn)), 1.5)
    axis.set_ylim(drawn.min() - margin, drawn.max() + margin)
    axis.tick_params(labelsize=7)
    add_grid(axis)
    axis.margins(x=0)


def set_cube(axis: Axes3D, points_mm: NDArray[np.float64], reach: float, **label: Any) -> None:
    """Show a cube around points, with sides of twice `reach` times their largest extent, and label its axes."""
    low = points_mm.min(axis=0)
    high = points_mm.max(axis=0)
    half = reach * float(np.max(high - low))
    for name, middle in zip("xyz", 0.5 * (low + high), strict=True):
        getattr(axis, f"set_{name}lim")(middle - half, middle + half)
        getattr(axis, f"set_{name}label")(f"{name} [mm]", **label)


def tendon_style(length_m: float, mode: int) -> dict[str, str]:
    """Return colour and line style of a tendon by its measured length, which may be nan, and its mode."""
    if np.isfinite(length_m):
        return {"color": ORANGE if mode == Mode.BENDING else BLUE, "linestyle": "-"}
    return {"color": GREY, "linestyle": ":"}


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


def color_of(text: str, opacity: float = 1.0) -> tuple[float, float, float, float]:
    """Return red, green, blue and opacity, from 0 to 1, of a colour such as #0072B2."""
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue, opacity
