"""Parts that other packages bring, as a user installs and types them."""

import csv
import hashlib
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import tensegraph as tg
from command_line import refusal_of, run, run_process
from installed import SOURCE, install
from plan_edits import SHORT_REST, replaced
from tensegraph.models.plug_ins import PlugInWarning, plug_ins

pytestmark = pytest.mark.usefixtures("undrawn")

ROOT = Path(__file__).parents[2]
KINDS = ("estimators", "factors", "sensor_models", "readers", "exporters")


def lengths_trial(trial: Path, rows: list[list[float]], file: str, text: str) -> Path:
    """Turn a trial of counts into one of lengths in a file."""
    toml = (trial / "trial.toml").read_text()
    blocks = [block for block in toml.split("\n\n") if not block.lstrip().startswith(("[[board]]", "[truth]"))]
    (trial / "trial.toml").write_text("\n\n".join(blocks) + f'\n\n[lengths]\nfile = "{file}"\n')
    (trial / file).write_text(text)
    return trial


def test_the_example_s_names_are_those_that_are_found(own_parts) -> None:
    project = tomllib.loads((SOURCE / "pyproject.toml").read_text())["project"]
    for kind in KINDS:
        found = plug_ins(kind, ())
        assert found.keys() == project["entry-points"][f"tensegraph.{kind}"].keys()
        for one in found.values():
            assert (one.package, one.version) == ("own-parts", "1.0")
            assert one.load().__doc__


def test_an_estimator_is_a_method_whose_result_is_evaluated(own_parts, trial_copy, tmp_path) -> None:
    """Typed as a user types it, in a process of its own; run.toml tells what made it, byte for byte."""
    trial_copy(rows=60, name="press")
    done = run_process("reconstruct", "press", "--method", "rest-held", "--figures", "none", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    made = tomllib.loads((tmp_path / "results" / "press_rest-held" / "run.toml").read_text())
    digest = hashlib.sha256(b"own_parts.py" + (own_parts / "own_parts.py").read_bytes()).hexdigest()
    told = {"package": "own-parts", "version": "1.0", "sha256": digest}
    assert made["method"] == "rest-held"
    assert made["plug_ins"] == {"estimators": {"rest-held": told}}
    (scores,) = json.loads(run("evaluate", "results/press_rest-held", "--json", cwd=tmp_path).stdout)
    assert (scores["method"], scores["absolute"]["nodes"]["rmse_m"] > 0) == ("rest-held", True)
    again = run("reconstruct", "press", "--method", "rest-held", "--figures", "none", cwd=tmp_path)
    assert "up to date" in again.stdout
    with (own_parts / "own_parts.py").open("a") as file:
        file.write("# a changed plug-in\n")
    changed = run("reconstruct", "press", "--method", "rest-held", "--figures", "none", cwd=tmp_path)
    assert "up to date" not in changed.stdout


def test_compare_takes_it_too_and_names_what_it_takes(own_parts, trial_copy, tmp_path) -> None:
    trial_copy(rows=60, name="press")
    done = run("compare", "press", "--method", "rest-held", "--method", "frame", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    with (tmp_path / "results/comparison/comparison.csv").open() as file:
        rows = {row["method"]: row for row in csv.DictReader(file) if row["trial"] == "press"}
    assert rows.keys() == {"rest shape held", "rest-held", "graph, frame by frame"}
    assert rows["rest-held"]["nodes_rmse_m"] == rows["rest shape held"]["nodes_rmse_m"]
    assert rows["rest-held"]["coverage_95"] not in ("", "nan")
    refused = refusal_of("compare", "press", "--method", "rest", cwd=tmp_path)
    assert refused == (
        "tensegraph: method 'rest': expected one of batch, live, frame, least-squares, ukf, network, rest-held\n"
    )


def test_a_method_that_is_none_is_refused_before_any_work(own_parts, tmp_path) -> None:
    refused = refusal_of("reconstruct", "nowhere", "--method", "rest", cwd=tmp_path)
    assert refused == (
        "tensegraph: --method rest: expected one of batch, live, frame, least-squares, ukf, network, rest-held\n"
    )


def test_run_toml_names_the_model_file(done) -> None:
    """Of batch and of live, that of the package."""
    folder, *_ = done
    digest = hashlib.sha256((ROOT / "models" / "data" / "stretching.safetensors").read_bytes()).hexdigest()
    for result in ("results/press", "live"):
        made = tomllib.loads((folder / result / "run.toml").read_text())
        assert made["model"] == {"file": "stretching.safetensors", "sha256": digest}


def test_a_reader_is_chosen_by_the_suffix(own_parts, trial_copy, tmp_path) -> None:
    """The same lengths from a CSV file and in millimetres give the same bytes; run.toml names the reader."""
    natural_m = tg.open_trial(trial_copy(name="first")).description.structure.natural_length_m
    rows = [[0.02 * k, *(1.2 * natural_m + 0.001 * np.sin(k))] for k in range(40)]
    columns = ",".join(["t_s", *(f"l{e}_m" for e in range(len(natural_m)))])
    as_csv = "\n".join([columns, *(",".join(f"{value:.4f}" for value in row) for row in rows), ""])
    as_mm = "".join(" ".join(f"{1000 * value:.1f}" for value in row) + "\n" for row in rows)
    lengths_trial(trial_copy(name="plain"), rows, "lengths.csv", as_csv)
    lengths_trial(trial_copy(name="other"), rows, "lengths.mm", as_mm)
    for name in ("plain", "other"):
        done = run("reconstruct", name, "--method", "frame", "--figures", "none", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
    shapes = [(tmp_path / "results" / f"{name}_frame" / "shape.csv").read_bytes() for name in ("plain", "other")]
    assert shapes[0] == shapes[1]
    made = tomllib.loads((tmp_path / "results" / "other_frame" / "run.toml").read_text())
    assert made["plug_ins"]["readers"]["mm"]["package"] == "own-parts"
    assert "lengths.mm" in made["inputs"]
    plain = tomllib.loads((tmp_path / "results" / "plain_frame" / "run.toml").read_text())
    assert "plug_ins" not in plain


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 1 2\n", "lengths.mm: row 1: expected t_s and 24 lengths, with or without 24 sigmas, got 3 numbers from "),
        ("0 x\n", "lengths.mm: after row 0: reader 'mm' of package own-parts 1.0 cannot read it: ValueError: could "),
        ("nan" + 24 * " 200" + "\n", "lengths.mm: row 1: expected a finite t_s, and no inf, from reader 'mm' of "),
        ("", "holds no readings: expected at least one row in lengths.mm"),
    ],
)
def test_a_file_that_a_reader_cannot_read_is_one_line(own_parts, trial_copy, tmp_path, text, message) -> None:
    lengths_trial(trial_copy(name="press"), [], "lengths.mm", text)
    assert message in refusal_of("reconstruct", "press", cwd=tmp_path)


def test_a_sensor_model_is_a_model(own_parts, trial_copy, tmp_path) -> None:
    """By its name on the command line and in Python; run.toml names it in place of a file."""
    trial_copy(rows=60, name="press")
    done = run("reconstruct", "press", "--model", "straight", "--method", "frame", "--figures", "none", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    made = tomllib.loads((tmp_path / "results" / "press_frame" / "run.toml").read_text())
    assert made["plug_ins"]["sensor_models"]["straight"]["version"] == "1.0"
    assert "model" not in made
    shape = np.genfromtxt(tmp_path / "results" / "press_frame" / "shape.csv", delimiter=",", skip_header=1)
    again = tg.reconstruct(tmp_path / "press", "frame", model="straight")
    np.testing.assert_allclose(again.node_position_m.reshape(len(shape), -1), shape[:, 1:], atol=1e-6)
    refused = refusal_of("reconstruct", "press", "--model", "crooked", cwd=tmp_path)
    assert refused == "tensegraph: --model crooked: no such file: expected one, or one of straight\n"
    with pytest.raises(tg.InputError, match="or one of straight, got a path"):
        tg.reconstruct(tmp_path / "press", model="crooked")


def test_a_sensor_model_of_another_package_serves_a_rig(own_parts, example, pty_boards, tmp_path) -> None:
    """By its name in `record` and `tg.Boards` as in `live`; while the sensors are tared, the boards send one code."""
    text = (example.parent / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(replaced(text, SHORT_REST))
    boards = [pty_boards(name, k) for k, name in enumerate(("zero", "one"))]
    for board in boards:
        board.codes = lambda: (512,) * 12
    ports = [str(board.port) for board in boards]
    words = [
        "--rig",
        "rig.toml",
        "--model",
        "straight",
        "--seconds",
        1.0,
        *(w for port in ports for w in ("--port", port)),
    ]
    for command in (["record", "--out", "recorded"], ["live", "--out", "live"]):
        done = run(*command, *words, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        assert "tared: tendons changed by 0.0 mm" in done.stdout
    assert tomllib.loads((tmp_path / "live" / "run.toml").read_text())["plug_ins"]["sensor_models"].keys() == {
        "straight"
    }
    with tg.Boards(tmp_path / "rig.toml", ports=ports, model="straight", say=lambda text: None) as rig:
        shape = next(iter(rig))
        rig.stop()
    assert (shape.lengths.sigma_m[np.isfinite(shape.lengths.sigma_m)] > 0).all()


def test_a_rig_s_sensor_model_that_is_none_is_refused(own_parts, example, tmp_path) -> None:
    rig = example.parent / "rig.toml"
    refused = refusal_of("record", "--rig", rig, "--out", "t", "--model", "crooked", cwd=tmp_path)
    assert refused == "tensegraph: --model crooked: no such file: expected one, or one of straight\n"
    with pytest.raises(tg.InputError, match="or one of straight, got a path"), tg.Boards(rig, model="crooked"):
        pass


def test_an_exporter_is_a_format(own_parts, done, tmp_path) -> None:
    folder, *_ = done
    result = folder / "results" / "press"
    written = run("export", result, "--to", "xyz", "--out", "press.xyz", cwd=tmp_path)
    assert (written.returncode, written.stderr) == (0, "")
    lines = (tmp_path / "press.xyz").read_text().splitlines()
    shape = np.genfromtxt(result / "shape.csv", delimiter=",", skip_header=1)
    assert lines[:2] == ["12", "press_01 t = 0.0000 s"]
    first_m = np.array([line.split()[1:] for line in lines[2:14]], dtype=float) / 1000
    np.testing.assert_allclose(first_m.ravel(), shape[0, 1:], atol=1e-6)
    tg.export(tg.load(result), tmp_path / "by_suffix.xyz")
    refused = refusal_of("export", result, "--to", "xy", cwd=tmp_path)
    assert refused.startswith("tensegraph: --to xy: expected one of mat, npz,")
    assert refused.endswith("gif, xyz\n")


def test_a_plug_in_that_cannot_be_imported_is_one_line(site, tmp_path) -> None:
    install("half-done", "0.3", {"tensegraph.estimators": {"mine": "half_done:Mine"}}, site)
    for text, reason in (("import nothing_such\n", "ModuleNotFoundError: "), ("Mine = 3\n", "expected a class or a ")):
        (site / "half_done.py").write_text(text)
        refused = refusal_of("reconstruct", "press", "--method", "mine", cwd=tmp_path)
        assert refused.startswith("tensegraph: estimator 'mine' of package half-done 0.3: half_done:Mine")
        assert reason in refused


def test_an_exporter_that_fails_is_one_line(site, done, tmp_path) -> None:
    install("half-written", "0.3", {"tensegraph.exporters": {"abc": "half_written:write"}}, site)
    (site / "half_written.py").write_text("def write(result, about, path):\n    raise KeyError('a\\nb')\n")
    result = done[0] / "results" / "press"
    refused = refusal_of("export", result, "--out", "press.abc", cwd=tmp_path)
    why = "exporter 'abc' of package half-written 0.3 cannot write it: KeyError: 'a\\nb'"
    assert refused == f"tensegraph: press.abc: {why}\n"
    assert not (tmp_path / "press.abc").exists()


def test_ours_win_and_that_is_said(site, trial_copy, tmp_path) -> None:
    install("rival", "2.0", {"tensegraph.estimators": {"frame": "nothing_such:Mine"}}, site)
    trial_copy(rows=60, name="press")
    done = run_process("reconstruct", "press", "--method", "frame", "--figures", "none", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == (
        "tensegraph: estimator 'frame' of package rival 2.0: is not used: the name is one of tensegraph's own\n"
    )
    with pytest.warns(PlugInWarning, match="estimator 'frame' of package rival"):
        assert plug_ins("estimators", ["frame"]) == {}


def test_two_packages_with_one_name(site, tmp_path) -> None:
    for name in ("one", "other"):
        install(name, "1", {"tensegraph.estimators": {"mine": "nothing_such:Mine"}}, site)
    refused = refusal_of("reconstruct", "press", "--method", "mine", cwd=tmp_path)
    assert refused == "tensegraph: estimator 'mine': expected one package that brings it, got one and other\n"
