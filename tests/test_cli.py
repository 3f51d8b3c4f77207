"""The command line as a user types it: a process, files, exit codes."""

import filecmp
import hashlib
import os
import signal
import subprocess
import sys
import time
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
    (["calibrate", "trial", "--out", "m.safetensors"], "row 1: expected '# natural_resistance_ohm = NUMBER'"),
    (["calibrate", "trial", "--out", "m"], "m: expected a name that ends in .safetensors"),
    (["calibrate", ".", "--out", "m.safetensors"], ".: holds no recordings: expected files *.csv"),
    (["calibrate", "trial", "--out", "m.safetensors", "--rig", "bad.toml"], "bad.toml: noise: is no key of a rig"),
    (["calibrate", "trial", "--out", "m.safetensors", "--hold-out", "a", "--hold-out-tail", "0.4"], "expected one of"),
    (["reconstruct", "trial", "--model", "bad.toml"], "bad.toml: is no model file"),
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


@pytest.fixture(scope="module")
def rig_folder(tmp_path_factory):
    """Seven recordings of strips at one speed each, and one file that is none."""
    folder = tmp_path_factory.mktemp("rig")
    (folder / "strips").mkdir()
    rng = np.random.default_rng(5)
    for k, speed in enumerate((0.01, 0.01, 0.03, 0.03, 0.09, 0.09, 0.09)):
        t_s = np.arange(0, 60, 0.1)
        strain = np.abs((speed * t_s + 0.2) % 0.4 - 0.2)
        ohm = 1e6 * (1 + (1 + 0.02 * k) * 1.3 * strain + 1e-3 * rng.standard_normal(len(t_s)))
        rows = [f"{t:.2f},{e:.6f},{r:.0f}" for t, e, r in zip(t_s, strain, ohm, strict=True)]
        text = "\n".join(["# natural_resistance_ohm = 1000000", "t_s,strain,resistance_ohm", *rows, ""])
        (folder / "strips" / f"s{k}.csv").write_text(text)
    (folder / "strips" / "bad.csv").write_text("# natural_resistance_ohm = 1\nt_s,strain,resistance_ohm\n0,0,x\n")
    return folder


CALIBRATE = ("calibrate", "strips", "--epochs", "20", "--out")


@pytest.fixture(scope="module")
def calibrated(rig_folder):
    return run(*CALIBRATE, "m.safetensors", "--sweep", cwd=rig_folder)


def test_calibrate_writes_model_card_and_figures(rig_folder, calibrated) -> None:
    assert calibrated.returncode == 0, calibrated.stderr
    assert "left out: strips/bad.csv: row 3, column resistance_ohm: expected a finite number, got 'x'" in (
        calibrated.stdout
    )
    assert "speed 0.03 /s" in calibrated.stdout
    assert "The LSTM" in calibrated.stdout
    figures = {path.name: path.read_bytes() for path in (rig_folder / "m_figures").iterdir()}
    assert sorted(figures) == ["curves.png", "errors.png", "losses.png", "predictions.png", "sweep.png"]
    assert all(content.startswith(b"\x89PNG") for content in figures.values())
    card = (rig_folder / "m.md").read_text()
    digest = hashlib.sha256((rig_folder / "strips" / "s2.csv").read_bytes()).hexdigest()
    assert f"| s2.csv | test | `{digest}` |" in card
    assert "Left out:" in card
    assert "the paper's eq. (9) stands in" in card
    assert not list(rig_folder.glob("*.checkpoint"))


def test_reconstruct_uses_the_model_it_is_given(rig_folder, calibrated, trial_copy) -> None:
    path = trial_copy(rows=40)
    other = run("reconstruct", path, "--live", "--model", rig_folder / "m.safetensors", "--out", "o", cwd=path.parent)
    shipped = run("reconstruct", path, "--live", "--out", "s", cwd=path.parent)
    assert other.returncode == shipped.returncode == 0, other.stderr
    assert not filecmp.cmp(path.parent / "o" / "lengths.csv", path.parent / "s" / "lengths.csv", shallow=False)


def test_ctrl_c_and_the_same_command_again_give_the_same_bytes(rig_folder, calibrated) -> None:
    command = [sys.executable, "-m", "tensegraph", *CALIBRATE, "again.safetensors"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

    def heed_ctrl_c() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a job in the background is started deaf to it

    with subprocess.Popen(command, cwd=rig_folder, preexec_fn=heed_ctrl_c, **quiet) as process:
        until = time.monotonic() + 60
        while not (rig_folder / "again.checkpoint").exists() and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
    assert not (rig_folder / "again.safetensors").exists()
    assert run(*CALIBRATE, "again.safetensors", cwd=rig_folder).returncode == 0
    assert filecmp.cmp(rig_folder / "again.safetensors", rig_folder / "m.safetensors", shallow=False)


def test_help_names_the_commands(tmp_path) -> None:
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    assert "reconstruct" in result.stdout
    assert "calibrate" in result.stdout
