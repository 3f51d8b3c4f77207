"""The benchmark of robustness, on the first seconds of the example."""

import itertools
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from plan_edits import replaced
from tensegraph import open_trial, stream

ROBUSTNESS = Path(__file__).parents[2] / "benchmarks" / "robustness.py"


def test_the_example_of_robustness(trial_copy, monkeypatch, capsys) -> None:
    """On 0.4 s of the example, of which 0.3 s are told as rest: a figure, and a table in which no mass is worse.

    In this process, which has imported everything already.
    """
    path = trial_copy(rows=20, trial=lambda text: replaced(text, ("seconds = 2.0", "seconds = 0.3")))
    words = [ROBUSTNESS, path, "--draws", "1", "--figure", path.parent / "dead.png"]
    monkeypatch.setattr(sys, "argv", list(map(str, words)))
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROBUSTNESS), run_name="__main__")
    out, error = capsys.readouterr()
    assert (ended.value.code, error) == (0, "")
    assert (path.parent / "dead.png").read_bytes().startswith(b"\x89PNG")
    first, header, _, *rows = out.splitlines()
    assert first.startswith("press_01, RMSE / sigma [mm] with 0, 1, 2 ... dead: ")
    assert first.count(" / ") == 1 + 7
    assert header == "| mechanics given to the estimator | press_01, live |"
    error_mm = {name.strip(): float(value) for _, name, value, _ in (row.split("|") for row in rows)}
    assert len(error_mm) == 9
    assert error_mm["as in trial.toml"] < min(error_mm["rods without mass"], error_mm["no mechanics at all"])


def test_a_dead_sensor_is_left_out_once_the_rest_is_over(example) -> None:
    """Its wire breaks at 2 s: from then on the ADC reads full scale, its length is missing, all others are there."""
    robustness = runpy.run_path(str(ROBUSTNESS))
    trial = open_trial(example)
    rows = itertools.takewhile(lambda row: row.host_s < 3, robustness["open_circuit"](trial, [7]))
    shapes = list(stream(rows, trial.description))
    missing = np.array([~shape.lengths.usable for shape in shapes])
    t_s = np.array([shape.t_s for shape in shapes])
    assert not missing[t_s < 1.9].any()
    assert missing[t_s > 2.2, 7].all()
    assert not np.delete(missing, 7, axis=1).any()
