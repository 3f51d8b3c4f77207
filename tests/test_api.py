"""The public names, and the README's ten lines of Python."""

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensegraph
from tensegraph import Shape, Status, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.reports.terminal import Terminal
from tensegraph.scoring.method_scores import measure

ROOT = Path(__file__).parents[1]
PUBLIC = [
    "Boards",
    "BoardReading",
    "DescribedStructure",
    "Ellipsoids",
    "Flag",
    "IndeterminateError",
    "InputError",
    "Mode",
    "Reconstruction",
    "ResistanceReading",
    "Settings",
    "Shape",
    "Status",
    "Structure",
    "TendonLengths",
    "TensegraphError",
    "Trial",
    "calibrate",
    "compare",
    "evaluate",
    "export",
    "load",
    "open_trial",
    "plot",
    "prism_tower",
    "read_description",
    "read_sensor_model",
    "read_structure",
    "reconstruct",
    "saddle_tower",
    "save",
    "simulate",
    "six_strut",
    "stream",
    "three_strut",
    "write_sensor_model",
]


def test_public_names_are_these() -> None:
    text = (ROOT / "__init__.pyi").read_text()
    assert sorted(re.findall(r" as (\w+)$", text, re.MULTILINE)) == sorted([*PUBLIC, "pipeline"])
    assert sorted(tensegraph.__all__) == sorted([*PUBLIC, "pipeline"])
    for name in PUBLIC:
        assert getattr(tensegraph, name).__doc__


def test_the_readme_s_python_is_short() -> None:
    """That it runs is shown with all other snippets."""
    readme = (ROOT / "README.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) <= 12


def test_any_iterator_of_readings_will_do(example) -> None:
    trial = tensegraph.open_trial(example)

    def first_second():
        for row in trial.readings():
            if row.host_s > 1.0:
                return
            yield row

    shapes = list(tensegraph.stream(first_second(), trial.description))
    assert 45 < len(shapes) < 55
    assert shapes[-1].ellipsoids(0.95).semi_axis_m.shape == (12, 3)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"board": 2}, "board 2: expected one from 0 to 1"),
        ({"board": None}, "board None: expected one from 0 to 1"),
        ({"host_s": 1e18}, r"board 0: host_s: expected a stamp of at most 1e\+11 s, got 1e\+18"),
        ({"host_s": np.nan}, r"board 0: host_s: expected a stamp .*, got nan"),
        ({"counts": np.zeros(11, dtype=np.int64)}, r"board 0: expected counts of 12 channels, got \(11,\)"),
    ],
)
def test_a_row_that_no_board_sends_is_refused(example, wrong, told) -> None:
    trial = tensegraph.open_trial(example)
    row = replace(next(row for row in trial.readings() if row.board == 0), **wrong)
    with pytest.raises(tensegraph.InputError, match=told):
        list(tensegraph.stream([row], trial.description))


def test_a_trial_is_no_description_of_one(example) -> None:
    with pytest.raises(tensegraph.InputError, match=r"expected the description of a trial, as trial\.description"):
        list(tensegraph.stream([], tensegraph.open_trial(example)))


def test_a_run_is_evaluated_against_its_own_trial(trial_copy, tmp_path) -> None:
    result = tensegraph.reconstruct(trial_copy(rows=60), "frame")
    other = trial_copy(rows=60, name="other", trial=lambda text: text.replace("[0, 1], [1, 2]", "[1, 2], [0, 1]"))
    with pytest.raises(tensegraph.InputError, match="other: expected the trial of the run: its nodes are joined other"):
        tensegraph.evaluate(result, other)


def test_live_shapes_come_while_readings_come(example) -> None:
    """A shape is out as soon as both boards have passed the end of its frame: within 50 ms.

    The first ones wait until the boards have sent five rows each, which tell how fast they are.
    """
    trial = tensegraph.open_trial(example)
    now_s = [0.0]

    def watched():
        for row in trial.readings():
            if row.host_s > 3.0:
                return
            now_s[0] = row.host_s
            yield row

    late_s = [now_s[0] - shape.t_s for shape in tensegraph.stream(watched(), trial.description) if now_s[0] < 2.9]
    assert np.median(late_s) < 0.03
    assert max(late_s[:5]) < 0.15
    assert max(late_s[5:]) < 0.08


def test_saved_results_are_those_of_the_command(tmp_path, trial_copy, undrawn) -> None:
    result = tensegraph.reconstruct(trial_copy(rows=40), "live")
    tensegraph.save(result, tmp_path / "out")
    shape = np.genfromtxt(tmp_path / "out" / "shape.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(shape[:, 1:].reshape(-1, 12, 3), result.node_position_m, atol=1e-6)
    with pytest.raises(tensegraph.InputError, match="exists and is no earlier result"):
        tensegraph.save(result, tmp_path / "trial")


def test_tables_without_figures(tmp_path, trial_copy) -> None:
    tensegraph.save(tensegraph.reconstruct(trial_copy(rows=40), "frame"), tmp_path / "out", figures=None)
    assert not list((tmp_path / "out").glob("*.png"))
    assert (tmp_path / "out" / "shape.csv").is_file()


class AtRest:
    """An estimator of a user's own: the rest shape, whatever is measured."""

    def __init__(self, structure, rest, settings) -> None:
        self._rest = rest

    def estimate(self, frames):
        for frame in frames:
            yield Shape(frame.t_s, self._rest.node_position_m, self._rest.covariance_m2, Status.OK, frame)


def test_an_estimator_of_one_s_own(monkeypatch, trial_copy) -> None:
    """Once it has a name, it is a method like the others, in Python and in the comparison."""
    monkeypatch.setitem(tensegraph.pipeline.ESTIMATORS, "mine", AtRest)
    trial = trial_copy(rows=40)
    shapes = tensegraph.reconstruct(trial, "mine")
    np.testing.assert_array_equal(shapes.node_position_m[0], shapes.node_position_m[-1])
    measured = list(measure(open_trial(trial), tensegraph.Settings(), read_sensor_model(), Terminal(quiet=True)))
    assert (measured[0].method, measured[-1].method) == ("rest shape held", "mine")
    np.testing.assert_array_equal(measured[0].errors.node_error_m, measured[-1].errors.node_error_m)


def test_an_unknown_method_is_named(trial_copy) -> None:
    with pytest.raises(tensegraph.InputError, match="method 'mine': expected one of batch, live, frame"):
        tensegraph.reconstruct(trial_copy(rows=40), "mine")


def test_the_wheel_s_list_is_the_tree() -> None:
    import tomllib

    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    rooms = ("commands", "estimator", "factors", "io", "live", "models", "scoring")
    folders = {p.parent for room in rooms for p in (ROOT / room).rglob("*.py")}
    found = {".".join(["tensegraph", *folder.relative_to(ROOT).parts]) for folder in folders}
    assert listed == {"tensegraph"} | found


def test_the_model_is_in_the_package() -> None:
    from importlib.resources import files

    assert files("tensegraph.models.data").joinpath("stretching.safetensors").is_file()
    assert not zipfile.is_zipfile(ROOT / "models" / "data" / "stretching.safetensors")
