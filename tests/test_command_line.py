"""The command line as a user types it: help, and what is refused."""

import inspect
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version

import pytest

from command_line import refusal_of, run, run_process
from tensegraph import InputError, cli
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.trial_tables import LinkTable

REFUSED = [
    (["reconstruct", "nothing"], "nothing/trial.toml: no such file"),
    (["reconstruct", "trial", "--config", "bad.toml"], "bad.toml: noise.rodd_m: is no setting"),
    (["reconstruct", "trial", "--config", "fast.toml"], "tensegraph: fast.toml: frames.rate_hz: expected 10 to 100, "),
    (["compare", "trial", "--config", "fast.toml"], "tensegraph: fast.toml: frames.rate_hz: expected 10 to 100, "),
    (["live", "--replay", "trial", "--config", "fast.toml"], "tensegraph: fast.toml: frames.rate_hz: expected 10 to "),
    (["reconstruct", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["reconstruct", "trial", "--out", "bad.toml"], "bad.toml: exists and is no earlier result"),
    (["reconstruct", "trial", "trial"], "two of these are named trial"),
    (["reconstruct", "trial"], "board1.csv: row 30, column adc3: expected a finite number, got 'x'"),
    (["evaluate", "trial"], "trial: is no result: expected a directory with run.toml"),
    (["evaluate", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["export", "trial", "--to", "mat"], "trial: is no result: expected a directory with run.toml"),
    (["compare", "nothing"], "nothing/trial.toml: no such file"),
    (["compare", "trial", "trial"], "two of these are named trial"),
    (["compare", "trial", "--out", "trial"], "exists and is no earlier comparison: expected a new name"),
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
    (["reconstruct", "loop"], "loop/trial.toml: cannot be read: Too many levels of symbolic links"),
    (["reconstruct", "trial", "--out", "loop"], "loop: cannot be written: Too many levels of symbolic links"),
    (["compare", "trial", "--out", "loop/x"], "loop/x: cannot be written: Too many levels of symbolic links"),
    (["live", "--replay", "loop"], "loop/trial.toml: cannot be read: Too many levels of symbolic links"),
    (["simulate", "loop", "--out", "x"], "loop: cannot be read: Too many levels of symbolic links"),
    (["simulate", "", "--out", "x"], "simulate: expected a value after it, got an empty one"),
    (["reconstruct", "press_01", "--out", ""], "--out: expected a value after it, got an empty one"),
    (["live", "--twin", "."], ".: expected a file, got a directory"),
    (["reconstruct", "trial", "--from=-inf"], "--from: expected a finite time, got -inf"),
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
    (path.parent / "fast.toml").write_text("[frames]\nrate_hz = 150\n")
    (path.parent / "loop").symlink_to(path.parent / "loop")
    before = sorted(p.name for p in path.parent.iterdir())
    assert message in refusal_of(*arguments, cwd=path.parent)
    left = sorted(p.name for p in path.parent.rglob("*") if p.parent != path)
    assert [name for name in left if name not in before] in ([], ["results"])


@pytest.mark.parametrize(
    "typed", ["reconstruct trial", "compare trial --method frame", "live --replay trial --speed 9"]
)
def test_what_is_wrong_with_readings_is_told_with_their_trial(trial_copy, typed) -> None:
    """Resistances in kilohm, of which no row and no column is the wrong one."""
    path = trial_copy(rows=120)
    told = (path / "trial.toml").read_text()
    numbers = re.search(r"natural_resistance_ohm = \[(.*?)\]", told)
    thousandth = ", ".join(f"{float(number) / 1000:g}" for number in numbers[1].split(","))
    (path / "trial.toml").write_text(told.replace(numbers[1], thousandth))
    refused = refusal_of(*typed.split(), "--out", "out", cwd=path.parent)
    assert refused.startswith("tensegraph: trial: sensors.natural_resistance_ohm: the first readings are ")


@pytest.mark.parametrize(
    "arguments",
    [
        ["calibrate", ".", "--out", "m.safetensors", "--learning-rate", "-1"],
        ["calibrate", ".", "--out", "m.safetensors", "--learning-rate", "nan"],
        ["calibrate", ".", "--out", "m.safetensors", "--seed", "-1"],
        ["ports", "nowhere", "--baud", "-5"],
    ],
)
def test_a_number_out_of_range_is_refused_by_its_option(tmp_path, arguments) -> None:
    result = refusal_of(*arguments, cwd=tmp_path)
    assert arguments[-2].strip("-").replace("-", "_") in result.replace("-", "_")
    assert "Traceback" not in result


def test_an_error_of_the_system_is_one_line_too(monkeypatch, capsys) -> None:
    def fail() -> None:
        raise PermissionError(13, "Permission denied", "some/file")

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err == "tensegraph: some/file: Permission denied\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is full")
def test_a_full_disk_behind_stderr_leaves_the_exit_code(tmp_path) -> None:
    with open("/dev/full", "w") as full:
        ended = subprocess.run([sys.executable, "-m", "tensegraph", "evaluate", "x"], cwd=tmp_path, stderr=full)
    assert ended.returncode == 2


def test_ctrl_c_while_libraries_are_imported_is_no_traceback(tmp_path) -> None:
    program = """
import sys
class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
from tensegraph.__main__ import main
main()
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def test_what_cannot_be_printed_is_escaped_in_an_error(monkeypatch, capsys) -> None:
    """A cell with zero bytes, a name with a line end, marks that turn the direction of a line round."""

    def fail() -> None:
        raise InputError("a\x00b\tc\nd\u202ee: got 'µ'")

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit):
        cli.main()
    assert capsys.readouterr().err == "tensegraph: a\\x00b\\tc\\nd\\u202ee: got 'µ'\n"


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
    frame = ("reconstruct", path, "--method", "frame", "--figures", "none")
    quiet = run(*frame, "-q", "--out", "quiet", cwd=path.parent)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "written to quiet\n", "")
    verbose = run(*frame, "-v", "--out", "verbose", cwd=path.parent)
    assert "node RMSE" in verbose.stdout
    assert [line.split(":")[0] for line in verbose.stderr.splitlines()] == ["rest shape", "shapes", "tables"]
    names = {p.name for p in (path.parent / "quiet").iterdir()}
    assert names == {
        "shape.csv",
        "ellipsoids.csv",
        "lengths.csv",
        "status.csv",
        "sensor_drift.csv",
        "estimated_loads.csv",
        "run.toml",
    }
    assert tomllib.loads((path.parent / "quiet" / "run.toml").read_text())["method"] == "frame"
    modes = {p.stat().st_mode & 0o777 for p in (path.parent / "quiet").iterdir()}
    assert modes == {path.joinpath("trial.toml").stat().st_mode & 0o777}


def test_what_is_refused_ends_the_process_with_code_2(tmp_path) -> None:
    result = run_process("reconstruct", "nothing", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "tensegraph: nothing/trial.toml: no such file\n"


def test_help_names_the_commands(tmp_path) -> None:
    result = run_process("--help", cwd=tmp_path)
    assert result.returncode == 0
    for command in ("reconstruct", "evaluate", "compare", "calibrate", "simulate"):
        assert command in result.stdout


def test_a_name_of_thousands_of_characters_is_cut_in_the_middle(trial_copy) -> None:
    """File and expectation stay."""
    path = trial_copy(rows=5)
    (path / "config.toml").write_text(f"[frames]\n{'x' * 5000} = 1\n")
    refused = refusal_of("reconstruct", path, "--config", path / "config.toml", cwd=path)
    assert len(refused) < 1000
    assert "config.toml: frames.xxx" in refused
    assert refused.endswith("xxx: is no setting; a run's run.toml lists them all\n")


def test_a_console_of_ascii_shows_signs_by_their_numbers(tmp_path) -> None:
    """The lines of tables are no ASCII."""
    shown = run_process("--help", cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert shown.returncode == 0, shown.stderr
    assert "reconstruct" in shown.stdout


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (["reconstruct", "x", "--jobs", "0"], "Invalid value for '--jobs': .* see tensegraph reconstruct --help"),
        (["reconstruct", "x", "--methd", "live"], "No such option: --methd .*: see tensegraph reconstruct --help"),
        (["evaluate"], "Missing argument .*: see tensegraph evaluate --help"),
        (["--jobs", "2", "reconstruct", "x"], "No such option: --jobs.*: see tensegraph --help"),
        (["rekonstruct"], "No such command 'rekonstruct'.*: see tensegraph --help"),
    ],
)
def test_a_mistake_at_the_options_is_one_line(tmp_path, typed, told) -> None:
    assert re.fullmatch(f"tensegraph: {told}\n", refusal_of(*typed, cwd=tmp_path))


def test_a_notebook_own_settings_of_figures_and_a_screen_without_columns_are_no_hindrance(trial_copy, tmp_path) -> None:
    """The kernel of a notebook names its own backend of matplotlib, which need not be in this environment.

    A user whose own figures are set in TeX may have none of its programs here.
    """
    path = trial_copy(rows=60)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "matplotlibrc").write_text("text.usetex: True\nfigure.autolayout: True\n")
    typed = ("reconstruct", path, "--method", "frame", "--out", tmp_path / "out")
    screen = {"MPLBACKEND": "module://nowhere.backend_inline", "COLUMNS": "0"}
    done = run_process(*typed, cwd=tmp_path, **screen, MPLCONFIGDIR=str(tmp_path / "own"))
    assert (done.returncode, done.stderr) == (0, "")
    assert "written to" in done.stdout
    assert (tmp_path / "out" / "shape.png").is_file()


def test_two_jobs_need_no_stdout(trial_copy, tmp_path) -> None:
    """Python has None in place of a stream that the shell has closed, and a library of jobs flushes it."""
    paths = [str(trial_copy(rows=60, name=name)) for name in ("a", "b")]
    typed = [sys.executable, "-m", "tensegraph", "reconstruct", *paths, "--method", "frame", "--figures", "none"]
    closed = subprocess.run(
        ["sh", "-c", 'exec "$@" >&-', "sh", *typed, "--jobs", "2", "--out", "out"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert (closed.returncode, closed.stderr) == (0, "")
    assert (tmp_path / "out" / "b" / "shape.csv").is_file()


def test_the_folder_of_a_name_is_checked_too(tmp_path) -> None:
    """As of the place of a link, or the folder that `.` stands for."""
    place = tmp_path / os.fsdecode(b"l\xe4b")
    place.mkdir()
    (tmp_path / "link").symlink_to(place)
    for cwd, name in ((tmp_path, "link"), (place, ".")):
        refused = run_process("reconstruct", name, cwd=cwd)
        assert refused.returncode == 2
        assert refused.stderr == f"tensegraph: {name}: expected a name in UTF-8, under a locale of UTF-8\n"


def test_a_name_that_is_not_utf_8_is_refused(tmp_path) -> None:
    """As of a folder of an old archive; results are in UTF-8 and could not name it."""
    named = os.fsdecode(b"tr\xe9s")
    (tmp_path / named).mkdir()
    refused = run_process("reconstruct", named, cwd=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "tensegraph: tr\\udce9s: expected a name in UTF-8, under a locale of UTF-8\n"
