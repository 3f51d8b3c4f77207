"""The figure of a shape with its loads."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.io.figures.shape_figures import load_arrows, write_shape_figure


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
