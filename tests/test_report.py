"""What a run says and draws of loads: rows and arrows worked by hand, and the figure itself."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Reconstruction, Status, Structure
from tensegraph.io.figures import load_arrows_mm, write_shape_figure
from tensegraph.models.external_loads import ExternalLoads
from tensegraph.models.rest import RestShape
from tensegraph.models.statics import Mechanics
from tensegraph.report import load_rows, rest_balance


@pytest.fixture
def pressed(structure: Structure, rest: RestShape) -> Reconstruction:
    """Two seconds at rest at 50 Hz: node 5 carries 2 N in all but the first frame, node 8 0.5 N in ten of them."""
    count, tendons = 100, len(structure.tendons)
    force = np.full((count, structure.node_count, 3), np.nan)
    force[:, structure.free_nodes] = 0.0
    force[1:, 5, 2], force[10:20, 8, 0] = -2.0, 0.5
    sigma = np.full((count, structure.node_count), np.inf)
    sigma[:, structure.free_nodes] = 0.1
    return Reconstruction(
        structure,
        np.arange(count) / 50,
        np.repeat(rest.node_position_m[None], count, axis=0),
        np.repeat(rest.covariance_m2[None], count, axis=0),
        (Status.OK,) * count,
        np.full((count, tendons), 0.18),
        np.full((count, tendons), 0.001),
        np.zeros((count, tendons), dtype=np.int64),
        np.zeros((count, tendons), dtype=np.int64),
        loads=ExternalLoads(force, sigma),
    )


def test_rows_by_hand(pressed) -> None:
    """Node 5 for 99 frames of 0.02 s, node 8 for 10 of them, which is too short; noise: chi-square of 4 or more."""
    rows = dict(load_rows(pressed, 0.2))
    assert rows["largest load"] == "2.00 N at node 5, t = 0.02 s"
    assert rows["nodes above 0.2 N for 1 s"] == "5 (2.0 s)"
    # 3 nodes of two degrees, exp(-2) = 13.5 %, 6 of three, 26.1 %, less the loaded ones: 21.3 %
    assert rows["  by noise alone"] == "at most 21% of the time, for an unloaded node"


def test_no_load_is_long_enough(pressed) -> None:
    assert dict(load_rows(pressed, 3.0))["nodes above 3 N for 1 s"] == "none"


def test_without_stiffness_nothing_is_said(pressed, rest) -> None:
    assert load_rows(replace(pressed, loads=None), 0.2) == []
    assert rest_balance(rest) == []


def test_the_balance_at_rest(structure, rest) -> None:
    mechanics = Mechanics(np.full(24, 400.0), structure.natural_length_m, 0.03, 0.02)
    told = rest_balance(replace(rest, mechanics=mechanics, unbalanced_n=(0.4, 0.0021)))
    assert told == [("forces at rest", "0.400 N rms unbalanced as given, 0.002 N after taring")]


def test_an_arrow_ends_at_the_node_it_pushes(pressed) -> None:
    """2 N downwards is 60 mm, from above; at a sigma of 0.3 N, 0.5 N is not drawn."""
    pressed.loads.sigma_n[15, 8] = 0.3
    tails_mm, pushes_mm = load_arrows_mm(pressed, 15, 0.2)
    np.testing.assert_allclose(pushes_mm, [[0, 0, -60]])
    np.testing.assert_allclose(tails_mm + pushes_mm, 1e3 * pressed.node_position_m[15, [5]])
    assert len(load_arrows_mm(pressed, 12, 0.2)[0]) == 2
    assert len(load_arrows_mm(pressed, 0, 0.2)[0]) == 0
    assert len(load_arrows_mm(replace(pressed, loads=None), 15, 0.2)[0]) == 0


@pytest.mark.parametrize("known", [True, False])
def test_the_figure_is_drawn_with_loads_and_without(pressed, tmp_path, known) -> None:
    shapes = pressed if known else replace(pressed, loads=None)
    write_shape_figure(shapes, 0.95, 0.2, "toy", tmp_path / "shape.png")
    assert (tmp_path / "shape.png").read_bytes().startswith(b"\x89PNG")
