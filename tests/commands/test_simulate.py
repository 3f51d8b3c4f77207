"""`tensegraph simulate`: trials the same in form as recorded ones, the same bytes for one seed."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by, refusal_of, run, run_process
from plan_edits import PLANS, SHORT, replaced
from tensegraph import InputError, reconstruct
from tensegraph.commands.simulate import simulate


def test_a_simulated_trial_is_reconstructed(tmp_path) -> None:
    """The twin's commands as the README has them, on four seconds of the prism."""
    text = (Path(__file__).parents[2] / "examples" / "plans" / "prism.toml").read_text()
    text = text[: text.index("[[load.random]]")].replace("duration_s = 30.0", "duration_s = 4.0")
    (tmp_path / "prism.toml").write_text(text)
    result = run_process("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("prism_01: ")
    assert "written to prism_01" in result.stdout
    again = run("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path)
    assert (again.returncode, again.stdout) == (0, "up to date: prism_01\n")
    (tmp_path / "prism_01" / "board0.csv").unlink()
    assert "written to prism_01" in run("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path).stdout
    assert (tmp_path / "prism_01" / "board0.csv").exists()
    (tmp_path / "prism_01" / "simulation.toml").rename(tmp_path / "elsewhere.toml")
    refused = refusal_of("simulate", "prism.toml", "--out", "prism_01", cwd=tmp_path)
    assert "prism_01: exists and is no earlier result: expected a new name" in refused
    assert "node RMSE" in printed_by("reconstruct", "prism_01", "--figures", "none", cwd=tmp_path)


def test_what_mujoco_takes_for_no_body_is_one_line(tmp_path) -> None:
    """Rods of a picogram have an inertia that its numbers do not hold."""
    text = PLANS["prism"].read_text().replace("rod_mass_kg = 0.030", "rod_mass_kg = 1e-12")
    text = text.replace("tendon_stiffness_n_per_m = 400.0", "tendon_stiffness_n_per_m = 1e-8")
    (tmp_path / "light.toml").write_text(text)
    result = refusal_of("simulate", "light.toml", "--out", "trial", cwd=tmp_path)
    assert result.startswith("tensegraph: light.toml: MuJoCo refuses the structure: ")
    assert [p.name for p in tmp_path.iterdir()] == ["light.toml"]


def test_a_bad_plan_is_one_line_and_nothing_is_written(tmp_path) -> None:
    text = (Path(__file__).parents[2] / "examples" / "plans" / "press.toml").read_text()
    (tmp_path / "bad.toml").write_text(text.replace("push_back", "push_bak"))
    result = refusal_of("simulate", "bad.toml", "--out", "trial", cwd=tmp_path)
    line = 1 + text[: text.index("push_back")].count("\n")
    assert f"bad.toml: line {line}: mechanics.push_bak: is no key of a plan" in result
    assert [p.name for p in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.parametrize("seed", ["-1", "99999999999999999999999999"])
def test_a_seed_that_no_file_could_hold_is_refused(tmp_path, seed) -> None:
    result = run("simulate", str(PLANS["prism"]), "--out", "trial", f"--seed={seed}", cwd=tmp_path)
    assert (result.returncode, list(tmp_path.iterdir())) == (2, [])
    assert "seed" in result.stderr
    with pytest.raises(InputError, match="seed: expected a whole number from 0 to"):
        simulate(PLANS["prism"], tmp_path / "trial", seed=int(seed))


def shape_of(value: object) -> object:
    """A TOML value's types, and the lengths of its lists."""
    if isinstance(value, dict):
        return {key: shape_of(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [shape_of(inner) for inner in value]
    return type(value)


def form(path: Path) -> list[tuple[str, ...]]:
    """The header, and every form that a row's cells take: digits before the point do not count."""
    header, *rows = path.read_bytes().decode().split("\r\n")
    assert rows.pop() == ""
    return [(header,), *sorted({tuple(re.sub(r"^-?\d+", "9", cell) for cell in row.split(",")) for row in rows[:1]})]


def test_a_twin_s_trial_is_one_in_form(made, example) -> None:
    """Same files, columns, digits and line ends; same keys, types and list lengths in trial.toml."""
    assert {p.name for p in made.path.iterdir()} == {p.name for p in example.iterdir()}
    mine, theirs = made.toml, tomllib.loads((example / "trial.toml").read_text())
    assert shape_of(mine) == shape_of(theirs)
    assert list(mine) == list(theirs)
    assert not made.description.ignored_keys
    for name in ("board0.csv", "board1.csv", "truth.csv", "loads.csv"):
        digits = [
            [len(cell.partition(".")[2]) for cell in row]
            for row in (form(made.path / name)[1], form(example / name)[1])
        ]
        assert form(made.path / name)[0] == form(example / name)[0]
        assert digits[0] == digits[1]


def test_rows_come_as_boards_send_them(made) -> None:
    for board in (0, 1):
        rows = [row for row in made.readings() if row.board == board]
        seq, device_us = np.array([row.seq for row in rows]), np.array([row.device_us for row in rows])
        host_s = np.array([row.host_s for row in rows])
        assert 290 < len(rows) <= 300
        assert seq[0] <= 1
        np.testing.assert_array_equal(np.diff(device_us), 20_000 * np.diff(seq))
        assert (np.diff(host_s) > 0).all()
    truth = made.truth()
    np.testing.assert_allclose(truth.t_s, np.arange(300) / 50)
    assert np.ptp(truth.node_position_m[:100], axis=0).max() < 5e-6  # rest.seconds
    assert np.ptp(truth.node_position_m, axis=0).max() > 0.005


def test_same_plan_and_seed_same_bytes_another_seed_another_trial(made, tmp_path) -> None:
    plan = made.path.parent / "press.toml"
    again = simulate(plan, tmp_path / "again")
    other = simulate(plan, tmp_path / "other", seed=2)
    assert other.name == "press_02"
    for file in made.path.iterdir():
        assert (again.path / file.name).read_bytes() == file.read_bytes(), file.name
        assert (other.path / file.name).read_bytes() != file.read_bytes(), file.name


def test_faults_stand_in_the_truth(tmp_path) -> None:
    edits = (*SHORT, ("until_s = 22.0", "until_s = 5.9"), ("from_s = 7.0", "from_s = 3.0"))
    edits += (("at_s = 23.0", "at_s = 5.0"), ("from_s = 26.0", "from_s = 4.0"), ("until_s = 30.0", "until_s = 6.0"))
    text = PLANS["prism"].read_text()
    for old, new in edits:
        text = text.replace(old, new)
    (tmp_path / "prism.toml").write_text(text)
    trial = simulate(tmp_path / "prism.toml", tmp_path / "out")
    fault = {"kind": "open_circuit", "tendon": 7, "from_s": 4.0, "until_s": 6.0}
    assert trial.toml["truth"]["fault"] == [fault]
    counts = np.array([row.counts[7] for row in trial.readings()])
    assert (counts[210:] == 1023).all()
    result = reconstruct(trial, "live")
    assert result.node_position_m.shape[1:] == (6, 3)
    assert np.isfinite(result.node_position_m).all()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("lost_rows", "0.9999999", "boards.lost_rows: expected fewer than 1: no row is left"),
        ("delay_s", "1e9", "boards.delay_s: expected at most 60 s, got 1e+09"),
    ],
)
def test_boards_of_which_nothing_would_be_read_are_refused(tmp_path, key, value, message) -> None:
    text = PLANS["prism"].read_text()
    text = text[: text.index("[[load.random]]")].replace("duration_s = 30.0", "duration_s = 3.0")
    (tmp_path / "prism.toml").write_text(re.sub(rf"(?m)^{key} = \S+", f"{key} = {value}", text))
    with pytest.raises(InputError, match=re.escape(message)):
        simulate(tmp_path / "prism.toml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_plan_that_is_not_there_and_a_trial_that_is(tmp_path) -> None:
    with pytest.raises(InputError, match=r"none.toml: no such file"):
        simulate(tmp_path / "none.toml", tmp_path / "out")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=r"out: exists: expected a new name"):
        simulate(PLANS["press"], tmp_path / "out")
    assert not any((tmp_path / "out").iterdir())


def test_a_trial_that_nobody_could_read_is_not_written(tmp_path) -> None:
    """A spread of a hundred thousand times the resistance: some strips would have less than none."""
    text = PLANS["prism"].read_text()
    text = replaced(text[: text.index("[[load.random]]")], ("duration_s = 30.0", "duration_s = 3.0"))
    (tmp_path / "prism.toml").write_text(text.replace("resistance_spread = 0.10", "resistance_spread = 1e5"))
    refused = refusal_of("simulate", "prism.toml", "--out", "out", cwd=tmp_path)
    assert "prism.toml: sensors.natural_resistance_ohm[" in refused
    assert [path.name for path in tmp_path.iterdir()] == ["prism.toml"]
