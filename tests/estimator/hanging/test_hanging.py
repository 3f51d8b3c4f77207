"""A structure that swings about two anchors: three seconds and a half of the twin, and what does not hang."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by, refusal_of
from pipelines import pipeline_of
from plan_edits import PLANS, replaced
from tensegraph import InputError, Settings, evaluate, open_trial, reconstruct, simulate, stream
from tensegraph.estimator.hanging.hanging_filter import HangingFilter
from tensegraph.models.structure.shape import Shape, Status
from trial_edits import cut, rewritten, write_positions

pytestmark = pytest.mark.usefixtures("undrawn")

HINGE = """extends = "press.toml"
name = "hinge"
duration_s = 3.5
[rest]
seconds = 1.0
[structure]
anchors = [0, 1]
anchor_position_m = [[0.0, 0.0, 0.5], [0.18371, 0.0, 0.5]]
[load]
random = []
[[load.press]]
at_s = 1.5
ramp_s = 0.5
hold_s = 1.0
nodes = [8]
force_n = 2.0
direction = [0.0, 0.2, -1.0]
"""


JACK = """extends = "prism.toml"
name = "jack"
duration_s = 3.5
[rest]
seconds = 1.0
[structure]                     # three crossed rods, joined in the middle; the one with the sensor hangs upright
rods = [[0, 1], [0, 2], [0, 3], [0, 4], [0, 5], [0, 6]]
tendons = [[1, 3], [1, 4], [1, 5], [1, 6], [2, 3], [2, 4], [2, 5], [2, 6], [3, 5], [3, 6], [4, 5], [4, 6]]
rod_length_m = 0.15
natural_length_m = 0.196
anchors = [1]
anchor_position_m = [[0.0, 0.0, 0.5]]
node_position_m = [
    [0.0, 0.0, 0.35], [0.0, 0.0, 0.5], [0.0, 0.0, 0.2], [0.15, 0.0, 0.35], [-0.15, 0.0, 0.35], [0.0, 0.15, 0.35],
    [0.0, -0.15, 0.35],
]
[boards]
tendon_of_channel = [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]]
[[imu]]
rod = 0
fraction = 0.5
rate_hz = 100.0
rate_noise_rad_per_s = 0.001
force_noise_m_per_s2 = 0.03
rate_bias_rad_per_s = 0.01
force_bias_m_per_s2 = 0.1
misalignment_rad = 0.017
range_m_per_s2 = 39.0
[fault]
open_circuit = []
[load]
random = []
hold = []
[[load.press]]
at_s = 1.5
ramp_s = 0.5
hold_s = 1.0
nodes = [5]
force_n = 0.5
direction = [0.0, 0.0, -1.0]
"""


@pytest.fixture(scope="module")
def hinge(tmp_path_factory) -> Path:
    """The folder of a trial without inertial sensors, made by `simulate`."""
    folder = tmp_path_factory.mktemp("hinge")
    (folder / "press.toml").write_text(PLANS["press"].read_text().split("[[load.random]]")[0])
    (folder / "hinge.toml").write_text(HINGE.replace("[load]\nrandom = []\n", ""))
    printed_by("simulate", "hinge.toml", "--out", "hinge_01", cwd=folder)
    return folder


def test_it_is_reconstructed_and_evaluated(hinge) -> None:
    """At rest the tilt is that of the weight, anchors stay in place, and ellipsoids in the world hold the nodes."""
    printed_by("reconstruct", "hinge_01", "--live", "--figures", "none", cwd=hinge)
    shape = np.loadtxt(hinge / "results" / "hinge_01_live" / "shape.csv", delimiter=",", skiprows=1)
    assert shape[:, 1:7] == pytest.approx(np.tile([0, 0, 0.5, 0.18371, 0, 0.5], (len(shape), 1)), abs=0.002)
    assert not (hinge / "results" / "hinge_01_live" / "contacts.csv").exists()
    (score,) = json.loads(printed_by("evaluate", "results/hinge_01_live", "--json", cwd=hinge))
    assert score["pose"]["still_tilt_rms_deg"] < 5.0
    assert score["pose"]["shape_rmse_m"] < 0.8 * score["pose"]["held_rmse_m"]
    assert score["consistency"]["coverage_95"] > 0.85


def test_a_sensor_on_an_upright_rod_turns_it_nowhere(tmp_path) -> None:
    """Gravity does not tell how the sensor is turned about its rod, in whose axes its rates would count."""
    (tmp_path / "prism.toml").write_text(PLANS["prism"].read_text())
    (tmp_path / "jack.toml").write_text(JACK)
    trial = simulate(tmp_path / "jack.toml", tmp_path / "jack_03", 3)
    assert evaluate(reconstruct(trial, "live"), trial).consistency.coverage_95 > 0.95


def test_biases_of_cheap_sensors_are_learned_at_rest(tmp_path) -> None:
    """0.27 rad/s, of which gravity does not tell the part about a rod that is nearly upright."""
    for name, edits in (("press", ()), ("hang", (("duration_s = 24.0", "duration_s = 7.0"),))):
        text = replaced(PLANS[name].read_text(), *edits)
        (tmp_path / f"{name}.toml").write_text(text.split("[[load.random]]")[0])
    trial = simulate(tmp_path / "hang.toml", tmp_path / "hang_11", 11)
    for number, sign in enumerate((1, -1)):
        file = tmp_path / "hang_11" / f"imu{number}.csv"
        header, *rows = file.read_text().splitlines()
        samples = np.array([row.split(",") for row in rows], dtype=float)
        samples[:, 1:4] += sign * np.array([0.2, -0.1, 0.15])
        file.write_text("\n".join([header, *(",".join(f"{x:.4f}" for x in row) for row in samples), ""]))
    evaluation = evaluate(reconstruct(trial, "live"), trial)
    assert evaluation.absolute.nodes.rmse_m < 0.01
    assert evaluation.consistency.coverage_95 > 0.9


def told(hinge: Path, folder: Path, edit) -> Path:
    """A copy of trial.toml, edited, with the files beside it."""
    for source in (hinge / "hinge_01").iterdir():
        (folder / source.name).write_bytes(source.read_bytes())
    rewritten(folder / "trial.toml", edit)
    return folder


def upside_down(text: str) -> str:
    """Return trial.toml with every node of the rest shape as far above the anchors as it was below."""
    line = next(line for line in text.splitlines() if line.startswith("node_position_m"))
    turned = re.sub(r", ([-\d.e]+)\]", lambda z: f", {1.0 - float(z[1])}]", line)
    return text.replace(line, turned)


REFUSED = {
    "ground: expected none with one or two anchors": lambda text: text + "\n[ground]\nheight_m = 0.003\n",
    "rest: expected seconds above 0 and node_position_m with one or two": lambda text: re.sub(
        r"\nseconds = 1.0", "\nseconds = 0.0", text
    ),
    r"rest.node_position_m\[0\]: expected structure.anchor_position_m\[0\]": lambda text: re.sub(
        r"anchor_position_m = \[\[[^\]]*\]", "anchor_position_m = [[0.0, 0.1, 0.5]", text
    ),
    "expected the centre of mass below the anchors, with gravity along -z, got one 1[78]. degrees": upside_down,
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_does_not_hang_is_refused(message: str, hinge, tmp_path) -> None:
    with pytest.raises(InputError, match=message):
        open_trial(told(hinge, tmp_path, REFUSED[message]))


def test_methods_for_anchored_structures_are_refused(hinge) -> None:
    result = refusal_of("reconstruct", "hinge_01", "--method", "ukf", "--out", "ukf", cwd=hinge)
    assert "expected one of batch, live for a structure with one or two anchors" in result


def test_a_plan_with_a_floor_under_it_is_refused(hinge) -> None:
    (hinge / "floor.toml").write_text((hinge / "hinge.toml").read_text() + "[ground]\nfriction = 0.8\n")
    assert "ground: expected none with 2 anchors" in refusal_of("simulate", "floor.toml", "--out", "floor", cwd=hinge)


def test_after_a_gap_of_months_it_may_be_turned_in_any_way_about_its_anchors(hinge) -> None:
    """Where forces are not known: its centroid, 0.1 m below the anchors, is not metres away from them."""
    trial = open_trial(hinge / "hinge_01").description
    pipeline = pipeline_of(trial)
    readings = (row for row in open_trial(hinge / "hinge_01").readings() if row.host_s < 0.1)
    lengths = next(pipeline.lengths(readings))
    x = pipeline.rest.node_position_m
    poses = HangingFilter(pipeline.rest, trial.robot, Settings())
    for t_s in (0.0, 0.02, 1e7):
        step = poses.hang(Shape(t_s, x, 1e-8 * np.eye(x.size), Status.OK, lengths), None, ())
    assert np.linalg.eigvalsh(step.covariance).min() > 0
    assert 0.1 < np.sqrt(np.trace(step.covariance[3:6, 3:6])) < 2.0


@pytest.mark.parametrize("method", ["live", "batch"])
@pytest.mark.parametrize(("unit", "warnings"), [(1.0, set()), (1000.0, {"range 0"})])
def test_ranges_of_which_none_is_used_are_named(method, unit, warnings, hinge, tmp_path) -> None:
    """The range of a node at rest, in metres and in millimetres."""
    table = '[[range]]\nfile = "range.csv"\nbeacon_position_m = [[2.0, 0.0, 0.5]]\n'
    path = told(hinge, tmp_path, lambda text: f"{text}\n{table}")
    cut(path, 1.5)
    rest_m = open_trial(hinge / "hinge_01").description.rest_position_m
    range_m = unit * float(np.linalg.norm(rest_m[8] - [2.0, 0.0, 0.5]))
    rows = [f"{t_s:.2f},0,8,{range_m:.4f}" for t_s in np.arange(0.05, 1.5, 0.1)]
    (path / "range.csv").write_text("\n".join(["t_s,beacon,node,range_m", *rows, ""]))
    trial = open_trial(path)
    pipeline = pipeline_of(trial.description)
    shapes = list(pipeline.estimate(trial.readings(), method))
    assert pipeline.warnings().keys() == warnings
    assert sum(len(shape.outlying_ranges) for shape in shapes) == (len(rows) if warnings else 0)


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_position_that_is_wrong_is_left_out(method, hinge, tmp_path) -> None:
    """A sign and two digits too many in one cell: the structure is where it was without that cell."""
    path = told(hinge, tmp_path, lambda text: text + '\n[[position]]\nfile = "positions.csv"\n')
    cut(path, 1.5)
    rest_m = open_trial(hinge / "hinge_01").description.rest_position_m
    t_s = np.arange(0.05, 1.5, 0.05)
    x = np.tile(rest_m, (len(t_s), 1, 1))
    shapes = {}
    for name, wrong in (("right", 0), ("wrong", 1)):
        x[20, 10, 2] -= 100.0 * wrong
        write_positions(path / "positions.csv", t_s, x, (8, 10, 11))
        shapes[name] = list(stream(open_trial(path).readings(), open_trial(path).description, method))
    assert not any(shape.contradicted_positions for shape in shapes["right"])
    assert [nodes for shape in shapes["wrong"] for nodes in shape.contradicted_positions] == [10]
    for right, wrong in zip(shapes["right"], shapes["wrong"], strict=True):
        np.testing.assert_allclose(wrong.node_position_m, right.node_position_m, atol=0.003)
