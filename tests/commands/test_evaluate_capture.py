"""`tensegraph evaluate` against motion capture, as a user types it."""

import json
import shutil

import numpy as np
import pytest

from capture_files import OFFSET_S, RATE_PPM, motive_text, take_of, write_c3d
from command_line import printed_by, refusal_of, run

pytestmark = pytest.mark.usefixtures("undrawn")

NODES = [4, 11, 8, 0, 6, 2, 10, 9, 3, 1, 7, 5]


def evaluated(folder, result, *arguments) -> dict:
    """The numbers that `--json` prints."""
    return json.loads(printed_by("evaluate", result, *arguments, "--json", "--out", folder / "captured", cwd=folder))[0]


def test_motion_capture_gives_what_clean_truth_gives(tmp_path, example, true_positions) -> None:
    """The example's truth as Motive writes it: another clock, permuted, hidden at times, Y up, in millimetres."""
    assert run("reconstruct", example, "--figures", "none", "--out", "press", cwd=tmp_path).returncode == 0
    take = take_of(*true_positions, NODES, ghosts=2)
    (tmp_path / "take.csv").write_text(motive_text(take), newline="")
    clean = evaluated(tmp_path, "press")
    table = run("evaluate", "press", "--truth", "take.csv", "--out", "seen", cwd=tmp_path).stdout
    seen = json.loads((tmp_path / "seen/evaluation.json").read_text())
    capture = seen["capture"]
    clock = capture["clock"]
    assert clean["capture"] is None
    assert clock["offset_s"] == pytest.approx(OFFSET_S + 1e-6 * RATE_PPM * clock["middle_s"], abs=0.005)
    assert abs(clock["rate_ppm"] - RATE_PPM) < 2 * clock["rate_sigma_ppm"]
    assert {mark["marker"]: mark["node"] for mark in capture["markers"]} == dict(zip(take.names, NODES, strict=False))
    assert capture["ignored"] == ["Base", *take.names[-2:]]
    assert seen["absolute"]["nodes"]["rmse_m"] == pytest.approx(clean["absolute"]["nodes"]["rmse_m"], abs=0.0001)
    words = " ".join(table.replace("│", " ").split())
    assert f"offset {clock['offset_s']:.4f} s, sigma {1e3 * clock['offset_sigma_s']:.0f} ms; rate" in words
    assert f"assigned by the best fit to {1e3 * capture['misfit_m']:.2f} mm rms" in words
    assert "Unlabeled 1001 = 11" in words


def test_what_trial_toml_tells_is_used(done, tmp_path, true_positions) -> None:
    """Two nodes beside the anchors are scored on two; `reconstruct` says why it shows no error."""
    take = take_of(*true_positions, NODES)
    told = {name: node for name, node in zip(take.names, NODES, strict=False) if node in (0, 1, 2, 5, 8)}
    shutil.copytree(done[0] / "press", tmp_path / "press")
    toml = (tmp_path / "press/trial.toml").read_text().replace('"truth.csv"', '"take.c3d"')
    rows = [f'"{name}" = {{ node = {node} }}' for name, node in told.items()]
    (tmp_path / "press/trial.toml").write_text("\n".join([toml, "[truth.markers]", *rows, ""]))
    write_c3d(take, tmp_path / "press/take.c3d")
    plain = evaluated(done[0], "results/press")
    scored = evaluated(done[0], "results/press", "--trial", tmp_path / "press", "--offset", OFFSET_S)
    assert scored["capture"]["clock"]["offset_s"] == OFFSET_S
    assert not scored["capture"]["found"]
    assert np.flatnonzero([rmse is not None for rmse in scored["node_rmse_m"]]).tolist() == [2, 5]
    for k in (2, 5):
        assert scored["node_rmse_m"][k] == pytest.approx(plain["node_rmse_m"][k], abs=0.0005)
    said = run("reconstruct", tmp_path / "press", "--figures", "none", "--method", "least-squares", cwd=tmp_path)
    words = " ".join(said.stdout.replace("│", " ").split())
    assert "truth is motion capture: `tensegraph evaluate` lays it" in words


def test_markers_are_told_of_a_capture_that_the_command_line_names(done, tmp_path, true_positions) -> None:
    take = take_of(*true_positions, NODES)
    (tmp_path / "take.csv").write_text(motive_text(take), newline="")
    shutil.copytree(done[0] / "press", tmp_path / "press")
    text = (tmp_path / "press/trial.toml").read_text()
    rows = [f'"{name}" = {{ node = {node} }}' for name, node in zip(take.names[:5], NODES, strict=False)]
    told = text.replace('file = "truth.csv"', "").replace('loads = "loads.csv"', "")
    (tmp_path / "press/trial.toml").write_text("\n".join([told, "[truth.markers]", *rows, ""]))
    arguments = ("--trial", tmp_path / "press", "--offset", OFFSET_S)
    capture = evaluated(done[0], "results/press", *arguments, "--truth", tmp_path / "take.csv")["capture"]
    assert [mark["node"] for mark in capture["markers"]] == NODES[:5]
    without = refusal_of("evaluate", "results/press", *arguments, cwd=done[0])
    assert "has no truth: expected [truth] in trial.toml, or --truth FILE" in without


def test_an_offset_of_stamped_positions(done, tmp_path) -> None:
    """Truth that is two seconds early has the errors of truth on the host's clock once that is told."""
    path = done[0] / "press/truth.csv"
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 0] -= 2.0
    names = path.read_text().partition("\n")[0]
    np.savetxt(tmp_path / "early.csv", rows, delimiter=",", header=names, comments="", fmt="%.6f")
    plain = evaluated(done[0], "live")
    told = evaluated(done[0], "live", "--truth", tmp_path / "early.csv", "--offset", 2)
    assert told["absolute"]["nodes"]["rmse_m"] == pytest.approx(plain["absolute"]["nodes"]["rmse_m"], abs=1e-6)


def test_what_is_wrong_is_one_line(done, tmp_path) -> None:
    (tmp_path / "bad.csv").write_text("Format Version,1.23,Length Units,Feet\n")
    bad = refusal_of("evaluate", "live", "--truth", tmp_path / "bad.csv", cwd=done[0])
    assert "bad.csv: row 1: Length Units: expected a unit of length" in bad
