"""The command line as a user types it: help, and what is refused."""

import pytest

from command_line import run

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


def test_help_names_the_commands(tmp_path) -> None:
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    for command in ("reconstruct", "evaluate", "compare", "calibrate", "simulate"):
        assert command in result.stdout
