"""Numbers in a wrong unit, files from another editor, stamps that jump: as a user meets them."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w

from command_line import printed_by, refusal_of, run
from trial_edits import replaced, rewritten, stamped


def scaled(table: str, key: str, factor: float) -> Callable[[str], str]:
    def edit(text: str) -> str:
        content = tomllib.loads(text)
        value = content[table][key]
        content[table][key] = [part * factor for part in value] if isinstance(value, list) else value * factor
        return tomli_w.dumps(content)

    return edit


@pytest.mark.parametrize(
    ("table", "key", "factor", "place"),
    [
        ("structure", "rod_length_m", 1000.0, "natural_length_m[0]"),
        ("structure", "natural_length_m", 1000.0, "natural_length_m[0]"),
        ("sensors", "natural_resistance_ohm", 0.001, "sensors.natural_resistance_ohm"),
        ("mechanics", "tendon_stiffness_n_per_m", 1e17, "mechanics.tendon_stiffness_n_per_m"),
        ("mechanics", "tendon_stiffness_n_per_m", 1e6, "mechanics.tendon_stiffness_n_per_m"),
        ("mechanics", "tendon_stiffness_n_per_m", 1e-3, "mechanics.tendon_stiffness_n_per_m"),
        ("mechanics", "rod_mass_kg", 1e3, "mechanics.tendon_stiffness_n_per_m"),
        ("mechanics", "rod_mass_kg", 1e6, "mechanics.rod_mass_kg"),
    ],
)
def test_a_wrong_unit_is_refused_by_that_word(
    trial_copy: Callable[..., Path], table: str, key: str, factor: float, place: str
) -> None:
    trial = trial_copy(trial=scaled(table, key, factor))
    ended = refusal_of("reconstruct", trial, "--out", "result", cwd=trial.parent)
    assert place in ended
    assert "unit" in ended
    assert not (trial.parent / "result").exists()


def test_truth_in_millimetres_is_not_used_and_said(trial_copy: Callable[..., Path]) -> None:
    def in_millimetres(text: str) -> str:
        header, *rows = text.splitlines()
        cells = [row.split(",") for row in rows]
        return "\n".join([header, *(",".join([t, *(str(1000 * float(c)) for c in rest)]) for t, *rest in cells)]) + "\n"

    trial = trial_copy(rows=60, truth=in_millimetres)
    ended = printed_by("reconstruct", trial, "--live", "--figures", "none", cwd=trial.parent)
    assert "not used: truth: expected nodes as far apart" in " ".join(ended.split())
    assert "nan mm" not in ended


def test_truth_of_another_time_is_told(trial_copy: Callable[..., Path]) -> None:
    trial = trial_copy(rows=60, truth=stamped(lambda t_s: t_s + 1e4))
    ended = run("reconstruct", trial, "--live", "--figures", "none", cwd=trial.parent)
    assert "covers no frame" in " ".join(ended.stdout.split())
    assert "nan mm" not in ended.stdout


def test_toml_with_a_byte_order_mark_is_read(trial_copy: Callable[..., Path]) -> None:
    trial = trial_copy(rows=60)
    file = trial / "trial.toml"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert run("reconstruct", trial, "--live", "--figures", "none", cwd=trial.parent).returncode == 0


def test_an_integer_of_thousands_of_digits_is_refused(trial_copy: Callable[..., Path]) -> None:
    trial = trial_copy()
    file = trial / "trial.toml"
    rewritten(file, replaced("bits = 10", "bits = " + "9" * 5000))
    assert "cannot be read as TOML" in refusal_of("reconstruct", trial, cwd=trial.parent)


@pytest.mark.parametrize("y_m", [12.0, 0.05])
def test_a_node_of_the_rest_shape_far_away_is_refused(y_m: float, trial_copy: Callable[..., Path]) -> None:
    """By metres, and by 50 mm, which would be a rod of another length in all frames."""

    def edit(text: str) -> str:
        content = tomllib.loads(text)
        content["rest"]["node_position_m"][7][1] += y_m
        return tomli_w.dumps(content)

    trial = trial_copy(trial=edit)
    ended = refusal_of("reconstruct", trial, cwd=trial.parent)
    assert "rest.node_position_m: expected rod 3 to be 0.3 m long, got " in ended


@pytest.mark.parametrize("command", ["reconstruct", "structure"])
def test_a_tendon_without_length_in_the_rest_shape_is_refused(command: str, trial_copy: Callable[..., Path]) -> None:
    """Node 6 where node 4 is: its rod is as long as told to within a tenth."""

    def edit(text: str) -> str:
        content = tomllib.loads(text)
        content["rest"]["node_position_m"][6] = content["rest"]["node_position_m"][4]
        return tomli_w.dumps(content)

    trial = trial_copy(trial=edit)
    ended = refusal_of(command, trial if command == "reconstruct" else trial / "trial.toml", cwd=trial.parent)
    assert "rest.node_position_m: nodes 4 and 6, which tendon 12 joins, are at one place" in ended


def test_truth_in_milliseconds_is_refused(trial_copy: Callable[..., Path]) -> None:
    trial = trial_copy(rows=60, truth=stamped(lambda t_s: 1e3 * t_s))
    ended = run("reconstruct", trial, "--live", "--figures", "none", cwd=trial.parent)
    assert "expected frames at most 1 s apart, got 20 s" in " ".join(ended.stdout.split())
