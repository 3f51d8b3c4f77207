"""`structure`, and trials that take their structure from a file."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from command_line import printed_by, refusal_of, run
from structures import TOWER, TOWER_M
from tensegraph import Status, open_trial, read_structure, reconstruct, saddle_tower, three_strut
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.twin.engine import Twin
from tensegraph.models.twin.loads import Loads, Press
from tensegraph.models.twin.mjcf import Body, mjcf
from twin_bodies import body

NAMES = ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors", "anchor_position_m")
T_S = np.arange(0, 6.5, 0.1)
STEP_S = 0.002


def shapes_of(
    made: Body, shape_m: np.ndarray, node: int, force_n=(0.2873, 0.0, -0.9578), step_s: float = STEP_S
) -> np.ndarray:
    """What the twin does: it is at rest for two seconds, then pressed at one node with up to this force."""
    size_n = float(np.linalg.norm(force_n))
    twin = Twin(made, step_s, shape_m)
    twin.settle()
    press = Press(at_s=2.0, ramp_s=2.0, hold_s=10.0, nodes=[node], force_n=size_n, direction=force_n)
    motion = twin.run(Loads([press]), round(6.5 / step_s))
    return motion.node_position_m[:: round(0.1 / step_s)]


def write_trial(folder: Path, table: dict, length_m: np.ndarray, tendons) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    told = {**table, "rest": {"seconds": 2.0}, "lengths": {"file": "lengths.csv"}}
    (folder / "trial.toml").write_text(tomlkit.dumps(told))
    noisy_m = length_m + np.random.default_rng(0).normal(0, 3e-4, length_m.shape)
    header = ",".join(["t_s", *(f"l{e}_m" for e in tendons), *(f"s{e}_m" for e in tendons)])
    rows = np.column_stack([T_S, noisy_m[:, tendons], np.full((len(T_S), len(tendons)), 3e-4)])
    np.savetxt(folder / "lengths.csv", rows, fmt="%.6f", delimiter=",", header=header, comments="")
    return folder


def scores(result, true_m) -> tuple[float, float]:
    """Return the root mean square error of the free nodes, in mm, and the share of the 95 % ellipsoids that hold."""
    free = result.structure.free_nodes
    error_m = (result.node_position_m - true_m)[:, free]
    inverse = np.linalg.inv(result.node_covariance_m2[:, free])
    squared = np.einsum("tni,tnij,tnj->tn", error_m, inverse, error_m)
    return 1e3 * float(np.sqrt(np.mean(np.sum(error_m**2, axis=-1)))), float(np.mean(squared < 7.815))


@pytest.mark.parametrize(("structure", "node"), [(three_strut(0.3, 0.15), 4), (TOWER, 7)], ids=["prism", "class 2"])
def test_a_mujoco_model_is_estimated_on_simulated_lengths(structure, node, tmp_path: Path) -> None:
    shape_m = TOWER_M if structure is TOWER else find_rest_shape(structure)
    made = body(structure, push_back=0.02)
    (tmp_path / "robot.xml").write_text(mjcf(made, shape_m, 0.001))
    balanced_m = shapes_of(made, shape_m, node)
    table = {"structure": {"file": "../robot.xml"}}
    trial = write_trial(tmp_path / "trial", table, structure.tendon_length_m(balanced_m), range(len(structure.tendons)))
    assert open_trial(trial).description.mechanics.rod_mass_kg == pytest.approx(0.03)
    error_mm, covered = scores(reconstruct(trial, "live"), balanced_m)
    moved_mm = 1e3 * np.sqrt(np.mean(np.sum((balanced_m - balanced_m[0])[:, 3:] ** 2, axis=-1)))
    assert error_mm < min(2.0, 0.6 * moved_mm)
    assert covered > 0.9


def test_a_tendon_without_a_sensor_pulls_and_is_no_gap(tmp_path: Path) -> None:
    balanced_m = shapes_of(body(TOWER, push_back=0.02), TOWER_M, 7)
    sensed = [e for e in range(15) if e not in (6, 13)]
    table = {
        "structure": {
            **{
                n: getattr(TOWER, n).tolist()
                for n in ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors")
            },
            "anchor_position_m": TOWER.anchor_position_m.tolist(),
            "node_position_m": TOWER_M.tolist(),
            "unsensed": [6, 13],
        },
        "mechanics": {"tendon_stiffness_n_per_m": 400.0, "rod_mass_kg": 0.03},
    }
    result = reconstruct(write_trial(tmp_path / "trial", table, TOWER.tendon_length_m(balanced_m), sensed), "live")
    assert np.isnan(result.length_m[:, [6, 13]]).all()
    assert {str(status) for status in result.status[:20]} == {"ok"}  # nothing is missing of what can be measured
    error_mm, covered = scores(result, balanced_m)
    assert error_mm < 3.0
    assert covered > 0.9


def test_stiff_cables_that_go_slack_are_followed(tmp_path: Path) -> None:
    """Six cables of 20 kN/m without sensors hold the saddle of a tower, beside 18 strips; a press slackens some."""
    strips, shape_m = saddle_tower(0.3, 0.15, prestrain=0.02)
    cables = list(range(12, 18))
    is_cable = np.isin(np.arange(24), cables)
    length_m = strips.tendon_length_m(shape_m)
    tension_n = 400.0 * (length_m - strips.natural_length_m)
    natural_m = np.where(is_cable, length_m - tension_n / 2e4, strips.natural_length_m)
    structure = replace(strips, natural_length_m=natural_m)
    stiffness, push_back = np.where(is_cable, 2e4, 400.0), np.where(is_cable, 0.0, 0.05)
    made = body(structure, stiffness_n_per_m=stiffness, push_back=push_back)
    true_m = shapes_of(made, shape_m, 10, (2.0, 0.0, 0.0), 0.0005)
    slack_m = natural_m[cables] - structure.tendon_length_m(true_m)[:, cables]
    assert slack_m[-1].max() > 0.01
    assert np.sum(slack_m[-1] > 0) == 1
    table = {
        "structure": {name: getattr(structure, name).tolist() for name in NAMES}
        | {"node_position_m": shape_m.tolist(), "unsensed": cables},
        "mechanics": {
            "tendon_stiffness_n_per_m": stiffness.tolist(),
            "rod_mass_kg": 0.03,
            "push_back": push_back.tolist(),
        },
    }
    sensed = np.flatnonzero(~is_cable).tolist()
    trial = write_trial(tmp_path / "trial", table, structure.tendon_length_m(true_m), sensed)
    for method in ("live", "batch"):
        result = reconstruct(trial, method)
        error_mm, covered = scores(result, true_m)
        assert error_mm < 3.0
        assert covered > 0.9
        told_slack_m = natural_m[cables] - structure.tendon_length_m(result.node_position_m[-1])[cables]
        np.testing.assert_allclose(told_slack_m, slack_m[-1], atol=0.002)  # the slack one is found, and no other
        assert np.nanmax(np.abs(result.loads.force_n)) < 3.0
        assert result.status.count(Status.OK) > 0.75 * len(T_S)


def test_a_structure_is_shown_converted_and_drawn(tmp_path: Path) -> None:
    (tmp_path / "tower.xml").write_text(mjcf(body(TOWER), TOWER_M, 0.001))
    shown = printed_by("structure", "tower.xml", "--out", "tower.toml", "--out", "tower.png", cwd=tmp_path)
    for text in ("9, of which 3 are anchors", "up to 2 share a node (class 2)", "self-stress states"):
        assert text in shown
    np.testing.assert_array_equal(read_structure(tmp_path / "tower.toml").structure.rods, TOWER.rods)
    assert (tmp_path / "tower.png").stat().st_size > 10_000
    for last in ("tower.toml", "tower.csv", "first.toml"):  # exists, of no format, twice
        refused = refusal_of("structure", "tower.xml", "--out", "first.toml", "--out", last, cwd=tmp_path)
        assert refused.startswith(f"tensegraph: {last}: ")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["tower.png", "tower.toml", "tower.xml"]


def test_a_measured_rest_shape_is_prestressed(example, tmp_path: Path) -> None:
    """Half a millimetre beside the shape in which forces balance there would be no stress, and no mechanism."""
    shown = run("structure", example / "trial.toml", cwd=tmp_path).stdout
    rows = [[cell.strip() for cell in line.split("│")] for line in shown.splitlines()]
    found = {row[1]: row[2].split()[0] for row in rows if len(row) == 4 and row[1] and row[2]}
    assert (found["self-stress states"], found["mechanisms"]) == ("1", "1")


@pytest.mark.parametrize(("name", "tendons"), [("prism", 9), ("six-strut", 24), ("tower", 21), ("saddle-tower", 24)])
def test_a_new_structure_is_a_trial_and_a_rig(name: str, tendons: int, tmp_path: Path) -> None:
    stages = ["--stages", "3"] if name == "tower" else []
    printed_by("structure", "--new", name, "--rod", "0.3", *stages, "--out", "first", cwd=tmp_path)
    shown = run("structure", "first/rig.toml", cwd=tmp_path)
    assert f"{tendons}, unstretched" in shown.stdout
    assert "no tendon" in shown.stdout
    text = (tmp_path / "first" / "trial.toml").read_text()
    assert text.count(" # measure: ") == 5
    from tensegraph.live.rig import Rig

    assert len(Rig.read(tmp_path / "first" / "rig.toml").description.natural_resistance_ohm) == tendons


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["broken.yaml"], "tensegraph: broken.yaml: line 1: is no YAML"),
        (["none.xml"], "tensegraph: none.xml: no such file"),
        ([], "tensegraph: expected a structure file, or --new with --rod, got neither"),
        (["--new", "prism"], "tensegraph: --rod: expected with --new"),
        (["--new", "prism", "--rod", "-1"], "tensegraph: --rod: expected 0.001 to 100 m, got -1"),
        (["--new", "prism", "--rod", "300"], "tensegraph: --rod: expected 0.001 to 100 m, got 300: is the unit right?"),
        (
            ["--new", "prism", "--rod", "0.3", "--stages", "5"],
            "tensegraph: --stages: only --new tower has stages, got --new prism",
        ),
        (["--new", "six-strut", "--rod", "1e300"], "tensegraph: --rod: expected 0.001 to 100 m, got 1e+300"),
        (["bomb.yaml", "--stages", "3"], "tensegraph: --stages: only --new tower has stages, got bomb.yaml"),
        (["--new", "prism", "--rod", "0.3", "--unit", "0.1"], "tensegraph: --unit: expected none with --new"),
        (["--new", "prism", "--rod", "0.3", "--out", "a", "--out", "b"], "tensegraph: --out: expected one directory"),
        (["bomb.yaml", "--unit", "0"], "tensegraph: --unit: expected metres above 0, at most 10000, got 0"),
        (["bomb.yaml"], "tensegraph: bomb.yaml: expected fewer than 1000000 values, got aliases"),
        (["self.yaml"], "tensegraph: self.yaml: expected fewer than 1000000 values, got aliases"),
    ],
)
def test_what_is_refused_is_one_line(words: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text("nodes: [")
    aliases = "\n".join(f"{b}: &{b} [{', '.join(9 * [f'*{a}'])}]" for a, b in pairwise("abcdefghi"))
    (tmp_path / "bomb.yaml").write_text(f"a: &a [x]\n{aliases}\nnodes: *i\n")
    (tmp_path / "self.yaml").write_text("nodes: &a {a: *a}\n")
    assert refusal_of("structure", *words, cwd=tmp_path).startswith(message)
