"""The drawing that moves."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import tensegraph
from tensegraph import open_trial


def test_the_live_drawing_moves(example) -> None:
    from tensegraph.io.figures.live_view import StructureDrawing

    trial = open_trial(example)
    shapes = list(tensegraph.stream(list(trial.readings())[:300], trial.description))
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
