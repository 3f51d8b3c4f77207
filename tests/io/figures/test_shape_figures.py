"""The figure of a shape with its loads."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tensegraph.io.figures.shape_figures import (
    draw_length,
    mean_of_pieces,
    nodes_of_interest,
    write_drift_figure,
    write_lengths_figure,
    write_shape_figure,
)
from tensegraph.io.figures.structure_view import LoadArrows, Scale, round_down
from tensegraph.io.figures.track_figure import write_track_figure
from tensegraph.models.structure.shape import Covariances
from tensegraph.models.values.readings import Flag, Mode


def test_an_arrow_ends_at_the_node_it_pushes(loaded) -> None:
    """2 N downwards is 60 mm, from above; at a sigma of 0.3 N, 0.5 N is not drawn."""
    loaded.loads.sigma_n[15, 8] = 0.3
    arrows = LoadArrows.of(loaded, 15, 0.2, 30.0)
    np.testing.assert_allclose(arrows.push_mm, [[0, 0, -60]])
    np.testing.assert_allclose(arrows.tail_mm + arrows.push_mm, 1e3 * loaded.node_position_m[15, [5]])
    assert len(LoadArrows.of(loaded, 12, 0.2, 30.0).tail_mm) == 2
    assert len(LoadArrows.of(loaded, 0, 0.2, 30.0).tail_mm) == 0
    assert len(LoadArrows.of(replace(loaded, loads=None), 15, 0.2, 30.0).tail_mm) == 0


@pytest.mark.parametrize("known", [True, False])
def test_the_figure_is_drawn_with_loads_and_without(loaded, tmp_path, known) -> None:
    shapes = loaded if known else replace(loaded, loads=None)
    write_shape_figure(shapes, 0.95, 0.2, "toy", tmp_path / "shape.png")
    assert (tmp_path / "shape.png").read_bytes().startswith(b"\x89PNG")


def test_lengths_are_rounded_down_to_1_2_or_5() -> None:
    assert [round_down(value) for value in (0.2, 4.9, 5.0, 36.4, 0.999)] == pytest.approx([0.2, 2, 5, 20, 0.5])


def test_a_large_load_is_drawn_within_the_figure(loaded) -> None:
    """137 N at 30 mm per N would be an arrow of 4 m."""
    loaded.loads.force_n[15, 5] = [0, 0, -137]
    scale = Scale.of(loaded, [0, 15], 0.95)
    arrows = LoadArrows.of(loaded, 15, 0.2, scale.load_mm_per_n)
    assert 0.1 * scale.extent_mm < np.abs(arrows.push_mm).max() <= 0.4 * scale.extent_mm


@pytest.mark.parametrize(("sigma_mm", "magnification"), [(0.1, 50), (2.0, 5), (1000.0, 1)])
def test_ellipsoids_are_magnified_while_they_leave_the_structure_visible(loaded, sigma_mm, magnification) -> None:
    """The structure is 0.3 m wide: at 95 %, 2 mm is 5.6 mm of semi-axis, of which five are below 36 mm."""
    alike = np.broadcast_to(np.eye(3) * (1e-3 * sigma_mm) ** 2, (*loaded.node_position_m.shape, 3))
    shapes = replace(loaded, covariances=Covariances.of_nodes(alike))
    assert Scale.of(shapes, [0], 0.95).magnification == magnification


def test_the_nodes_that_are_loaded_are_of_interest(loaded) -> None:
    """Nodes 5 and 8 are loaded; without loads those that move most."""
    assert nodes_of_interest(loaded, 0.2) == [5, 8]
    assert len(nodes_of_interest(replace(loaded, loads=None), 0.2)) <= 3


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


@pytest.mark.parametrize("long_frames", [3000, 50], ids=["frames", "pieces"])
def test_a_band_that_leaves_the_axis_is_told(loaded, monkeypatch, long_frames) -> None:
    """A length that moves by 0.1 mm has an axis of 3 mm: a sigma of 2 mm leaves it, one of 0.5 mm does not."""
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.LONG_FRAMES", long_frames)
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.PIECES", 10)
    loaded.sigma_m[:, 3], loaded.sigma_m[:, 4] = 0.002, 0.0005
    loaded.sigma_m[7, 4] = np.inf
    wide, narrow = Figure().subplots(1, 2)
    draw_length(wide, loaded, 3)
    draw_length(narrow, loaded, 4)
    assert wide.get_title().endswith("; the band is cut at the axis")
    assert "cut" not in narrow.get_title()


def test_the_track_of_one_frame_is_drawn(loaded, tmp_path) -> None:
    """Its width in the rows of contacts is that of a frame, and not zero."""
    first = replace(loaded[0.0:0.01], contacts=np.full((1, loaded.structure.node_count), 0.5))
    write_track_figure(first, 0.95, "one frame", tmp_path / "track.png")
    assert (tmp_path / "track.png").stat().st_size > 10_000


def test_tendons_without_a_sensor_are_not_in_the_figure_of_drift(loaded, tmp_path, monkeypatch) -> None:
    """Those between anchors and one other have none: the legend has one kind of sensor."""
    saved: list[Figure] = []
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.save_figure", lambda figure, path: saved.append(figure))
    free = np.flatnonzero(~loaded.structure.joins_anchors)
    between = np.flatnonzero(loaded.structure.joins_anchors)
    drift = np.zeros((len(loaded), 24))
    shapes = replace(loaded, structure=replace(loaded.structure, unsensed=[*between, free[0]]))
    write_drift_figure(shapes, drift, drift + 0.001, "toy", tmp_path / "drift.png")
    write_drift_figure(loaded, drift, drift + 0.001, "toy", tmp_path / "drift.png")
    without, every = saved
    assert len(without.axes[0].lines) == 24 - len(between) - 1
    assert [text.get_text() for text in without.legends[0].texts] == ["sensors, with one band for all"]
    assert len(every.axes[0].lines) == 24
    assert len(every.legends[0].texts) == 2


@pytest.mark.parametrize("long", [False, True])
def test_of_a_tendon_without_a_sensor_only_the_estimated_length_is_drawn(loaded, monkeypatch, long) -> None:
    """No grey panel, as of a sensor that is broken: tendon 3 has none, tendon 4 one that is not read."""
    if long:
        monkeypatch.setattr("tensegraph.io.figures.shape_figures.LONG_FRAMES", 99)
        monkeypatch.setattr("tensegraph.io.figures.shape_figures.PIECES", 25)
    loaded.length_m[:, [3, 4]] = np.nan
    loaded.flags[:, [3, 4]] = int(Flag.MISSING)
    loaded.mode[:, 3] = int(Mode.BENDING)
    shapes = replace(loaded, structure=replace(loaded.structure, unsensed=[3]))
    without, broken = Figure().subplots(1, 2)
    draw_length(without, shapes, 3)
    draw_length(broken, shapes, 4)
    assert without.get_title().endswith(", no sensor")
    assert "no sensor" not in broken.get_title()
    assert [np.isfinite(line.get_ydata()).any() for line in without.lines] == [False, True]
    assert _filled(without) < 1e-12
    assert _filled(broken) == pytest.approx(1.98, rel=0.05)


def _filled(axis: Axes) -> float:
    """Return the area of what is filled over the whole height of a panel, in seconds times heights of the panel."""
    across = axis.get_xaxis_transform()
    return sum(
        0.5 * abs(np.sum(x * np.roll(y, 1) - np.roll(x, 1) * y))
        for area in axis.collections
        if area.get_transform() == across
        for x, y in (path.vertices.T for path in area.get_paths())
    )
