"""The command line as a user types it: a process, files, exit codes."""

import csv
import filecmp
import hashlib
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from tensegraph import cli
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.trial_description import LinkTable


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
            "forces at rest",
            "largest load",
            "nodes above 0.2 N for 1 s",
        ):
            assert words in result.stdout
    assert "(batch)" in batch.stdout
    assert "(live)" in live.stdout


@pytest.mark.parametrize("name", ["results/press", "live"])
def test_the_result_is_whole(done, name: str) -> None:
    folder = done[0] / name
    assert sorted(p.name for p in folder.iterdir()) == [
        "ellipsoids.csv",
        "estimated_loads.csv",
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
    assert run_toml["settings"]["noise"]["shape_prior_m"] == 0.06
    assert set(run_toml["inputs"]) == {"trial.toml", "board0.csv", "board1.csv"}
    shape = np.genfromtxt(folder / "shape.csv", delimiter=",", names=True)
    assert len(shape) == frames
    assert len(shape.dtype.names) == 1 + 36
    assert (folder / "ellipsoids.csv").read_text().count("\n") == 1 + 12 * frames
    assert (folder / "lengths.csv").read_text().count("\n") == 1 + 24 * frames
    assert (folder / "estimated_loads.csv").read_text().count("\n") == 1 + 9 * frames
    header, first, *_ = (folder / "status.csv").read_text().splitlines()
    assert header == "t_s,status,smallest_singular_value,mechanism_sigma_m,branch,other_log_ratio"
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


@pytest.fixture(scope="module")
def evaluated(done):
    """Both runs evaluated: the batch one as a table, both as JSON."""
    folder, *_ = done
    table = run("evaluate", "results/press", cwd=folder)
    numbers = run("evaluate", "results/press", "live", "--json", "--out", "scores", cwd=folder)
    return folder, table, numbers


EVALUATED = ["errors.png", "evaluation.json", "heights.png", "loads.png"]


def test_evaluate_prints_tables_or_json(evaluated) -> None:
    folder, table, numbers = evaluated
    assert table.returncode == 0, table.stderr
    for words in (
        "press_01, batch",
        "displacement of faces",
        "worst node",
        "NEES",
        "NIS",
        "false alarms",
        "median sigma",
        "RMSE of loads above 0.2 N",
        "quiet",
        "loaded",
        "slack",
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
    assert aligned["absolute"]["nodes"]["rmse_m"] < 1e-5
    assert aligned["rotation_deg"] == pytest.approx(120, abs=1e-3)


def test_a_result_finds_its_trial_when_both_are_moved(done, tmp_path) -> None:
    for name in ("press", "live"):
        shutil.copytree(done[0] / name, tmp_path / name)
    assert tomllib.loads((tmp_path / "live/run.toml").read_text())["trial_path"] == "../press"
    assert run("evaluate", "live", cwd=tmp_path).returncode == 0
    (tmp_path / "press").rename(tmp_path / "elsewhere")
    lost = run("evaluate", "live", cwd=tmp_path)
    assert lost.returncode == 2
    assert "press/trial.toml: no such file" in lost.stderr
    assert run("evaluate", "live", "--trial", "elsewhere", cwd=tmp_path).returncode == 0
    rows = (tmp_path / "elsewhere/board0.csv").read_text().splitlines(keepends=True)
    (tmp_path / "elsewhere/board0.csv").write_text("".join(rows[:-1]))
    other = run("evaluate", "live", "--trial", "elsewhere", cwd=tmp_path)
    assert other.returncode == 2
    assert "board0.csv: is not what live was made from" in other.stderr


def test_compare_runs_every_method(trial_copy) -> None:
    """With truth, without, and with a truth that is gone; what it says of the UKF is what evaluate says."""
    seen = trial_copy(rows=60, name="seen")
    blind = trial_copy(rows=60, name="blind", trial=lambda text: text[: text.index("[truth]")])
    lost = trial_copy(rows=60, name="lost")
    (lost / "truth.csv").unlink()
    result = run("compare", seen, blind, lost, cwd=seen.parent)
    assert result.returncode == 0, result.stderr
    for words in (
        "seen, rest shape held: node RMSE",
        "seen, UKF: node RMSE",
        "blind, graph, batch:",
        "(no truth)",
        "(truth not used: ",
    ):
        assert words in result.stdout
    folder = seen.parent / "results/comparison"
    assert sorted(p.name for p in folder.iterdir()) == ["comparison.csv", "comparison.md", "comparison.png"]
    with (folder / "comparison.csv").open() as file:
        rows = {(row["trial"], row["method"]): row for row in csv.DictReader(file)}
    assert len(rows) == 3 + 4 * 6
    assert rows["blind", "UKF"]["nodes_rmse_m"] == ""
    assert float(rows["blind", "UKF"]["ms_per_frame"]) > 0
    assert "(ukf)" in run("reconstruct", seen, "--method", "ukf", cwd=seen.parent).stdout
    (alone,) = json.loads(run("evaluate", "results/seen", "--json", cwd=seen.parent).stdout)
    assert float(rows["seen", "UKF"]["nodes_rmse_m"]) == pytest.approx(alone["absolute"]["nodes"]["rmse_m"], rel=1e-3)
    assert float(rows["seen", "UKF"]["coverage_95"]) == pytest.approx(alone["consistency"]["coverage_95"], abs=0.02)


REFUSED = [
    (["reconstruct", "nothing"], "nothing/trial.toml: no such file"),
    (["reconstruct", "trial", "--config", "bad.toml"], "bad.toml: noise.rodd_m: is no setting"),
    (["reconstruct", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["reconstruct", "trial", "--out", "bad.toml"], "bad.toml: exists and is no earlier result"),
    (["reconstruct", "trial", "trial"], "two of these are named trial"),
    (["reconstruct", "trial"], "board1.csv: row 30, column adc3: expected a finite number, got 'x'"),
    (["evaluate", "trial"], "trial: is no result: expected a directory with run.toml"),
    (["evaluate", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["compare", "nothing"], "nothing/trial.toml: no such file"),
    (["compare", "trial", "trial"], "two of these are named trial"),
    (["compare", "trial", "--out", "trial"], "expected a new name, or a directory with comparison.csv"),
    (["calibrate", "trial", "--out", "m.safetensors"], "row 1: expected '# natural_resistance_ohm = NUMBER'"),
    (["calibrate", "trial", "--out", "m"], "m: expected a name that ends in .safetensors"),
    (["calibrate", ".", "--out", "m.safetensors"], ".: holds no recordings: expected files *.csv"),
    (["calibrate", "trial", "--out", "m.safetensors", "--rig", "bad.toml"], "bad.toml: noise: is no key of a rig"),
    (["calibrate", "trial", "--out", "m.safetensors", "--hold-out", "a", "--hold-out-tail", "0.4"], "expected one of"),
    (["reconstruct", "trial", "--model", "bad.toml"], "bad.toml: is no model file"),
    (["reconstruct", "trial", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["reconstruct", "trial", "-q", "-v"], "--quiet and --verbose: expected one of them, got both"),
    (["evaluate", "trial", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["compare", "trial", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["calibrate", "trial", "--out", "bad.toml/m.safetensors"], "bad.toml: no such directory"),
    (["record", "--rig", "rig.toml", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["live", "--replay", "trial", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["live", "--replay", "trial", "--record", "bad.toml/x"], "bad.toml/x: cannot be written: "),
    (["simulate", "plan.toml", "--out", "bad.toml/x"], "bad.toml/x: cannot be written: "),
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


def test_an_error_of_the_system_is_one_line_too(monkeypatch, capsys) -> None:
    def fail() -> None:
        raise PermissionError(13, "Permission denied", "some/file")

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err == "tensegraph: some/file: Permission denied\n"


@pytest.mark.parametrize("command", ["", *(command.callback.__name__ for command in cli.app.registered_commands)])
def test_help_pages_are_legible(tmp_path, command) -> None:
    long, short = (run(*command.split(), option, cwd=tmp_path) for option in ("--help", "-h"))
    assert long.returncode == short.returncode == 0
    assert long.stdout == short.stdout
    assert "\\b" not in long.stdout
    assert "[default: ]" not in long.stdout
    for example in [line for line in long.stdout.splitlines() if line.strip().startswith("tensegraph ")]:
        assert len(example.strip()) < 79


def test_the_version_is_the_package_s(tmp_path) -> None:
    assert run("--version", cwd=tmp_path).stdout == f"tensegraph {version('tensegraph')}\n"


def test_defaults_are_those_of_the_settings() -> None:
    """Written out in `cli`, so that a help page imports no numpy."""
    defaults = {name: p.default for name, p in inspect.signature(cli.calibrate).parameters.items()}
    recipe = TrainingSettings()
    for name in ("epochs", "learning_rate", "seed", "unified"):
        assert defaults[name] == getattr(recipe, name)
    assert inspect.signature(cli.ports).parameters["baud"].default == LinkTable().baud


def test_quiet_and_verbose(trial_copy) -> None:
    """Quiet: the result's path. Verbose: as ever, with times of the stages on stderr. Without figures: tables only."""
    path = trial_copy(rows=40)
    frame = ("reconstruct", path, "--method", "frame", "--no-figures")
    quiet = run(*frame, "-q", "--out", "quiet", cwd=path.parent)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "written to quiet\n", "")
    verbose = run(*frame, "-v", "--out", "verbose", cwd=path.parent)
    assert "node RMSE" in verbose.stdout
    assert [line.split(":")[0] for line in verbose.stderr.splitlines()] == ["rest shape", "shapes", "tables"]
    names = {p.name for p in (path.parent / "quiet").iterdir()}
    assert names == {"shape.csv", "ellipsoids.csv", "lengths.csv", "status.csv", "estimated_loads.csv", "run.toml"}
    assert tomllib.loads((path.parent / "quiet" / "run.toml").read_text())["method"] == "frame"
    modes = {p.stat().st_mode & 0o777 for p in (path.parent / "quiet").iterdir()}
    assert modes == {path.joinpath("trial.toml").stat().st_mode & 0o777}


def test_help_names_the_commands(tmp_path) -> None:
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    for command in ("reconstruct", "evaluate", "compare", "calibrate", "simulate"):
        assert command in result.stdout


def test_a_trial_of_lengths_ends_with_its_table(trial_copy, example_structure) -> None:
    path = trial_copy(rows=5)
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    length_m = example_structure.natural_length_m * 1.08
    rows = [",".join(map(str, (0.02 * k, *length_m))) for k in range(5)]
    (path / "lengths.csv").write_text("\n".join([",".join(["t_s", *(f"l{e}_m" for e in range(24))]), *rows, ""]))
    result = run("reconstruct", path, "--out", "out", cwd=path.parent)
    assert result.returncode == 0, result.stderr
    assert "5" in result.stdout
    assert "written to out" in result.stdout
