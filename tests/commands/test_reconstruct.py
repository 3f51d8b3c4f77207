"""`tensegraph reconstruct`: its table, its files, and what it says of loads."""

import filecmp
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from command_line import printed_by, refusal_of, run
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.io.reports.run_lines import columns_text, flagged_sensors, load_rows, pauses, rest_balance, slip_line
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.values.readings import Flag
from tensegraph.models.values.slip import Slip
from tensegraph.pipeline import ESTIMATORS


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


def test_a_few_columns_are_named_and_others_counted() -> None:
    assert columns_text(["a", "b", "c"]) == "columns a, b, c"
    assert columns_text(["a", "b", "c", "d", "e"]) == "columns a, b, c and 2 more"


@pytest.mark.parametrize("name", ["results/press", "live"])
def test_the_result_is_whole(done, name: str) -> None:
    folder = done[0] / name
    assert sorted(p.name for p in folder.iterdir()) == [
        "ellipsoids.csv",
        "estimated_loads.csv",
        "lengths.csv",
        "lengths.png",
        "run.toml",
        "sensor_drift.csv",
        "sensor_drift.png",
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
    assert header == "t_s,status,smallest_singular_value,mechanism_sigma_m,branch,other_log_ratio,doubt"
    assert first.startswith("0.0000,ok,")


def test_the_figures_are_drawn(done) -> None:
    for figure in ("lengths.png", "sensor_drift.png", "shape.png"):
        assert (done[0] / "results" / "press" / figure).read_bytes().startswith(b"\x89PNG")


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
    assert "RMSE" not in printed_by("reconstruct", "press", cwd=tmp_path)
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
    assert "not used: " in printed_by("reconstruct", path, "--figures", "none", cwd=path.parent)


def test_figures_for_a_paper_are_vectors(trial_copy) -> None:
    """The name of the trial looks like markup and TeX, and is neither."""
    path = trial_copy(rows=40, trial=lambda text: text.replace('"press_01"', "'run [/b] of $\\alpah$'"))
    result = printed_by("reconstruct", path, "--live", "--figures", "pdf", "--out", "out", cwd=path.parent)
    assert "run [/b] of $\\alpah$ (live)" in result
    figures = {file.name for file in (path.parent / "out").iterdir()} - {"run.toml"}
    assert {name for name in figures if not name.endswith(".csv")} == {"lengths.pdf", "shape.pdf", "sensor_drift.pdf"}
    assert (path.parent / "out" / "shape.pdf").read_bytes().startswith(b"%PDF")


def test_several_trials_and_a_second_run(trial_copy) -> None:
    one, two = trial_copy(rows=40, name="one"), trial_copy(rows=40, name="two")
    for _ in range(2):  # an earlier result is replaced
        printed_by("reconstruct", one, two, "--live", "--figures", "none", "--out", "both", cwd=one.parent)
    assert (one.parent / "both" / "one" / "shape.csv").is_file()
    assert (one.parent / "both" / "two" / "shape.csv").is_file()


def test_a_config_file_is_used(trial_copy) -> None:
    path = trial_copy(rows=40)
    (path.parent / "config.toml").write_text("probability = 0.5\n[frames]\nrate_hz = 25.0\n")
    printed_by(
        "reconstruct", path, "--live", "--figures", "none", "--config", "config.toml", "--out", "out", cwd=path.parent
    )
    written = tomllib.loads((path.parent / "out" / "run.toml").read_text())
    assert written["settings"]["probability"] == 0.5
    assert written["frames"] < 25


def test_reconstruct_uses_the_model_it_is_given(rig_folder, calibrated, trial_copy) -> None:
    path = trial_copy(rows=40)
    arguments = ("reconstruct", path, "--live", "--figures", "none", "--out")
    other = run(*arguments, "o", "--model", rig_folder / "m.safetensors", cwd=path.parent)
    shipped = run(*arguments, "s", cwd=path.parent)
    assert other.returncode == shipped.returncode == 0, other.stderr
    assert not filecmp.cmp(path.parent / "o" / "lengths.csv", path.parent / "s" / "lengths.csv", shallow=False)


def test_a_trial_of_lengths_ends_with_its_table(trial_copy, example_structure) -> None:
    path = trial_copy(rows=5)
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    length_m = example_structure.natural_length_m * 1.08
    rows = [",".join(map(str, (0.02 * k, *length_m))) for k in range(5)]
    (path / "lengths.csv").write_text("\n".join([",".join(["t_s", *(f"l{e}_m" for e in range(24))]), *rows, ""]))
    result = printed_by("reconstruct", path, "--figures", "none", "--out", "out", cwd=path.parent)
    assert "5" in result
    assert "written to out" in result


def test_rows_by_hand(loaded) -> None:
    """Node 5 for 99 frames of 0.02 s, node 8 for 10 of them, which is too short."""
    rows = dict(load_rows(loaded, 0.2))
    assert rows["largest load"] == "2.00 N at node 5, t = 0.02 s"
    assert rows["nodes above 0.2 N for 1 s"] == "5 (2.0 s)"


def test_no_load_is_long_enough(loaded) -> None:
    assert dict(load_rows(loaded, 3.0))["nodes above 3 N for 1 s"] == "none"


def test_without_stiffness_nothing_is_said(loaded, rest) -> None:
    assert load_rows(replace(loaded, loads=None), 0.2) == []
    assert rest_balance(rest) == []


def test_the_balance_at_rest(structure, rest) -> None:
    mechanics = Mechanics(np.full(24, 400.0), structure.natural_length_m, 0.03, 0.02)
    rows = rest_balance(replace(rest, mechanics=mechanics, unbalanced_n=(0.4, 0.0021)))
    assert rows == [("forces at rest", "0.400 N rms unbalanced as given, 0.002 N after taring")]


def test_slips_are_counted_in_one_line() -> None:
    slips = [Slip(3.1, 4, np.array([0.03, 0.04, 0]), 0.005), Slip(5.0, 2, np.array([0.01, 0, 0]), 0.004)]
    assert slip_line(slips) == "2, of node 2, 4; at most 50 ± 5 mm, node 4 at t = 3.10 s"
    assert slip_line([]) == "none"


def test_a_span_is_a_part_of_the_whole(trial_copy) -> None:
    """Shapes before it are estimated and left out, so that those in it are the same; the end is not read."""
    path = trial_copy(rows=60)
    words = ("reconstruct", path, "--live", "--figures", "none", "--out")
    assert run(*words, "whole", cwd=path.parent).returncode == 0
    assert run(*words, "part", "--from", 0.5, "--to", 0.8, cwd=path.parent).returncode == 0
    whole, part = ((path.parent / name / "shape.csv").read_text().splitlines() for name in ("whole", "part"))
    assert part[1:] == [row for row in whole[1:] if 0.5 <= float(row.split(",")[0]) <= 0.8]
    assert len(part) == 1 + 16
    table = tomllib.loads((path.parent / "part" / "run.toml").read_text())
    assert (table["from_s"], table["to_s"], table["frames"]) == (0.5, 0.8, 16)
    none = refusal_of(*words, "none", "--from", 7, cwd=path.parent)
    assert "--from and --to: expected a span within 0.00 to 1.2" in none
    late = refusal_of(*words, "late", "--from", 0.8, "--to", 0.5, cwd=path.parent)
    assert late == "tensegraph: --to: expected a time after --from, 0.8 s, got 0.5\n"
    two = refusal_of("reconstruct", path, "--live", "--method", "ukf", cwd=path.parent)
    assert "--live: is the same as --method live: expected one method, got --method ukf, too" in two


def test_an_estimator_that_tells_its_progress_has_no_stage_of_its_own(trial_copy, monkeypatch) -> None:
    """One of a user's own that inherits from ours."""
    monkeypatch.setitem(ESTIMATORS, "own", BatchOptimizer)
    path = trial_copy(rows=60)
    done = run("reconstruct", path, "--method", "own", "--figures", "none", cwd=path.parent)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_tendon_without_a_sensor_is_not_flagged(loaded) -> None:
    shapes = replace(loaded, structure=replace(loaded.structure, unsensed=[5, 11]))
    shapes.flags[:, [5, 11]] = int(Flag.MISSING)
    assert flagged_sensors(shapes) == []
    shapes.flags[50:, 7] = int(Flag.MISSING)
    assert flagged_sensors(shapes) == ["tendon 7: left out of 50 frames from 1.00 s"]
    shapes.flags[10:12, 8] = int(Flag.OUTLIER)  # the readings about a spike give the length
    shapes.flags[12, 8] = int(Flag.OUTLIER | Flag.MISSING)
    assert "tendon 8: outlier from 0.20 s, left out of 1 frame from 0.24 s" in flagged_sensors(shapes)


def test_many_pauses_are_one_line() -> None:
    """As of stamps in milliseconds."""
    assert pauses(np.array([0.0, 0.02, 2.0, 2.02])) == ["from 0.02 to 2.00 s"]
    assert pauses(20.0 * np.arange(12)) == ["11 times, for 20 s in the median: are stamps in seconds?"]
