"""The drawing that moves."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import tensegraph
from tensegraph import open_trial
from tensegraph.io.figures.structure_view import StructureDrawing
from tensegraph.io.figures.style import set_cube


def test_the_live_drawing_moves(example) -> None:
    trial = open_trial(example)
    shapes = list(tensegraph.stream(list(trial.readings())[:40], trial.description))
    figure = Figure(figsize=(8, 8), layout="constrained")
    structure = trial.description.structure
    drawing = StructureDrawing(figure, structure, trial.description.rest_position_m, 0.95)
    drawing.move(shapes[-1])
    (axis,) = figure.axes
    lines = axis.get_lines()
    a, b = structure.rods[0]
    np.testing.assert_allclose(np.array(lines[0].get_data_3d()).T, 1e3 * shapes[-1].node_position_m[[a, b]])
    assert axis.get_title() == f"t = {shapes[-1].t_s:.2f} s"
    node = int(structure.free_nodes[0])
    ellipse = np.array(lines[len(structure.rods) + len(structure.tendons)].get_data_3d()).T
    reach_mm = np.linalg.norm(ellipse - 1e3 * shapes[-1].node_position_m[node], axis=1).max()
    assert reach_mm == pytest.approx(1e3 * shapes[-1].ellipsoids(0.95).semi_axis_m[node, 0], rel=0.01)


def test_a_robot_that_rolls_stays_in_sight(loaded) -> None:
    """By hand, in a cube from -300 to 300 mm: it is shifted along x, once a node is outside, and keeps its size."""
    figure, shape = Figure(), loaded[0]
    drawing = StructureDrawing(figure, loaded.structure, shape.node_position_m, 0.95)
    corners_mm = np.array([[-300.0, -300.0, -300.0], [300.0, 300.0, 300.0]])
    set_cube(drawing.axis, corners_mm, 0.5)
    x_m = shape.node_position_m[:, 0]
    for first_m, limits_mm in ((-0.29, (-300, 300)), (0.5, None), (0.51, None)):
        position_m = shape.node_position_m + np.array([first_m - x_m.min(), 0.0, 0.0])
        drawing.move(replace(shape, node_position_m=position_m))
        middle_mm = 1e3 * (0.5 + 0.5 * np.ptp(x_m))
        expected_mm = limits_mm or (middle_mm - 300, middle_mm + 300)
        assert drawing.axis.get_xlim() == pytest.approx(expected_mm)
        assert drawing.axis.get_ylim() == drawing.axis.get_zlim() == pytest.approx((-300, 300))
