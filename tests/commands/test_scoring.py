"""`tg.evaluate`, `tg.compare` and `tg.calibrate`: the numbers of the commands, as values."""

import json
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

import tensegraph as tg
from command_line import run
from roll import soon_tipped
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.scoring.run_score import truth_of_trial

pytestmark = pytest.mark.usefixtures("undrawn")


def test_evaluate_is_the_command_s(done) -> None:
    folder, *_ = done
    evaluation = tg.evaluate(tg.load(folder / "results" / "press"), folder / "press")
    (scores,) = json.loads(run("evaluate", "results/press", "--json", cwd=folder).stdout)
    assert evaluation.absolute.nodes.rmse_m == pytest.approx(scores["absolute"]["nodes"]["rmse_m"], rel=1e-12)
    assert evaluation.consistency.coverage_95 == scores["consistency"]["coverage_95"]


def test_evaluate_with_another_truth_and_offset(done, tmp_path) -> None:
    """The truth moved by 3 mm along z, and told 1 s late: the errors move with it."""
    folder, *_ = done
    result = tg.load(folder / "results" / "press")
    truth = np.genfromtxt(folder / "press" / "truth.csv", delimiter=",", names=True)
    table = np.array([list(row) for row in truth])
    table[:, 0] -= 1.0
    table[:, 3::3] += 0.003
    np.savetxt(tmp_path / "moved.csv", table, delimiter=",", header=",".join(truth.dtype.names), comments="")
    plain = tg.evaluate(result, folder / "press")
    moved = tg.evaluate(result, folder / "press", tmp_path / "moved.csv", offset_s=1.0)
    difference_m = moved.compared.true_m - plain.compared.true_m
    np.testing.assert_allclose(difference_m, np.broadcast_to([0, 0, 0.003], difference_m.shape), atol=1e-9)
    own, late = (truth_of_trial(tg.open_trial(folder / "press"), None, result, offset_s) for offset_s in (0.0, 5.0))
    np.testing.assert_array_equal(late.loads.t_s, own.loads.t_s + 5.0)  # loads are on the clock of the positions


def test_a_run_with_another_sensor_model_is_evaluated(done) -> None:
    """At a rate of frames that the model of this package was not trained at: the rest shape needs no model."""
    folder, *_ = done
    settings = tg.Settings(frames=replace(tg.Settings().frames, rate_hz=200.0))
    evaluation = tg.evaluate(tg.load(folder / "results" / "press"), folder / "press", settings=settings)
    assert evaluation.absolute.nodes.rmse_m < 0.003


def test_what_does_not_match_is_said(done, loaded) -> None:
    folder, *_ = done
    with pytest.raises(tg.InputError, match="trials: expected a list of trials, as"):
        tg.compare(str(folder / "press"))
    with pytest.raises(tg.InputError, match="method 'best': expected one of batch, live"):
        tg.compare([folder / "press"], ["best"])
    with pytest.raises(tg.InputError, match=r"methods: expected a list of names, as \['batch'\], got one"):
        tg.compare([folder / "press"], "batch")
    with pytest.raises(tg.InputError, match="methods: expected names, or None for all, got none"):
        tg.compare([folder / "press"], [])


@pytest.mark.parametrize("name", ["rod_length_m", "natural_length_m", "anchor_position_m"])
def test_a_run_against_the_trial_of_another_robot_is_refused(done, name) -> None:
    """Joined alike, but 0.01 mm longer or elsewhere, as another one that was measured; what rounds off is the same."""
    folder, *_ = done
    result = tg.load(folder / "results" / "press")

    def with_other(by_m):
        value_m = getattr(result.structure, name).copy()
        value_m.flat[-1] += by_m
        return replace(result, structure=replace(result.structure, **{name: value_m}))

    with pytest.raises(
        tg.InputError, match=rf"press: expected the trial of the run: its {name} differs, by up to 0.01 mm"
    ):
        tg.evaluate(with_other(1e-5), folder / "press")
    assert tg.evaluate(with_other(1e-7), folder / "press").frames > 0


def test_compare_returns_rows(trial_copy) -> None:
    """One method and the rest shape; its row is what evaluate says of the same method."""
    press = trial_copy(rows=60, name="press")
    rows = tg.compare([press], ["frame"])
    assert [(row.trial, row.method) for row in rows] == [
        ("all", "rest shape held"),
        ("all", "graph, frame by frame"),
        ("press", "rest shape held"),
        ("press", "graph, frame by frame"),
    ]
    alone = tg.evaluate(tg.reconstruct(press, "frame"), press)
    assert rows[-1].errors.nodes.rmse_m == pytest.approx(alone.absolute.nodes.rmse_m, rel=1e-9)


def test_a_robot_that_rolls_is_compared_by_what_can_follow_it(tmp_path) -> None:
    """Live and batch as `reconstruct` does it; methods that need anchors are named, and have no numbers."""
    trial = soon_tipped(tmp_path / "roll", 2.0)
    rows = {row.method: row for row in tg.compare([trial]) if row.trial == "roll"}
    assert len(rows) == 7
    for label, method in (("graph, live", "live"), ("graph, batch", "batch")):
        alone = tg.evaluate(tg.reconstruct(trial, method), trial)
        assert rows[label].errors.nodes.rmse_m == pytest.approx(alone.absolute.nodes.rmse_m, rel=1e-9)
    held_m = rows["rest shape held"].errors.nodes.rmse_m
    assert held_m > 2 * rows["graph, batch"].errors.nodes.rmse_m  # in the world, as theirs: the robot is pushed
    without = [method for method, row in rows.items() if row.trials == 0]
    assert without == ["least squares", "UKF", "network alone", "graph, frame by frame"]


def test_displacements_are_from_the_rest_shape_of_the_run(tmp_path) -> None:
    """A tower whose rest shape is not measured is found near the shape that its description gives."""
    structure, position_m = tg.prism_tower(2, 0.3, 0.15)
    run("structure", "--new", "tower", "--stages", "2", "--rod", "0.3", "--out", "tower", cwd=tmp_path)
    length_m = structure.tendon_length_m(position_m)
    described = tomllib.loads((tmp_path / "tower" / "trial.toml").read_text())
    for key in ("board", "adc", "sensors"):
        described.pop(key, None)
    described |= {"lengths": {"file": "lengths.csv"}, "truth": {"file": "truth.csv"}, "rest": {"seconds": 0.5}}
    (tmp_path / "tower" / "trial.toml").write_text(tomli_w.dumps(described))
    for name, columns, values in (
        ("lengths.csv", [f"l{e}_m" for e in range(len(length_m))], length_m),
        ("truth.csv", [f"n{n}_{axis}_m" for n in range(len(position_m)) for axis in "xyz"], position_m.ravel()),
    ):
        rows = [[0.02 * k, *values] for k in range(40)]
        header = ",".join(["t_s", *columns])
        np.savetxt(tmp_path / "tower" / name, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    evaluation = tg.evaluate(tg.reconstruct(tmp_path / "tower", "live"), tmp_path / "tower")
    assert evaluation.displacement.nodes.rmse_m < 0.002


def test_progress_is_told(done) -> None:
    """The graph's error falls from step to step, counted from 1; a method without steps tells nothing."""
    folder, *_ = done
    told = []
    tg.reconstruct(folder / "press", progress=lambda iteration, error: told.append((iteration, error)))
    assert [iteration for iteration, _ in told] == list(range(1, len(told) + 1))
    errors = np.array([error for _, error in told])
    assert len(errors) > 1
    assert (np.diff(errors) <= 0).all()


def test_calibrate_returns_a_model_that_reconstructs(rig_folder, tmp_path, trial_copy) -> None:
    """Ten epochs; nothing is written, and what was left out is told."""
    strips = tmp_path / "strips"
    shutil.copytree(rig_folder / "strips", strips)
    before = sorted(tmp_path.rglob("*"))
    epochs = []
    report = tg.calibrate(
        strips,
        hold_out="s2*",
        settings=TrainingSettings(epochs=10, steps=400, sequences=8),
        progress=lambda epoch, loss: epochs.append(epoch),
    )
    assert sorted(tmp_path.rglob("*")) == before
    assert len(epochs) == 10
    assert [line.partition(":")[0] for line in report.folder.left_out] == [str(strips / "bad.csv")]
    shapes = tg.reconstruct(trial_copy(rows=60), "frame", model=report.model())
    assert np.isfinite(shapes.node_position_m).all()
    with pytest.raises(tg.InputError, match=r"settings: epochs: .*, got 0"):
        tg.calibrate(strips, settings=TrainingSettings(epochs=0))
