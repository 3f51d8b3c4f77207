"""Figures of an evaluation: axes without extent, nodes that are told apart, legends beside curves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph.io.figures.evaluation_figures import _draw_load_pairs, write_errors_figure, write_heights_figure
from tensegraph.io.figures.track_figure import write_followed_figure
from tensegraph.models.evaluation.evaluation import FaultScore
from tensegraph.models.evaluation.metrics import evaluate


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("errors", [[[0, 0, 0]] * 3, [[0, 0, 0]], [[3, 0, 0]]], ids=["exact", "one, exact", "one"])
def test_no_warning_of_matplotlib(errors, tmp_path) -> None:
    structure = four_nodes()
    evaluation = evaluate(TRUE_M, estimate_of(structure, moved(errors)), truth_of(3))
    assert len(evaluation.compared.t_s) == np.shape(errors)[0]
    for write in (write_errors_figure, write_heights_figure):
        write(evaluation, "trial", tmp_path / "figure.png")
        assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.filterwarnings("error")
def test_a_fault_beyond_the_frames_is_not_drawn(tmp_path) -> None:
    """Its label far beyond the axis left no room for the panels."""
    evaluation = evaluate(TRUE_M, estimate_of(four_nodes(), moved([[3, 0, 0]] * 3)), truth_of(3))
    late = FaultScore("stuck", "tendon 2", 8.0, 1, 1, 0.1)
    write_errors_figure(replace(evaluation, faults=(late,)), "trial", tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.parametrize(("variance_m2", "is_cut"), [(1e-4, True), (1e-8, False)])
def test_a_band_of_heights_that_leaves_the_axis_is_told(monkeypatch, variance_m2, is_cut) -> None:
    saved: list[Figure] = []
    monkeypatch.setattr(
        "tensegraph.io.figures.evaluation_figures.save_figure", lambda figure, path: saved.append(figure)
    )
    estimate = estimate_of(four_nodes(), moved([[0, 0, 1]] * 3), variance_m2=(1e-6, 1e-6, variance_m2))
    write_heights_figure(evaluate(TRUE_M, estimate, truth_of(3)), "trial", Path("heights.png"))
    node, face = (axis.get_title() for axis in saved[0].axes[:2])
    assert node == ("node 3; the band is cut at the axis" if is_cut else "node 3")
    assert face == "face 1-2-3"


def test_every_loaded_node_has_a_colour_and_a_marker_of_its_own() -> None:
    """Of 40 nodes with 1.0, 1.1, ... 4.9 N the 35 with the largest loads are drawn, in their order."""
    true_n = np.tile(1.0 + 0.1 * np.arange(40), (3, 1))
    axis = Figure().subplots()
    _draw_load_pairs(axis, 100 + np.arange(40), true_n, true_n, 0.2)
    nodes = [line for line in axis.lines if str(line.get_label()).startswith("node")]
    assert [line.get_label() for line in nodes] == [f"node {k}" for k in range(105, 140)]
    assert len({(line.get_color(), line.get_marker()) for line in nodes}) == len(nodes) == 35


def test_a_node_without_loads_is_not_drawn() -> None:
    true_n = np.array([[0.0, 3.0, 0.1]])
    axis = Figure().subplots()
    _draw_load_pairs(axis, np.array([4, 5, 6]), true_n, true_n, 0.2)
    assert [line.get_label() for line in axis.lines if str(line.get_label()).startswith("node")] == ["node 5"]


@pytest.mark.parametrize(("carried", "panels", "words"), [(True, 2, "and nodes on the floor"), (False, 1, "above")])
def test_the_track_of_a_robot_that_hangs_has_no_panel_of_the_floor(monkeypatch, carried, panels, words) -> None:
    saved: list[Figure] = []
    monkeypatch.setattr("tensegraph.io.figures.track_figure.save_figure", lambda figure, path: saved.append(figure))
    position_m = moved([[0, 0, 0]] * 3)
    contacts = (np.ones((3, 4)), np.ones((3, 4))) if carried else None
    write_followed_figure(0.02 * np.arange(3), position_m, position_m, contacts, "trial", Path("track.png"))
    assert len(saved[0].axes) == panels
    assert saved[0].get_suptitle().endswith(words)


def test_no_legend_of_the_errors_is_over_a_curve(monkeypatch) -> None:
    """Legends are below the panels that they belong to."""
    saved: list[Figure] = []
    monkeypatch.setattr(
        "tensegraph.io.figures.evaluation_figures.save_figure", lambda figure, path: saved.append(figure)
    )
    evaluation = evaluate(TRUE_M, estimate_of(four_nodes(), moved([[3, 0, 0]] * 3)), truth_of(3))
    write_errors_figure(evaluation, "trial", Path("errors.png"))
    saved[0].draw_without_rendering()
    for axis in saved[0].axes:
        legend = axis.get_legend()
        assert legend is not None
        assert legend.get_window_extent().y1 < axis.get_window_extent().y0
