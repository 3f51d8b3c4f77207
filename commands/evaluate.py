"""`evaluate`: compares results with the truth, in tables, figures and JSON."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w
from rich.console import Group

from ..io.figures.evaluation_figures import write_errors_figure, write_heights_figure, write_loads_figure
from ..io.figures.track_figure import write_followed_figure
from ..io.input_files import check_regular
from ..io.provenance import FINGERPRINT, file_hashes, fingerprint, is_up_to_date, sha256_of, versions
from ..io.reports.evaluation_tables import ScoredResult, as_text
from ..io.reports.terminal import Terminal
from ..io.result import RUN_FILE, result_directory
from ..io.stored_result import load, read_run, settings_of
from ..io.trial_directory import Trial, open_trial
from ..models.values.errors import InputError
from ..models.values.units import LARGEST, beyond
from ..scoring.run_score import evaluation_of
from .many import Many, Workers
from .paths import result_paths

EVALUATION_FILE = "evaluation.json"


@dataclass(frozen=True, slots=True)
class EvaluationJob:
    """One result to be evaluated; see `score_result`."""

    result: Path
    name: str
    """The path of the result as it was typed."""
    out: Path
    """Evaluation directory."""
    truth: Path | None
    trial: Path | None
    align: bool
    offset_s: float | None

    def fingerprint(self, trial: Trial) -> str:
        """Return the hash of all that the evaluation is made from."""
        return fingerprint(
            {
                "result": {"name": self.name} | file_hashes(self.result),
                "trial": trial.hashes() | trial.truth_hashes(),
                "truth": sha256_of(self.truth) if self.truth else None,
                "align": self.align,
                "offset_s": self.offset_s,
            }
        )


def evaluate_results(
    results: Sequence[Path],
    *,
    truth: Path | None,
    trial: Path | None,
    align: bool,
    offset_s: float | None,
    json_only: bool,
    out: Path | None,
    workers: Workers,
    terminal: Terminal,
) -> None:
    """Evaluate result directories, write an evaluation of each, and print them as tables or JSON.

    Args:
        results: result directories.
        truth: see `score_result`.
        trial: trial directory; see `trial_of`.
        align: see `score_result`.
        offset_s: see `score_result`.
        json_only: whether to print JSON instead of tables.
        out: see `result_paths`.
        workers: the processes that do the work.
        terminal: for the tables.

    Raises:
        TensegraphError: when an evaluation cannot be written; for a single result, when it cannot be evaluated.
        SystemExit: with 1 when some of several results failed.
    """
    if offset_s is not None and not abs(offset_s) <= LARGEST["s"]:
        raise InputError(f"--offset: {beyond(offset_s, LARGEST['s'])}")
    written = result_paths(results, out, Path("results/evaluation"), (EVALUATION_FILE,))
    if truth is not None:
        check_regular(truth)
    truth, trial = (workers.place(path) if path else None for path in (truth, trial))
    jobs = {
        str(result): EvaluationJob(
            workers.place(result), str(result), workers.place(path), truth, trial, align=align, offset_s=offset_s
        )
        for result, path in zip(results, written, strict=True)
    }
    places = dict(zip(jobs, written, strict=True))
    many = Many(workers, terminal)
    done = set()
    for name, tables in many.each(evaluate_result, jobs, "results"):
        done.add(name)
        if json_only:
            continue
        if tables is not None:
            terminal.news.print(tables)
        terminal.written(f"{'up to date:' if tables is None else 'written to'} {places[name]}")
    if json_only:
        numbers = [
            json.loads((places[name] / EVALUATION_FILE).read_text(encoding="utf-8")) for name in jobs if name in done
        ]
        print(as_text(numbers), end="")
    many.end()


def evaluate_result(job: EvaluationJob, terminal: Terminal) -> Group | None:
    """Evaluate a result, write the evaluation and return its tables; None where the same stands already.

    Raises:
        TensegraphError: when the result cannot be evaluated, or the evaluation cannot be written.
    """
    with terminal.stages(job.name, {"errors": 0.5, "figures": 0.5}) as bar:
        run = read_run(job.result)
        trial = trial_of(run, job.result, job.trial)
        made_from = job.fingerprint(trial)
        if is_up_to_date(job.out / RUN_FILE, made_from):
            return None
        with terminal.stage(f"evaluation of {job.name}"):
            score = score_result(job.result, run, trial, job.truth, align=job.align, offset_s=job.offset_s)
        bar.reached("errors", 1.0)
        with terminal.stage(f"files of {job.out}"):
            write_score(replace(score, result=Path(job.name)), job.out, made_from)
    return score.as_table()


def write_score(score: ScoredResult, path: Path, made_from: str) -> None:
    """Write an evaluation directory, its numbers and figures, completely or not at all."""
    with result_directory(path, (EVALUATION_FILE,)) as directory:
        run = {"result": str(score.result), FINGERPRINT: made_from, "versions": versions()}
        (directory / RUN_FILE).write_text(tomli_w.dumps(run), encoding="utf-8")
        (directory / EVALUATION_FILE).write_text(as_text(score.as_json()), encoding="utf-8")
        write_heights_figure(score.evaluation, score.title(), directory / "heights.png")
        write_errors_figure(score.evaluation, score.title(), directory / "errors.png")
        frames = score.evaluation.compared
        if score.evaluation.pose and not score.evaluation.in_body:
            write_followed_figure(
                frames.t_s, frames.estimated_m, frames.true_m, frames.contacts, score.title(), directory / "track.png"
            )
        if score.evaluation.loads:
            write_loads_figure(score.evaluation, score.title(), directory / "loads.png")


def score_result(
    path: Path, run: dict[str, Any], trial: Trial, truth: Path | None, *, align: bool, offset_s: float | None
) -> ScoredResult:
    """Evaluate a result directory.

    Args:
        path: result directory.
        run: its run.toml.
        trial: see `trial_of`.
        truth: a file of stamped node positions or of motion capture; that of the trial if None.
        align: see `evaluate`.
        offset_s: host time minus the time of the truth; if None, 0, or for motion capture what its motion tells.

    Raises:
        InputError: when the result or the truth cannot be read, or do not match the trial.
    """
    settings = settings_of(run, path)
    result = load(path)
    try:
        evaluation = evaluation_of(trial, result, settings, truth, align=align, offset_s=offset_s)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    skipped = run.get("skipped_frames", 0)
    if type(skipped) is not int or skipped < 0:
        raise InputError(f"{path / RUN_FILE}: skipped_frames: expected a number of frames, got {skipped!r:.60}")
    return ScoredResult(path, trial.name, str(run.get("method", "method not stated")), evaluation, skipped)


def trial_of(run: dict[str, Any], path: Path, trial: Path | None) -> Trial:
    """Return the trial of a result, the one named in run.toml if None is given.

    Raises:
        InputError: when there is none, or it is not the one that the result was made from.
    """
    if trial is None and not isinstance(run.get("trial_path"), str):
        raise InputError(f"{path / RUN_FILE}: trial_path: is missing: expected --trial DIRECTORY instead")
    opened = open_trial(trial or path / run["trial_path"])
    for name, digest in opened.hashes().items():
        if run.get("inputs", {}).get(name, digest) != digest:
            expected = "expected --trial DIRECTORY, of the trial that it was made from"
            raise InputError(f"{opened.path / name}: is not what {path} was made from: {expected}")
    return opened
