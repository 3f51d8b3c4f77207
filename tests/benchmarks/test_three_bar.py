"""The benchmark of the three-bar robot, on a recording made here: a prism that twists on the floor, and creeps."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

import three_bar
from tensegraph import InputError, open_trial, reconstruct
from tensegraph.models.structure.shape import Reason, Status

SCRIPT = Path(three_bar.__file__)
ROWS = 20


def prism_m() -> np.ndarray:
    """Return (rows, 6, 3): end caps of rods of 0.325 m from a base triangle to a top one that twists to and fro."""
    twist = 2.4 + 0.25 * np.sin(np.arange(ROWS) * 0.12)
    height_m = np.sqrt(three_bar.ROD_M**2 - 2 * 0.09**2 * (1 - np.cos(twist)))
    x = np.zeros((ROWS, 6, 3))
    for rod in range(3):
        for node, angle, z in ((2 * rod, 0 * twist, 0 * twist), (2 * rod + 1, twist, height_m)):
            around = angle + 2 * np.pi * rod / 3
            x[:, node] = np.stack([0.09 * np.cos(around), 0.09 * np.sin(around), z + 0.0175], axis=1)
    return x


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """The recording as the source has it: decimetres, stamps of bursts, and a row after a gap."""
    t_s = 1.7e9 + np.append(0.1 * np.arange(ROWS) - 0.09 * (np.arange(ROWS) % 2), 0.1 * ROWS + 1)
    x = np.append(prism_m(), prism_m()[:1], axis=0)
    rows = [
        {"time": t} | dict(zip(three_bar.END_CAPS, (10 * p).tolist(), strict=True)) for t, p in zip(t_s, x, strict=True)
    ]
    path = tmp_path / "tracks.json"
    path.write_text(json.dumps(rows))
    return path


def test_tracks_are_metres_at_even_times_up_to_the_gap(recording: Path) -> None:
    tracks = three_bar.read_tracks(recording)
    assert tracks.t_s == pytest.approx(np.linspace(0, 0.1 * (ROWS - 1) - 0.09, ROWS), abs=1e-6)
    np.testing.assert_allclose(tracks.node_position_m, prism_m(), atol=1e-9)
    assert tracks.floor.height_m == pytest.approx(0.0175, abs=1e-6)
    assert tracks.floor.normal == pytest.approx([0, 0, 1], abs=1e-6)


def test_the_trial_has_the_distances_and_their_noise(recording: Path, tmp_path: Path) -> None:
    """Tendon 3 joins nodes 0 and 2, two corners of the base: 0.09 m times the square root of 3."""
    three_bar.write_trial(three_bar.read_tracks(recording), tmp_path / "trial", 0.002, on_floor=True)
    trial = open_trial(tmp_path / "trial")
    length_m = np.array([reading.length_m for reading in trial.readings()])
    assert length_m[:, 3].mean() == pytest.approx(0.09 * np.sqrt(3), abs=0.001)
    assert length_m[:, 3].std() == pytest.approx(0.002, rel=0.4)
    assert trial.true_contacts().standing[0].tolist() == [True, False] * 3


def test_a_robot_that_nothing_else_measures_is_followed_in_doubt(recording: Path, tmp_path: Path) -> None:
    """Without forces and sensors: it stays on its base, and says after the rest that a push would be missed."""
    tracks = three_bar.read_tracks(recording)
    three_bar.write_trial(tracks, tmp_path / "trial", 0.0005, on_floor=True)
    result = reconstruct(tmp_path / "trial", "batch")
    error_m = np.linalg.norm(result.node_position_m - tracks.node_position_m, axis=2)
    assert np.sqrt(np.mean(error_m**2)) < 0.015
    assert (result.contacts[:, ::2] > 0.9).all()
    assert result.status[0] is Status.OK
    assert set(result.doubts[2:]) == {Reason.ATTITUDE}


def test_the_shapes_of_a_trial_in_a_hand_fit_the_first_one() -> None:
    """Turned and shifted shapes come back; the truth of a shape alone has no pose."""
    x = prism_m()[:2]
    turned = np.stack([x[0], x[0] @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + 0.3])
    np.testing.assert_allclose(three_bar.fitted_to_first(turned)[1], x[0], atol=1e-12)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda rows: rows[4].pop("rod_23_end_pt2"), "row 4, rod_23_end_pt2: expected 3 numbers"),
        (lambda rows: rows[5].update(time="soon"), "row 5, time: expected 1 numbers"),
        (lambda rows: rows[6].update(rod_01_end_pt1=[0, 1, float("nan")]), "row 6, rod_01_end_pt1: expected finite"),
        (lambda rows: rows[1].update(time=1.7e9 + 9), "row 1: expected no gap above 0.5 s"),
        (lambda rows: rows.clear(), "expected a list of at least 3 rows"),
    ],
)
def test_what_is_no_recording_is_one_line(recording: Path, edit, said: str) -> None:
    rows = json.loads(recording.read_text())
    edit(rows)
    recording.write_text(json.dumps(rows))
    with pytest.raises(InputError, match=said):
        three_bar.read_tracks(recording)


def test_the_script_as_a_user_types_it(recording: Path) -> None:
    done = subprocess.run(
        [sys.executable, SCRIPT, recording, "--sigma-mm", "0.5"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    header, _, *rows = done.stdout.splitlines()
    assert [row.split("|")[1:3] for row in rows] == [
        [f" {place} ", f" {method} "] for place in ("its own frame", "the world") for method in ("live", "batch")
    ]
    assert {row.count("|") for row in rows} == {header.count("|")}


def test_an_error_is_one_line_and_exit_code_2(capsys) -> None:
    with pytest.raises(typer.Exit) as ended:
        three_bar.main(Path("no.json"))
    assert ended.value.exit_code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: no.json: cannot be read as JSON: ")
