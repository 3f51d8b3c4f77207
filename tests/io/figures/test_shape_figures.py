"""The figure of a shape with its loads."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tensegraph.io.figures.shape_figures import (
    draw_length,
    load_arrows,
    mean_of_pieces,
    write_lengths_figure,
    write_shape_figure,
)
from tensegraph.models.values.readings import Mode


def test_an_arrow_ends_at_the_node_it_pushes(loaded) -> None:
    """2 N downwards is 60 mm, from above; at a sigma of 0.3 N, 0.5 N is not drawn."""
    loaded.loads.sigma_n[15, 8] = 0.3
    arrows = load_arrows(loaded, 15, 0.2)
    np.testing.assert_allclose(arrows.push_mm, [[0, 0, -60]])
    np.testing.assert_allclose(arrows.tail_mm + arrows.push_mm, 1e3 * loaded.node_position_m[15, [5]])
    assert len(load_arrows(loaded, 12, 0.2).tail_mm) == 2
    assert len(load_arrows(loaded, 0, 0.2).tail_mm) == 0
    assert len(load_arrows(replace(loaded, loads=None), 15, 0.2).tail_mm) == 0


@pytest.mark.parametrize("known", [True, False])
def test_the_figure_is_drawn_with_loads_and_without(loaded, tmp_path, known) -> None:
    shapes = loaded if known else replace(loaded, loads=None)
    write_shape_figure(shapes, 0.95, 0.2, "toy", tmp_path / "shape.png")
    assert (tmp_path / "shape.png").read_bytes().startswith(b"\x89PNG")


def test_a_long_run_is_drawn_in_pieces_by_hand(loaded, tmp_path, monkeypatch) -> None:
    """100 frames in 25 pieces of four: means without those that are nan, and nan where nothing is known."""
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.PIECES", 25)
    values = np.arange(100.0)
    values[4:8] = np.nan
    values[8] = np.nan
    means = mean_of_pieces(values)
    assert means[0] == 1.5
    assert np.isnan(means[1])
    assert means[2] == 10.0
    assert means[-1] == 97.5
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.LONG_FRAMES", 99)
    axis = Figure().subplots()
    loaded.mode[:50, 3] = int(Mode.BENDING)
    draw_length(axis, loaded, 3)
    measured, predicted = axis.lines
    assert len(measured.get_xdata()) == len(predicted.get_xdata()) == 25
    np.testing.assert_allclose(measured.get_ydata(), 180.0)
    write_lengths_figure(loaded, "toy", tmp_path / "lengths.png")
    assert (tmp_path / "lengths.png").read_bytes().startswith(b"\x89PNG")
