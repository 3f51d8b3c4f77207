"""Where the panels of figures stand: their margins are set, and not searched for."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tensegraph.io.figures.style import panels_over_time, save_figure, within_margins


def test_margins_in_inches_become_parts_of_the_figure() -> None:
    """A figure of 10 by 5 inches: 1 inch is a tenth of its width and a fifth of its height."""
    place = within_margins(Figure(figsize=(10, 5)), left=1.0, right=0.5, bottom=1.0, top=0.5)
    assert place == pytest.approx({"left": 0.1, "right": 0.95, "bottom": 0.2, "top": 0.9})


@pytest.mark.filterwarnings("error")
def test_any_name_can_be_a_title(tmp_path) -> None:
    """No font has a sign for a bell; `$x^{$` would be a formula that does not end."""
    figure, (axis,) = panels_over_time(1, 1, 1.55, "length [mm]")
    axis.set_title("bell \a, $x^{$")
    figure.suptitle("bell \a, $x^{$")
    axis.text(0, 0, "$x^{$")
    save_figure(figure, tmp_path / "any.png")
    assert (tmp_path / "any.png").stat().st_size > 0


@pytest.mark.parametrize(("count", "columns", "timed"), [(1, 1, [0]), (6, 4, [2, 3, 4, 5])])
def test_no_panel_reaches_into_another_or_out_of_the_figure(count, columns, timed) -> None:
    """With labels of five characters and titles; the lowest panel of each column has the labels of time."""
    figure, axes = panels_over_time(count, columns, 1.55, "tendon length [mm]")
    for k, axis in enumerate(axes):
        axis.plot([0.0, 1000.0], [-120.5, -118.0])
        axis.set_title(f"tendon {k} (10-11)", fontsize=8, pad=2, y=1)
        axis.tick_params(labelsize=7)
    FigureCanvasAgg(figure).draw()
    boxes = [axis.get_tightbbox() for axis in axes]
    assert all(not a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    edges = np.array([box.extents for box in boxes])
    assert (edges[:, :2] > 0).all()
    assert (edges[:, 2:] < figure.bbox.size).all()
    assert [k for k, axis in enumerate(axes) if axis.get_xlabel()] == timed
