"""The numbered examples run as they stand, from any directory, and print what they are there to show."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest

from tensegraph.pipeline import ESTIMATORS

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))
SHOWN = {
    "01_reconstruct": r"(?s)6 rods, 24 tendons.*\nthe largest load is \d\.\d\d N, at node \d+, .*written to",
    "02_live": r"(?s)\n 2\.00 s: OK, .*\n 2\.\d\d s: node 8 is pressed",
    "03_own_structure": r"300 shapes of 6 nodes; nodes 3 to 5 sink by .*\npressed across the struts with \[1\.91",
    "04_calibrate": r"(?s)\nLSTM +0\.0\d+ +\d+%.*\nstatic curve .*\n201 shapes with the model",
    "05_own_estimator": r"(?s)batch +400 shapes.*\nextended-kalman +400 shapes.*mm apart in the median",
    "06_own_factor": r"(?s)lengths alone .*\nwith the height of node 8 ",
}


@pytest.fixture
def short_inputs(trial_copy, tmp_path: Path) -> dict[str, Path]:
    """What two examples read, which take whole files: two and a half seconds of the trial, 32 s of each strip."""
    strips = tmp_path / "strips"
    strips.mkdir()
    for source in (EXAMPLES[0].parent / "calibration").glob("random_small_*.csv"):
        (strips / source.name).write_text("".join(source.read_text().splitlines(keepends=True)[:642]))
    return {"01_reconstruct": trial_copy(rows=125), "04_calibrate": strips}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path, short_inputs, monkeypatch, capsys, undrawn) -> None:
    """In this process, which has imported everything already; what it registers is forgotten."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(map(str, [example, *filter(None, [short_inputs.get(example.stem)])])))
    with mock.patch.dict(ESTIMATORS):
        runpy.run_path(str(example), run_name="__main__")
    out, error = capsys.readouterr()
    assert error == ""
    assert re.search(SHOWN.get(example.stem, "."), out), out


def test_an_example_runs_in_a_process_of_its_own(tmp_path: Path) -> None:
    """The last, as a user types it."""
    environment = os.environ | {"PYTHONWARNINGS": "error::DeprecationWarning:__main__"}
    command = [sys.executable, EXAMPLES[-1]]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=240, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(SHOWN[EXAMPLES[-1].stem], done.stdout), done.stdout


def test_examples_are_read_top_to_bottom() -> None:
    """Numbered without a gap, each short, without the parsing of a command line."""
    assert [int(path.name[:2]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
    assert {path.stem for path in EXAMPLES} >= SHOWN.keys()
    for path in EXAMPLES:
        text = path.read_text()
        assert 25 <= text.count("\n") <= 75, path
        assert "argparse" not in text, path
        assert "typer" not in text, path
