"""All methods over all trials, on the very same lengths and sigmas: the paper's Table I, measured here."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..io.comparison_tables import as_markdown, write_comparison_csv
from ..io.figures.evaluation_figures import write_comparison_figure
from ..io.result import result_directory
from ..io.trial_directory import Trial
from ..models.evaluation.comparison import ALL, PUBLISHED, ComparisonRow
from ..models.evaluation.consistency import coverage
from ..models.evaluation.estimate import Estimate
from ..models.evaluation.evaluation import Evaluation
from ..models.evaluation.metrics import evaluate, shape_errors
from ..models.evaluation.truth import Truth
from ..models.sensor.sensor_model import SensorModel
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.values.errors import IndeterminateError, InputError
from ..models.values.readings import TendonLengths
from ..pipeline import ESTIMATORS, Pipeline

COMPARISON_FILE = "comparison.csv"
HELD = "rest shape held"
METHODS = {
    "least-squares": "least squares",
    "ukf": "UKF",
    "frame": "graph, frame by frame",
    "live": "graph, live",
    "batch": "graph, batch",
}
"""Names for the table, in its order; a method without one goes last, by the name it has."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """One method, run on one trial."""

    trial: str
    method: str
    frames: int
    seconds: float
    """nan when nothing was run."""
    evaluation: Evaluation | None
    """None when the trial has no truth, or the method gave up."""
    note: str
    """Why there is no evaluation."""

    def line(self) -> str:
        """Return what to say when it is done."""
        said = [f"{self.trial}, {self.method}:"]
        if self.evaluation:
            said.append(f"node RMSE {1e3 * self.evaluation.absolute.nodes.rmse_m:.2f} mm")
        if np.isfinite(self.seconds):
            said.append(f"{1e3 * self.seconds / self.frames:.2f} ms per frame")
        return " ".join([*said, self.note]).rstrip()


Track = Callable[[Iterable[TendonLengths], int, str], Iterable[TendonLengths]]
"""Passes frames on while it shows how many of them have gone by, and whose."""


def measure(trial: Trial, settings: Settings, model: SensorModel, track: Track) -> Iterator[Measured]:
    """Run every method on a trial's lengths, which are made once, and yield each when it is done."""
    name, structure = trial.path.resolve().name, trial.description.structure
    pipeline = Pipeline(trial.description, settings, model)
    frames = list(pipeline.lengths(trial.readings()))
    try:
        positions, note = trial.truth(), "(no truth)"
        truth = Truth(*positions, trial.description.rest_seconds, trial.faults()) if positions else None
    except InputError as error:
        truth, note = None, f"(truth not used: {error})"

    def judged(method: str, seconds: float, estimate: Estimate) -> Measured:
        if truth is None:
            return Measured(name, method, len(frames), seconds, None, note)
        try:
            evaluation = evaluate(structure, pipeline.rest.node_position_m, estimate, truth)
        except InputError as error:
            return Measured(name, method, len(frames), seconds, None, f"(not evaluated: {error})")
        return Measured(name, method, len(frames), seconds, evaluation, "")

    yield judged(HELD, np.nan, held(pipeline, frames))
    for method in sorted(ESTIMATORS, key=lambda m: list(METHODS).index(m) if m in METHODS else len(METHODS)):
        label = METHODS.get(method, method)
        estimator = ESTIMATORS[method](structure, pipeline.rest, settings)
        start = time.perf_counter()
        try:
            shapes = list(estimator.estimate(track(frames, len(frames), f"{name}, {label}")))
        except IndeterminateError as error:
            yield Measured(name, label, len(frames), np.nan, None, f"gave up at {error}")
            continue
        yield judged(label, time.perf_counter() - start, Estimate.of(Reconstruction.of(structure, shapes)))


def held(pipeline: Pipeline, frames: Sequence[TendonLengths]) -> Estimate:
    """Return what to say of a trial without estimating anything: the rest shape, without a covariance."""
    count, rest_m = len(frames), pipeline.rest.node_position_m
    sigma_m = np.array([frame.sigma_m for frame in frames])
    return Estimate(
        t_s=np.array([frame.t_s for frame in frames]),
        node_position_m=np.repeat(rest_m[None], count, axis=0),
        node_covariance_m2=np.full((count, len(rest_m), 3, 3), np.nan),
        length_m=np.array([frame.length_m for frame in frames]),
        sigma_m=sigma_m,
        mode=np.array([frame.mode for frame in frames]),
        flags=np.array([frame.flags for frame in frames]),
        innovation_sigma_m=np.full(sigma_m.shape, np.nan),
    )


def comparison_rows(measured: Sequence[Measured]) -> list[ComparisonRow]:
    """Return a row for each method on all trials, then one for each trial and method."""
    methods = dict.fromkeys(m.method for m in measured)
    together = [_row(ALL, method, [m for m in measured if m.method == method]) for method in methods]
    return together + [_row(m.trial, m.method, [m]) for m in measured]


def _row(trial: str, method: str, measured: Sequence[Measured]) -> ComparisonRow:
    """Return a method's row: errors and ellipsoids of all its frames and nodes count alike."""
    evaluations = [m.evaluation for m in measured if m.evaluation]
    compared = [e.compared for e in evaluations]
    none = np.empty((0, 3))
    sigma_m = np.concatenate([none.ravel(), *(c.node_sigma_m[~np.isnan(c.nees)] for c in compared)])
    branches = [c.wrong_branch for e, c in zip(evaluations, compared, strict=True) if e.wrong_branch_frames is not None]
    timed = [m for m in measured if np.isfinite(m.seconds)]
    seconds, timed_frames = sum(m.seconds for m in timed), sum(m.frames for m in timed)
    return ComparisonRow(
        trial,
        method,
        len(evaluations),
        sum(m.frames for m in measured),
        shape_errors(
            np.concatenate([none, *(c.node_error_m.reshape(-1, 3) for c in compared)]),
            np.concatenate([none, *(c.face_error_m.reshape(-1, 3) for c in compared)]),
        ),
        coverage(np.concatenate([none.ravel(), *(c.nees.ravel() for c in compared)]), 0.95),
        float(np.median(sigma_m)) if len(sigma_m) else np.nan,
        float(np.mean(np.concatenate(branches))) if branches else np.nan,
        1e3 * seconds / timed_frames if timed else np.nan,
    )


def write_comparison(rows: Sequence[ComparisonRow], command: str, path: Path) -> None:
    """Write comparison.csv, comparison.md and comparison.png, all or none."""
    with result_directory(path, COMPARISON_FILE) as directory:
        write_comparison_csv(rows, directory / COMPARISON_FILE)
        (directory / "comparison.md").write_text(as_markdown(rows, command), encoding="utf-8")
        published = {p.source: p.node_mm for p in PUBLISHED}
        write_comparison_figure(rows, published, directory / "comparison.png")
