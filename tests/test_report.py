"""What a run says and draws of loads: rows and arrows worked by hand, and the figure itself."""

import itertools
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegraph import Reconstruction, Status, Structure, open_trial, stream
from tensegraph.commands.reconstruct import load_rows, rest_balance
from tensegraph.io.figures.shape_figures import load_arrows, write_shape_figure
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.statics import Mechanics

ROBUSTNESS = Path(__file__).parents[1] / "examples" / "robustness.py"


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
    """Node 5 for 99 frames of 0.02 s, node 8 for 10 of them, which is too short."""
    rows = dict(load_rows(pressed, 0.2))
    assert rows["largest load"] == "2.00 N at node 5, t = 0.02 s"
    assert rows["nodes above 0.2 N for 1 s"] == "5 (2.0 s)"


def test_no_load_is_long_enough(pressed) -> None:
    assert dict(load_rows(pressed, 3.0))["nodes above 3 N for 1 s"] == "none"


def test_without_stiffness_nothing_is_said(pressed, rest) -> None:
    assert load_rows(replace(pressed, loads=None), 0.2) == []
    assert rest_balance(rest) == []


def test_the_balance_at_rest(structure, rest) -> None:
    mechanics = Mechanics(np.full(24, 400.0), structure.natural_length_m, 0.03, 0.02)
    rows = rest_balance(replace(rest, mechanics=mechanics, unbalanced_n=(0.4, 0.0021)))
    assert rows == [("forces at rest", "0.400 N rms unbalanced as given, 0.002 N after taring")]


def test_an_arrow_ends_at_the_node_it_pushes(pressed) -> None:
    """2 N downwards is 60 mm, from above; at a sigma of 0.3 N, 0.5 N is not drawn."""
    pressed.loads.sigma_n[15, 8] = 0.3
    arrows = load_arrows(pressed, 15, 0.2)
    np.testing.assert_allclose(arrows.push_mm, [[0, 0, -60]])
    np.testing.assert_allclose(arrows.tail_mm + arrows.push_mm, 1e3 * pressed.node_position_m[15, [5]])
    assert len(load_arrows(pressed, 12, 0.2).tail_mm) == 2
    assert len(load_arrows(pressed, 0, 0.2).tail_mm) == 0
    assert len(load_arrows(replace(pressed, loads=None), 15, 0.2).tail_mm) == 0


@pytest.mark.parametrize("known", [True, False])
def test_the_figure_is_drawn_with_loads_and_without(pressed, tmp_path, known) -> None:
    shapes = pressed if known else replace(pressed, loads=None)
    write_shape_figure(shapes, 0.95, 0.2, "toy", tmp_path / "shape.png")
    assert (tmp_path / "shape.png").read_bytes().startswith(b"\x89PNG")


def test_the_example_of_robustness(trial_copy) -> None:
    """On the first seconds of the example: a figure, and a table in which rods without mass are worse."""
    path = trial_copy(rows=115)
    command = [sys.executable, ROBUSTNESS, path, "--draws", "1", "--figure", path.parent / "dead.png"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=path.parent, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert (path.parent / "dead.png").read_bytes().startswith(b"\x89PNG")
    first, header, _, *rows = done.stdout.splitlines()
    assert first.startswith("press_01, RMSE / sigma [mm] with 0, 1, 2 ... dead: ")
    assert first.count(" / ") == 1 + 7
    assert header == "| the estimator is told | press_01, live |"
    error_mm = {name.strip(): float(value) for _, name, value, _ in (row.split("|") for row in rows)}
    assert len(error_mm) == 9
    assert error_mm["as in trial.toml"] < min(error_mm["rods without mass"], error_mm["no mechanics at all"])


def test_a_dead_sensor_is_left_out_once_the_rest_is_over(example) -> None:
    """Its wire breaks at 2 s: from then on the ADC reads full scale, its length is missing, all others are there."""
    robustness = runpy.run_path(str(ROBUSTNESS))
    trial = open_trial(example)
    rows = itertools.takewhile(lambda row: row.host_s < 3, robustness["open_circuit"](trial, [7]))
    shapes = list(stream(rows, trial.description))
    missing = np.array([~shape.lengths.usable for shape in shapes])
    t_s = np.array([shape.t_s for shape in shapes])
    assert not missing[t_s < 1.9].any()
    assert missing[t_s > 2.2, 7].all()
    assert not np.delete(missing, 7, axis=1).any()
