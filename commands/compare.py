"""`compare`: runs all methods on the same lengths and sigmas of all trials, in the form of the paper's Table I."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.markdown import Markdown
from rich.progress import Progress

from ..io.figures.comparison_figure import write_comparison_figure
from ..io.model_file import read_sensor_model
from ..io.reports.comparison_tables import as_markdown, write_comparison_csv
from ..io.reports.terminal import Terminal
from ..io.result import result_directory
from ..io.toml import read_settings
from ..io.trial_directory import Trial, open_trial
from ..io.whole import check_replaceable
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
from .paths import distinct_names

COMPARISON_FILE = "comparison.csv"
NO_METHOD = "rest shape held"
"""Name in the table for the rest shape, which needs no measurement."""
METHODS = {
    "least-squares": "least squares",
    "ukf": "UKF",
    "network": "network alone",
    "frame": "graph, frame by frame",
    "live": "graph, live",
    "batch": "graph, batch",
}
"""Names of the methods in the table, in its order; other methods follow under their own names."""


def compare_trials(
    trials: Sequence[Path], *, out: Path, config: Path | None, model: Path | None, terminal: Terminal
) -> None:
    """Run every method in `ESTIMATORS` on trials, write table and figure, and print the table.

    Args:
        trials: their directories.
        out: directory of the comparison.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        terminal: for progress and the table.

    Raises:
        TensegraphError: when a trial cannot be read, or the comparison cannot be written.
    """
    distinct_names(trials)
    check_replaceable(out, COMPARISON_FILE)
    settings = read_settings(config)
    sensor_model = read_sensor_model(model)
    opened = [open_trial(path) for path in trials]
    measured = []
    with terminal.progress() as progress:
        for trial in opened:
            with terminal.stage(f"all methods on {trial.name}"):
                for one in measure(trial, settings, sensor_model, lambda *frames: _tracked(progress, *frames)):
                    measured.append(one)
                    progress.console.print(one.line(), highlight=False)
    rows = comparison_rows(measured)
    command = "tensegraph compare " + " ".join(trial.path.as_posix() for trial in opened)
    with terminal.stage("table and figure"):
        write_comparison(rows, command, out)
    terminal.news.print(Markdown(as_markdown(rows, command)))
    terminal.written(f"written to {out}")


Track = Callable[[Iterable[TendonLengths], int, str], Iterable[TendonLengths]]
"""Function that passes frames on and shows their progress; its arguments are the frames, their number and a title."""


def _tracked(progress: Progress, frames: Iterable[TendonLengths], total: int, name: str) -> Iterator[TendonLengths]:
    task = progress.add_task(name, total=total)
    for frame in frames:
        yield frame
        progress.advance(task)
    progress.remove_task(task)  # it is replaced by the line with the result


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The result of one method on one trial."""

    trial: str
    method: str
    frames: int
    seconds: float
    """Computing time; nan when nothing was run."""
    evaluation: Evaluation | None
    """Evaluation; None when the trial has no truth, or the method failed."""
    note: str = ""
    """Reason why there is no evaluation."""

    def line(self) -> str:
        """Return a summary in one line."""
        parts = [f"{self.trial}, {self.method}:"]
        if self.evaluation:
            parts.append(f"node RMSE {1e3 * self.evaluation.absolute.nodes.rmse_m:.2f} mm")
        if np.isfinite(self.seconds):
            parts.append(f"{1e3 * self.seconds / self.frames:.2f} ms per frame")
        return " ".join([*parts, self.note]).rstrip()


def measure(trial: Trial, settings: Settings, model: SensorModel, track: Track) -> Iterator[Measured]:
    """Run every method on the same lengths of a trial, and yield each result."""
    comparison = TrialComparison(trial, settings, model)
    yield comparison.without_method()
    for method in sorted(ESTIMATORS, key=lambda m: list(METHODS).index(m) if m in METHODS else len(METHODS)):
        yield comparison.with_method(method, track)


class TrialComparison:
    """The lengths of a trial, and its truth."""

    def __init__(self, trial: Trial, settings: Settings, model: SensorModel) -> None:
        self._settings = settings
        self._name = trial.path.resolve().name
        self._structure = trial.description.structure
        self._pipeline = Pipeline(trial.description, settings, model)
        self._frames = list(self._pipeline.lengths(trial.readings()))
        self._truth: Truth | None = None
        self._note = "(no truth)"
        try:
            positions = trial.truth()
            if positions is not None:
                self._truth = trial.truth_of(positions)
        except InputError as error:
            self._note = f"(truth not used: {error})"

    def without_method(self) -> Measured:
        """Return the result of the rest shape alone."""
        return self._measured(NO_METHOD, np.nan, rest_shape_estimate(self._pipeline, self._frames))

    def with_method(self, method: str, track: Track) -> Measured:
        """Run a method over all frames, and return its result."""
        label = METHODS.get(method, method)
        estimator = ESTIMATORS[method](self._pipeline.rest.structure, self._pipeline.rest, self._settings)
        frames = track(self._frames, len(self._frames), f"{self._name}, {label}")
        start_s = time.perf_counter()
        try:
            shapes = list(estimator.estimate(frames))
        except IndeterminateError as error:
            return Measured(
                trial=self._name,
                method=label,
                frames=len(self._frames),
                seconds=np.nan,
                evaluation=None,
                note=f"gave up at {error}",
            )
        seconds = time.perf_counter() - start_s
        return self._measured(label, seconds, Estimate.of(Reconstruction.of(self._structure, shapes)))

    def _measured(self, method: str, seconds: float, estimate: Estimate) -> Measured:
        evaluation = None
        note = self._note
        if self._truth is not None:
            try:
                evaluation = evaluate(self._structure, self._pipeline.rest.node_position_m, estimate, self._truth)
                note = ""
            except InputError as error:
                note = f"(not evaluated: {error})"
        return Measured(
            trial=self._name,
            method=method,
            frames=len(self._frames),
            seconds=seconds,
            evaluation=evaluation,
            note=note,
        )


def rest_shape_estimate(pipeline: Pipeline, frames: Sequence[TendonLengths]) -> Estimate:
    """Return the rest shape in every frame, without a covariance, as an estimate."""
    count = len(frames)
    rest_m = pipeline.rest.node_position_m
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
    """Return one row for each method on all trials, then one row for each trial and method."""
    methods = dict.fromkeys(m.method for m in measured)
    together = [_row(ALL, method, [m for m in measured if m.method == method]) for method in methods]
    return together + [_row(m.trial, m.method, [m]) for m in measured]


def _row(trial: str, method: str, measured: Sequence[Measured]) -> ComparisonRow:
    """Return the row of a method; all frames and nodes have the same weight."""
    evaluations = [m.evaluation for m in measured if m.evaluation]
    compared = [e.compared for e in evaluations]
    none = np.empty((0, 3))
    sigma_m = np.concatenate([none.ravel(), *(c.node_sigma_m[~np.isnan(c.nees)] for c in compared)])
    branches = [e.compared.wrong_branch for e in evaluations if e.wrong_branch_frames is not None]
    timed = [m for m in measured if np.isfinite(m.seconds)]
    seconds = sum(m.seconds for m in timed)
    timed_frames = sum(m.frames for m in timed)
    return ComparisonRow(
        trial=trial,
        method=method,
        trials=len(evaluations),
        frames=sum(m.frames for m in measured),
        errors=shape_errors(
            np.concatenate([none, *(c.node_error_m.reshape(-1, 3) for c in compared)]),
            np.concatenate([none, *(c.face_error_m.reshape(-1, 3) for c in compared)]),
        ),
        coverage_95=coverage(np.concatenate([none.ravel(), *(c.nees.ravel() for c in compared)]), 0.95),
        median_sigma_m=float(np.median(sigma_m)) if len(sigma_m) else np.nan,
        wrong_branch_share=float(np.mean(np.concatenate(branches))) if branches else np.nan,
        ms_per_frame=1e3 * seconds / timed_frames if timed else np.nan,
    )


def write_comparison(rows: Sequence[ComparisonRow], command: str, path: Path) -> None:
    """Write comparison.csv, comparison.md and comparison.png, all of them or none."""
    with result_directory(path, COMPARISON_FILE) as directory:
        write_comparison_csv(rows, directory / COMPARISON_FILE)
        (directory / "comparison.md").write_text(as_markdown(rows, command), encoding="utf-8")
        published_mm = {p.source: p.node_mm for p in PUBLISHED}
        write_comparison_figure(rows, published_mm, directory / "comparison.png")
