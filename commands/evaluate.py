"""`evaluate`: compares results with the truth, in tables, figures and JSON."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..estimator.rest_step import rest_step
from ..io.figures.evaluation_figures import write_errors_figure, write_heights_figure, write_loads_figure
from ..io.figures.track_figure import write_followed_figure
from ..io.mocap.truth_file import read_truth
from ..io.reports.evaluation_tables import ScoredResult, as_text
from ..io.reports.terminal import Terminal
from ..io.result import RUN_FILE, read_estimate, read_run, result_directory
from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.estimate import Estimate
from ..models.evaluation.metrics import evaluate
from ..models.evaluation.motion_capture import lay_onto
from ..models.evaluation.truth import Truth
from ..models.settings import Settings
from ..models.values.errors import InputError
from ..models.values.marker_tracks import MarkerTracks
from ..models.values.stamped_positions import StampedPositions
from ..models.values.tables import parse_table
from .paths import result_paths

EVALUATION_FILE = "evaluation.json"


def evaluate_results(
    results: Sequence[Path],
    *,
    truth: Path | None,
    trial: Path | None,
    align: bool,
    offset_s: float | None,
    json_only: bool,
    out: Path | None,
    terminal: Terminal,
) -> None:
    """Evaluate result directories, write an evaluation of each, and print them as tables or JSON.

    Args:
        results: result directories.
        truth: see `score_result`.
        trial: see `score_result`.
        align: see `score_result`.
        offset_s: see `score_result`.
        json_only: whether to print JSON instead of tables.
        out: see `result_paths`.
        terminal: for the tables.

    Raises:
        TensegraphError: when a result cannot be evaluated, or an evaluation cannot be written.
    """
    written = result_paths(results, out, Path("results/evaluation"), EVALUATION_FILE)
    scores = []
    for path in results:
        with terminal.stage(f"evaluation of {path}"):
            scores.append(score_result(path, truth, trial, align=align, offset_s=offset_s))
    for score, path in zip(scores, written, strict=True):
        with terminal.stage(f"files of {path}"):
            write_score(score, path)
        if not json_only:
            terminal.news.print(score.as_table())
            terminal.written(f"written to {path}")
    if json_only:
        print(as_text([score.as_json() for score in scores]), end="")


def write_score(score: ScoredResult, path: Path) -> None:
    """Write an evaluation directory, its numbers and figures, completely or not at all."""
    with result_directory(path, EVALUATION_FILE) as directory:
        (directory / EVALUATION_FILE).write_text(as_text(score.as_json()), encoding="utf-8")
        write_heights_figure(score.evaluation, score.title(), directory / "heights.png")
        write_errors_figure(score.evaluation, score.title(), directory / "errors.png")
        frames = score.evaluation.compared
        if score.evaluation.pose:
            write_followed_figure(
                frames.t_s, frames.estimated_m, frames.true_m, frames.contacts, score.title(), directory / "track.png"
            )
        if score.evaluation.loads:
            write_loads_figure(score.evaluation, score.title(), directory / "loads.png")


def score_result(
    path: Path, truth: Path | None, trial: Path | None, *, align: bool, offset_s: float | None = None
) -> ScoredResult:
    """Evaluate a result directory.

    Args:
        path: result directory.
        truth: a file of stamped node positions or of motion capture; that of the trial if None.
        trial: trial directory; the one named in run.toml if None.
        align: see `evaluate`.
        offset_s: host time minus the time of the truth; if None, 0, or for motion capture what its motion tells.

    Raises:
        InputError: when the result, its trial or the truth cannot be read, or do not match.
    """
    run = read_run(path)
    opened = trial_of(run, path, trial)
    settings = parse_table(Settings, run.get("settings", {}), str(path / RUN_FILE))
    d = opened.description
    rest_m = rest_step(d.structure, d.mechanics, d.rest_position_m, d.geometry, settings.rest, d.floor).node_position_m
    estimate = read_estimate(path, d.structure)
    threshold_n = settings.load_threshold_n
    try:
        known = truth_of_trial(opened, truth, estimate, offset_s)
        evaluation = evaluate(d.structure, rest_m, estimate, known, align=align, load_threshold_n=threshold_n)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return ScoredResult(path, opened.name, str(run.get("method", "method not stated")), evaluation)


def truth_of_trial(trial: Trial, path: Path | None, estimate: Estimate, offset_s: float | None) -> Truth:
    """Return the truth of a trial, with positions from another file if one is given, on the host's clock.

    Raises:
        InputError: when there is none, or it cannot be read, or laid onto the estimate.
    """
    structure = trial.description.structure
    recorded = trial.recorded_truth() if path is None else read_truth(path, structure.node_count)
    if recorded is None:
        raise InputError(f"{trial.path}: has no truth: expected [truth] in trial.toml, or --truth FILE")
    if isinstance(recorded, MarkerTracks):
        positions, capture = lay_onto(
            recorded,
            estimate,
            structure,
            marked=trial.marked_nodes(),
            offset_s=offset_s,
            rest_seconds=trial.description.rest_seconds,
        )
        return replace(trial.truth_of(positions, trial.true_loads()), capture=capture)
    positions = StampedPositions(recorded.t_s + (offset_s or 0.0), recorded.node_position_m)
    return trial.truth_of(positions, trial.true_loads())


def trial_of(run: dict[str, Any], path: Path, trial: Path | None) -> Trial:
    """Return the trial of a result, the one named in run.toml if None is given.

    Raises:
        InputError: when there is none, or it is not the one that the result was made from.
    """
    if trial is None and not isinstance(run.get("trial_path"), str):
        raise InputError(f"{path / RUN_FILE}: trial_path: is missing: expected --trial DIRECTORY instead")
    opened = open_trial(trial or path / run["trial_path"])
    for name, digest in opened.hashes().items():
        if "inputs" in run and run["inputs"].get(name) != digest:
            raise InputError(f"{opened.path / name}: is not what {path} was made from: expected --trial DIRECTORY")
    return opened
