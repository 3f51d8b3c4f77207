"""`tensegraph evaluate`: tables and JSON, and the truth of other systems."""

import json
import shutil
import tomllib

import numpy as np
import pytest

from blank_figures import no_figures
from command_line import refusal_of, run
from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph.io.reports.evaluation_tables import ScoredResult
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.scoring.method_scores import NO_METHOD

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def evaluated(done):
    """Both runs evaluated: the batch one as a table, both as JSON."""
    folder, *_ = done
    with no_figures():
        table = run("evaluate", "results/press", cwd=folder)
        numbers = run("evaluate", "results/press", "live", "--json", "--out", "scores", cwd=folder)
    return folder, table, numbers


EVALUATED = ["errors.png", "evaluation.json", "heights.png", "loads.png", "run.toml"]


def test_a_directory_in_place_of_the_truth_is_named(evaluated) -> None:
    folder, *_ = evaluated
    refused = refusal_of("evaluate", "results/press", "--truth", "results", cwd=folder)
    assert refused == "tensegraph: results: expected a file, got a directory\n"


def test_evaluate_prints_tables_or_json(evaluated) -> None:
    folder, table, numbers = evaluated
    assert table.returncode == 0, table.stderr
    for words in (
        "press_01, batch",
        "displacement of faces",
        "worst node",
        "ok, and outside of 99.9 %",
        "NEES",
        "NIS",
        "false alarms",
        "median sigma",
        "RMSE of loads above 0.2 N",
        "quiet",
        "loaded",
    ):
        assert words in table.stdout
    batch, live = json.loads(numbers.stdout)
    assert (batch["method"], live["method"]) == ("batch", "live")
    assert f"{1e3 * batch['absolute']['nodes']['rmse_m']:.2f}" in table.stdout
    for name in ("results/evaluation/press", "scores/press", "scores/live"):
        assert sorted(p.name for p in (folder / name).iterdir()) == EVALUATED
    assert json.loads((folder / "scores/live/evaluation.json").read_text()) == live
    assert [regime["name"] for regime in live["regimes"]] == ["quiet", "loaded", "slack"]
    assert sum(regime["frames"] for regime in live["regimes"][:2]) == live["frames"]
    assert live["loads"]["threshold_n"] == 0.2
    assert 0 < live["loads"]["loaded_rmse_n"] < 2


def test_evaluate_agrees_with_what_reconstruct_said(done, evaluated) -> None:
    batch, live = json.loads(evaluated[2].stdout)
    for said, numbers in zip(done[1:], (batch, live), strict=True):
        row = next(line for line in said.stdout.splitlines() if "node RMSE" in line)
        assert float(row.split()[4]) == pytest.approx(1e3 * numbers["absolute"]["nodes"]["rmse_m"], abs=0.006)


def test_a_truth_that_is_not_there_is_no_earlier_evaluation(evaluated) -> None:
    folder, table, _ = evaluated
    assert table.returncode == 0
    missing = run("evaluate", "results/press", "--truth", "nothing.csv", cwd=folder)
    assert (missing.returncode, missing.stdout) == (2, "")
    assert missing.stderr == "tensegraph: nothing.csv: no such file\n"


def test_evaluate_with_truth_from_elsewhere(done, tmp_path) -> None:
    """A result as its own truth is exact; turned and shifted it is again exact once aligned."""
    folder = done[0]
    own = run("evaluate", "live", "--truth", "live/shape.csv", "--json", "--out", tmp_path / "own", cwd=folder)
    assert json.loads(own.stdout)[0]["absolute"]["nodes"]["rmse_m"] == 0
    rows = np.genfromtxt(folder / "live/shape.csv", delimiter=",", skip_header=1)
    header = (folder / "live/shape.csv").read_text().splitlines()[0]
    positions = rows[:, 1:].reshape(-1, 12, 3)[..., [1, 2, 0]] + 0.5  # z of the camera is x of the anchors
    moved = np.column_stack([rows[:, 0], positions.reshape(len(rows), -1)])[:, :-3]  # node 11 has no marker
    names = ",".join(header.split(",")[:-3])
    np.savetxt(tmp_path / "mocap.csv", moved, delimiter=",", header=names, comments="", fmt="%.6f")
    arguments = ("evaluate", "live", "--truth", tmp_path / "mocap.csv", "--json", "--out", tmp_path / "aligned")
    runs = [run(*arguments, *more, cwd=folder) for more in ([], ["--align"])]
    assert [result.stderr for result in runs] == ["", ""]
    plain, aligned = (json.loads(result.stdout)[0] for result in runs)
    assert aligned["node_rmse_m"][-1] is None
    assert plain["absolute"]["nodes"]["rmse_m"] > 0.5
    assert plain["anchors_apart_m"][0] == pytest.approx(np.sqrt(3 * 0.5**2), abs=1e-3)  # it is at the origin
    table = run(*arguments[:4], "--out", tmp_path / "table", cwd=folder).stdout
    assert "anchor 0 of the truth" in table
    assert "See --align" in table
    mirrored = moved.copy()
    mirrored[:, 1::3] *= -1
    np.savetxt(tmp_path / "mocap.csv", mirrored, delimiter=",", header=names, comments="", fmt="%.6f")
    table = run(*arguments[:4], "--align", "--out", tmp_path / "mirrored", cwd=folder).stdout
    assert "mirrored axes?" in table
    assert "See --align" not in table
    assert max(aligned["anchors_apart_m"]) < 0.001
    assert aligned["absolute"]["nodes"]["rmse_m"] < 1e-5
    assert aligned["rotation_deg"] == pytest.approx(120, abs=1e-3)


def test_truth_of_two_nodes_is_scored_on_two(done, tmp_path) -> None:
    header, *rows = (done[0] / "press/truth.csv").read_text().splitlines()
    seen = [name == "t_s" or name.split("_")[0] in ("n5", "n8") for name in header.split(",")]
    told = [
        ",".join(cell if is_seen else "" for cell, is_seen in zip(row.split(","), seen, strict=True)) for row in rows
    ]
    (tmp_path / "two.csv").write_text("\n".join([header, *told, ""]))
    table = run("evaluate", "live", "--truth", tmp_path / "two.csv", "--out", tmp_path / "scored", cwd=done[0]).stdout
    assert "of 2 in their 95 % band" in " ".join(table.replace("│", " ").split())


def test_a_result_finds_its_trial_when_both_are_moved(done, tmp_path) -> None:
    for name in ("press", "live"):
        shutil.copytree(done[0] / name, tmp_path / name)
    assert tomllib.loads((tmp_path / "live/run.toml").read_text())["trial_path"] == "../press"
    assert run("evaluate", "live", cwd=tmp_path).returncode == 0
    (tmp_path / "press").rename(tmp_path / "elsewhere")
    assert "press/trial.toml: no such file" in refusal_of("evaluate", "live", cwd=tmp_path)
    assert run("evaluate", "live", "--trial", "elsewhere", cwd=tmp_path).returncode == 0
    rows = (tmp_path / "elsewhere/board0.csv").read_text().splitlines(keepends=True)
    (tmp_path / "elsewhere/board0.csv").write_text("".join(rows[:-1]))
    other = refusal_of("evaluate", "live", "--trial", "elsewhere", cwd=tmp_path)
    assert "board0.csv: is not what live was made from" in other


def test_frames_that_a_live_run_skipped_are_told(done, tmp_path) -> None:
    shutil.copytree(done[0] / "live", tmp_path / "live")
    told = (tmp_path / "live/run.toml").read_text()

    def evaluated(skipped: str):
        (tmp_path / "live/run.toml").write_text(f"skipped_frames = {skipped}\n{told}")
        return run("evaluate", "live", "--trial", done[0] / "press", "--out", "score", cwd=tmp_path)

    assert "skipped" not in evaluated("0").stdout
    assert "7 frames, because the run was late" in evaluated("7").stdout
    assert json.loads((tmp_path / "score/evaluation.json").read_text())["skipped_frames"] == 7
    refused = evaluated("'many'")
    assert refused.returncode == 2
    assert refused.stderr == "tensegraph: live/run.toml: skipped_frames: expected a number of frames, got 'many'\n"


def test_a_score_is_json_without_holes() -> None:
    """What is not known is null, what would be infinite too; frames stay out."""
    import json
    from pathlib import Path

    structure = four_nodes()
    estimate = estimate_of(structure, moved([[0, 0, 1]] * 3), variance_m2=(1e-6, 1e-6, 0.0))
    score = ScoredResult(Path("out"), "toy", NO_METHOD, evaluate(TRUE_M, estimate, truth_of(3)))
    read = json.loads(json.dumps(score.as_json(), allow_nan=False))
    assert read["consistency"]["nees"] == [None]
    assert read["absolute"]["nodes"]["rmse_m"] == pytest.approx(0.001)
    assert read["free_nodes"] == [3]
    assert "compared" not in read
