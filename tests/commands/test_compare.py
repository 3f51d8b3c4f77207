"""`tensegraph compare`: every method on the same lengths."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from command_line import printed_by, refusal_of, run
from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from roll import roll
from tensegraph.io.reports.comparison_tables import as_markdown, write_comparison_csv
from tensegraph.models.evaluation.comparison import FrameErrors, Measured
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.scoring.method_scores import by_method, comparison_rows

pytestmark = pytest.mark.usefixtures("undrawn")


def _without_truth(text: str) -> str:
    return text[: text.index("[truth]")]


def _an_hour_later(text: str) -> str:
    head, *rows = text.splitlines()
    later = (f"{float(t_s) + 3600},{rest}" for t_s, _, rest in (row.partition(",") for row in rows))
    return "\n".join([head, *later]) + "\n"


def test_compare_runs_every_method(trial_copy) -> None:
    """A trial without truth fails, the other is compared; what is said of the UKF is what evaluate says."""
    seen = trial_copy(rows=30, name="seen")
    blind = trial_copy(rows=30, name="blind", trial=_without_truth)
    result = run("compare", seen, blind, cwd=seen.parent)
    assert result.returncode == 1
    assert f"blind: {blind}: has no truth to compare with" in result.stderr
    for words in ("seen, rest shape held: node RMSE", "seen, UKF: node RMSE"):
        assert words in result.stdout
    folder = seen.parent / "results/comparison"
    assert sorted(p.name for p in folder.iterdir()) == ["comparison.csv", "comparison.md", "comparison.png", "trials"]
    with (folder / "comparison.csv").open() as file:
        rows = {(row["trial"], row["method"]): row for row in csv.DictReader(file)}
    assert len(rows) == 3 + 2 * 7
    assert float(rows["seen", "UKF"]["ms_per_frame"]) > 0
    assert "(ukf)" in run("reconstruct", seen, "--method", "ukf", "--figures", "none", cwd=seen.parent).stdout
    (alone,) = json.loads(run("evaluate", "results/seen_ukf", "--json", cwd=seen.parent).stdout)
    assert float(rows["seen", "UKF"]["nodes_rmse_m"]) == pytest.approx(alone["absolute"]["nodes"]["rmse_m"], rel=1e-3)
    assert float(rows["seen", "UKF"]["coverage_95"]) == pytest.approx(alone["consistency"]["coverage_95"], abs=0.02)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trial": _without_truth}, "has no truth to compare with: expected [truth] in trial.toml"),
        ({"truth": lambda text: text.replace("t_s", "t", 1)}, "truth.csv: "),
        ({"truth": _an_hour_later}, "trial: truth from 3600.000 to "),
    ],
    ids=["none", "unreadable", "of another time"],
)
def test_a_trial_without_its_truth_is_refused_and_nothing_is_written(trial_copy, changes, words) -> None:
    trial = trial_copy(rows=20, **changes)
    assert words in refusal_of("compare", trial, "--method", "frame", "--out", "out", cwd=trial.parent)
    assert not (trial.parent / "out").exists()


@pytest.mark.parametrize("mine", ["trials/a/notes.txt", "comparison.csv"])
def test_a_folder_of_the_user_is_no_comparison(trial_copy, mine) -> None:
    trial = trial_copy(rows=20)
    file = trial.parent / mine
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("mine")
    refused = refusal_of("compare", trial, "--method", "frame", "--out", ".", cwd=trial.parent)
    assert refused == "tensegraph: .: exists and is no earlier comparison: expected a new name\n"
    assert file.read_text() == "mine"
    assert {path.name for path in trial.parent.iterdir()} == {"trial", Path(mine).parts[0]}


@pytest.mark.parametrize("changed", ["board0.csv", "truth.csv"])
def test_a_file_in_a_folder_of_the_trial_that_has_changed_is_compared_anew(trial_copy, changed) -> None:
    trial = trial_copy(rows=40, trial=lambda text: text.replace('file = "', 'file = "raw/'))
    (trial / "raw").mkdir()
    for file in trial.glob("*.csv"):
        file.rename(trial / "raw" / file.name)
    measured = trial.parent / "results" / "comparison" / "trials" / "trial.npz"

    def written_ns() -> int:
        assert run("compare", trial, "--method", "frame", cwd=trial.parent).returncode == 0
        return measured.stat().st_mtime_ns

    first_ns = written_ns()
    assert written_ns() == first_ns
    file = trial / "raw" / changed
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:31]))
    assert written_ns() > first_ns


def test_a_method_that_is_for_no_trial_leaves_a_table_of_the_rest_shape(tmp_path) -> None:
    result = printed_by("compare", roll(tmp_path / "roll", 1.0), "--method", "ukf", cwd=tmp_path)
    assert "roll, UKF: not run: method 'ukf': expected one of batch, live" in result


class TestComparison:
    def measured(self) -> list[Measured]:
        structure = four_nodes()
        made = []
        for trial, errors, seconds in (("one", [[3, 0, 0]] * 2, 0.2), ("two", [[0, 0, 6]] * 6, 0.6)):
            estimate = estimate_of(structure, moved(errors))
            evaluation = evaluate(TRUE_M, estimate, truth_of(len(errors)))
            made.append(Measured(trial, "any", len(errors), seconds, FrameErrors.of(evaluation), ""))
        return [*made, Measured("three", "any", 4, np.nan, None, "gave up")]

    def test_all_frames_of_all_trials_count_alike(self) -> None:
        """Two frames of 3 mm and six of 6 mm: (2 * 9 + 6 * 36) / 8; 2 and 6 frames in 0.2 and 0.6 s."""
        rows = comparison_rows(by_method(self.measured()[:2]))
        together = rows[0]
        assert (together.trial, together.trials, together.frames) == ("all", 2, 8)
        assert together.errors.nodes.rmse_m == pytest.approx(np.sqrt(234 / 8) / 1e3)
        assert together.ms_per_frame == pytest.approx(100)
        assert together.coverage_95 == pytest.approx(0)  # NEES 9 and 36 / 4 against 7.81
        assert chi2.ppf(0.95, 3) == pytest.approx(7.81, abs=0.01)
        assert [row.trial for row in rows[1:]] == ["one", "two"]

    def test_a_method_that_gave_up_shows(self, tmp_path) -> None:
        rows = comparison_rows(by_method(self.measured()))
        assert (rows[0].trials, rows[0].frames) == (2, 8)
        text = as_markdown(rows, "tensegraph compare one two three")
        assert "| three | - |" in text
        assert "| any (2 of 3 trials) | 5.4 |" in text
        assert "| *Mao et al.* | 21.2 | 35.8 | 39.4 |" in text
        write_comparison_csv(rows, tmp_path / "c.csv")
        lines = (tmp_path / "c.csv").read_text().splitlines()
        assert len({line.count(",") for line in lines}) == 1
        assert lines[1].startswith("published,,Caluwaerts et al.,,,0.0456,")
        assert lines[-1].startswith("measured,three,any,0,0,,")
