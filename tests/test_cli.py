"""The command line as a user types it: a process, files, exit codes."""

import filecmp
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest


def run(*arguments, cwd: Path, timeout_s: float = 120) -> subprocess.CompletedProcess:
    """Run `python -m tensegraph` in a directory."""
    environment = os.environ | {"COLUMNS": "120", "TERM": "dumb"}
    command = [sys.executable, "-m", "tensegraph", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=timeout_s, check=False
    )


@pytest.fixture(scope="module")
def done(tmp_path_factory, example):
    """The README's command on the first two seconds and more of the example, batch and live."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "press").mkdir()
    for source in example.iterdir():
        lines = source.read_text().splitlines(keepends=True)
        (folder / "press" / source.name).write_text("".join(lines if source.suffix == ".toml" else lines[:301]))
    batch = run("reconstruct", "press", cwd=folder)
    live = run("reconstruct", "press", "--live", "--out", "live", cwd=folder)
    return folder, batch, live


def test_it_ends_well_with_a_table(done) -> None:
    _, batch, live = done
    for result in (batch, live):
        assert result.returncode == 0, result.stderr
        for words in (
            "frames",
            "duration",
            "ms per frame",
            "mean sigma of a node",
            "node RMSE",
            "holding the rest shape",
        ):
            assert words in result.stdout
    assert "(batch)" in batch.stdout
    assert "(live)" in live.stdout


@pytest.mark.parametrize("name", ["results/press", "live"])
def test_the_result_is_whole(done, name: str) -> None:
    folder = done[0] / name
    assert sorted(p.name for p in folder.iterdir()) == [
        "ellipsoids.csv",
        "lengths.csv",
        "lengths.png",
        "run.toml",
        "shape.csv",
        "shape.png",
        "status.csv",
    ]
    assert not [p for p in folder.parent.iterdir() if p.name.startswith(".")]
    run_toml = tomllib.loads((folder / "run.toml").read_text())
    frames = run_toml["frames"]
    assert run_toml["settings"]["noise"]["shape_prior_m"] == 0.02
    assert set(run_toml["inputs"]) == {"trial.toml", "board0.csv", "board1.csv"}
    shape = np.genfromtxt(folder / "shape.csv", delimiter=",", names=True)
    assert len(shape) == frames
    assert len(shape.dtype.names) == 1 + 36
    assert (folder / "ellipsoids.csv").read_text().count("\n") == 1 + 12 * frames
    assert (folder / "lengths.csv").read_text().count("\n") == 1 + 24 * frames
    header, first, *_ = (folder / "status.csv").read_text().splitlines()
    assert header == "t_s,status,smallest_singular_value,mechanism_sigma_m"
    assert first.startswith("0.0000,ok,")
    for figure in ("lengths.png", "shape.png"):
        assert (folder / figure).read_bytes().startswith(b"\x89PNG")


def test_ellipsoids_hold_together(done) -> None:
    """Semi-axes and quaternion of a row rebuild its covariance."""
    from scipy.spatial.transform import Rotation
    from scipy.stats import chi2

    rows = np.genfromtxt(done[0] / "results/press/ellipsoids.csv", delimiter=",", names=True)[5::97]
    names = ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"]
    xx, xy, xz, yy, yz, zz = (rows[name] for name in names)
    covariance = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)
    axes = Rotation.from_quat(np.stack([rows[q] for q in ("qx", "qy", "qz", "qw")], axis=1)).as_matrix()
    semi = np.stack([rows[f"semi_{a}_m"] for a in "abc"], axis=1)
    rebuilt = np.einsum("nij,nj,nkj->nik", axes, semi**2 / chi2.ppf(rows["probability"][0], 3), axes)
    np.testing.assert_allclose(rebuilt, covariance, atol=1e-8)


def test_truth_changes_nothing(done, tmp_path) -> None:
    """Byte for byte the same result without truth files and table; only the timing in run.toml is the clock's."""
    folder = done[0]
    blind = tmp_path / "press"
    blind.mkdir()
    for source in (folder / "press").iterdir():
        if source.name not in ("truth.csv", "loads.csv"):
            text = source.read_text()
            (blind / source.name).write_text(text[: text.index("[truth]")] if source.suffix == ".toml" else text)
    result = run("reconstruct", "press", cwd=tmp_path)
    assert result.returncode == 0
    assert "RMSE" not in result.stdout
    names = [p.name for p in (folder / "results/press").iterdir() if p.name != "run.toml"]
    _, different, errors = filecmp.cmpfiles(folder / "results/press", tmp_path / "results/press", names, shallow=False)
    assert not different
    assert not errors
    one, other = (
        tomllib.loads((path / "results/press/run.toml").read_text()) | {"timing": None} for path in (folder, tmp_path)
    )
    assert one == other


def test_a_truth_file_that_is_gone_is_said_and_stops_nothing(trial_copy) -> None:
    path = trial_copy(rows=40)
    (path / "truth.csv").unlink()
    result = run("reconstruct", path, cwd=path.parent)
    assert result.returncode == 0
    assert "not used: " in result.stdout


def test_several_trials_and_a_second_run(trial_copy) -> None:
    one, two = trial_copy(rows=40, name="one"), trial_copy(rows=40, name="two")
    for _ in range(2):  # an earlier result is replaced
        result = run("reconstruct", one, two, "--live", "--out", "both", cwd=one.parent)
        assert result.returncode == 0, result.stderr
    assert (one.parent / "both" / "one" / "shape.csv").is_file()
    assert (one.parent / "both" / "two" / "shape.csv").is_file()


def test_a_config_file_is_used(trial_copy) -> None:
    path = trial_copy(rows=40)
    (path.parent / "config.toml").write_text("probability = 0.5\n[frames]\nrate_hz = 25.0\n")
    result = run("reconstruct", path, "--live", "--config", "config.toml", "--out", "out", cwd=path.parent)
    assert result.returncode == 0, result.stderr
    written = tomllib.loads((path.parent / "out" / "run.toml").read_text())
    assert written["settings"]["probability"] == 0.5
    assert written["frames"] < 25


REFUSED = [
    (["reconstruct", "nothing"], "nothing/trial.toml: no such file"),
    (["reconstruct", "trial", "--config", "bad.toml"], "bad.toml: noise.rodd_m: is no setting"),
    (["reconstruct", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["reconstruct", "trial", "--out", "bad.toml"], "bad.toml: exists and is no earlier result"),
    (["reconstruct", "trial", "trial"], "two trials are named trial"),
    (["reconstruct", "trial"], "board1.csv: row 30, column adc3: expected a finite number, got 'x'"),
    (["calibrate", "trial", "--out", "m"], "row 1: expected '# natural_resistance_ohm = NUMBER'"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED)
def test_bad_input_is_one_line_and_exit_code_2(trial_copy, arguments, message) -> None:
    path = trial_copy(rows=40)
    rows = (path / "board1.csv").read_text().splitlines(keepends=True)
    cells = rows[29].split(",")
    cells[6] = "x"
    rows[29] = ",".join(cells)
    (path / "board1.csv").write_text("".join(rows))
    (path.parent / "bad.toml").write_text("[noise]\nrodd_m = 1\n")
    before = sorted(p.name for p in path.parent.iterdir())
    result = run(*arguments, cwd=path.parent)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert message in result.stderr
    left = sorted(p.name for p in path.parent.rglob("*") if p.parent != path)
    assert [name for name in left if name not in before] in ([], ["results"])


def test_a_simulated_trial_is_reconstructed(tmp_path) -> None:
    """The twin's commands as the README has them, on five seconds of the prism."""
    text = (Path(__file__).parents[1] / "examples" / "plans" / "prism.toml").read_text()
    text = text[: text.index("[[load.random]]")].replace("duration_s = 30.0", "duration_s = 5.0")
    (tmp_path / "prism.toml").write_text(text)
    result = run("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("prism_01: ")
    assert "written to prism_01" in result.stdout
    result = run("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path)
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "prism_01: exists: expected a new name" in result.stderr
    result = run("reconstruct", "prism_01", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "node RMSE" in result.stdout


def test_a_bad_plan_is_one_line_and_nothing_is_written(tmp_path) -> None:
    text = (Path(__file__).parents[1] / "examples" / "plans" / "press.toml").read_text()
    (tmp_path / "bad.toml").write_text(text.replace("push_back", "push_bak"))
    result = run("simulate", "bad.toml", "--out", "trial", cwd=tmp_path)
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    line = 1 + text[: text.index("push_back")].count("\n")
    assert f"bad.toml: line {line}: mechanics.push_bak: is no key of a plan" in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["bad.toml"]


def test_help_names_the_commands(tmp_path) -> None:
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    assert "reconstruct" in result.stdout
    assert "calibrate" in result.stdout
    assert "simulate" in result.stdout
