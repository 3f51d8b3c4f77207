"""`compare`: runs all methods on the same lengths and sigmas of all trials, in the form of the paper's Table I."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.markdown import Markdown

from ..io.figures.comparison_figure import write_comparison_figure, write_spread_figure
from ..io.measured_trials import measured_by, measured_methods, read_measured, write_measured
from ..io.provenance import fingerprint
from ..io.reports.comparison_tables import as_markdown, write_comparison_csv
from ..io.reports.progress import StageBar
from ..io.reports.terminal import Terminal
from ..io.toml import read_settings
from ..io.trial_directory import Trial, open_trial
from ..io.whole import check_replaceable, check_writable, written_whole
from ..models.evaluation.comparison import ALL, PUBLISHED, ComparisonRow, FrameErrors, Measured, comparison_row
from ..models.evaluation.estimate import Estimate
from ..models.evaluation.metrics import evaluate
from ..models.evaluation.truth import Truth
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.values.errors import IndeterminateError, InputError
from ..models.values.readings import TendonLengths
from ..pipeline import (
    ESTIMATORS,
    AnySensorModel,
    EstimatorFactory,
    Pipeline,
    estimator_of,
    estimator_plug_ins,
)
from .many import Many, Workers
from .origin import chosen_model, made_with, placed_model
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
PACE = {"least-squares": 3.0, "ukf": 4.0, "frame": 4.0, "live": 2.0, "batch": 5.0}
"""How long the methods take in proportion to the lengths, on the example trial, for the progress bar."""
PARTS = "trials"
"""Folder, in that of the comparison, of what was measured on each trial."""
MOST_TRIALS = 24
"""Number of trials up to which each is shown on the screen and in the figure; of more, their spread is."""


@dataclass(frozen=True, slots=True)
class ComparisonJob:
    """One trial on which all methods are compared."""

    trial: Path
    part: Path
    """File that keeps what was measured."""
    settings: Settings
    model: Path | None
    """File or name of the sensor model; the one in the package if None."""
    estimators: Mapping[str, EstimatorFactory]
    """The methods by name."""

    def fingerprint(self, trial: Trial) -> str | None:
        """Return the hash of all that is measured; None with a method of this process, whose code is not known."""
        others = estimator_plug_ins()
        known = {method for method, made in self.estimators.items() if _is_ours(made)} | others.keys()
        if self.estimators.keys() - known:
            return None
        return fingerprint(
            {
                "inputs": trial.hashes() | trial.truth_hashes(),
                "settings": asdict(self.settings),
                "methods": {method: made_with(method, self.model, trial.plug_ins) for method in self.estimators},
            }
        )


def _is_ours(made: EstimatorFactory) -> bool:
    return made.__module__.partition(".")[0] == __name__.partition(".")[0]


def estimators_of(methods: Sequence[str] | None) -> dict[str, EstimatorFactory]:
    """Return what makes the estimator of each method; of all, those of other packages included, for None.

    Raises:
        InputError: see `estimator_of`.
    """
    return {method: estimator_of(method) for method in methods or [*ESTIMATORS, *estimator_plug_ins()]}


def compare_trials(
    trials: Sequence[Path],
    *,
    methods: Sequence[str] | None,
    out: Path,
    config: Path | None,
    model: Path | None,
    workers: Workers,
    terminal: Terminal,
) -> None:
    """Run methods on trials, write table and figure, and print the table.

    What was measured on a trial is kept in a file as soon as it is known, and used by the same command again.

    Args:
        trials: their directories.
        methods: see `estimators_of`.
        out: directory of the comparison.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        workers: the processes that do the work.
        terminal: for progress and the table.

    Raises:
        TensegraphError: when the comparison cannot be written, or no trial can be compared.
        SystemExit: with 1 when some of several trials failed.
    """
    names = distinct_names(trials)
    check_comparison(out)
    settings = read_settings(config)
    placed = placed_model(model, workers)  # refused here if it is none, not by every worker
    estimators = estimators_of(methods)
    jobs = {
        name: ComparisonJob(
            workers.place(trial), workers.place(out / PARTS / f"{name}.npz"), settings, placed, estimators
        )
        for name, trial in zip(names, trials, strict=True)
    }
    many = Many(workers, terminal)
    done = set()
    for name, lines in many.each(compare_trial, jobs, "trials"):
        done.add(name)
        for line in lines:
            terminal.line(line)
    if done:
        parts = [job.part for name, job in jobs.items() if name in done]
        with terminal.stage("table and figure"):
            rows = rows_of_parts(parts)
            write_comparison(rows, comparison_command(trials), out)
        with_trials = len(parts) <= MOST_TRIALS
        terminal.news.print(Markdown(as_markdown(rows, comparison_command(trials), with_trials=with_trials)))
        terminal.written(f"written to {out}")
    many.end()


def compare_trial(job: ComparisonJob, terminal: Terminal) -> list[str]:
    """Run every method on a trial, unless it was done before, and return a line for each.

    Raises:
        TensegraphError: when the trial cannot be read, has no truth of the time of its lengths, or the file cannot be
            written.
    """
    trial = open_trial(job.trial)
    made_from = job.fingerprint(trial)
    measured = read_measured(job.part, made_from)
    if measured is None:
        with terminal.stage(f"all methods on {trial.name}"):
            measured = list(measure(trial, job.settings, chosen_model(job.model), terminal, estimators=job.estimators))
        write_measured(measured, made_from, job.part)
    return [one.line() for one in measured]


def check_comparison(out: Path) -> None:
    """Check, before any work, that a directory is vacant or holds an earlier comparison, finished or not.

    Raises:
        InputError: when something else stands there, or it cannot be written.
    """
    if (out / PARTS).is_dir():
        check_writable(out / PARTS / "part")
    else:
        check_replaceable(out, COMPARISON_FILE)


def comparison_command(trials: Sequence[Path]) -> str:
    """Return the command in short, without the names of many trials."""
    named = " ".join(trial.as_posix() for trial in trials)
    return f"tensegraph compare {named if len(trials) <= MOST_TRIALS else f'({len(trials)} trials)'}"


def measure(
    trial: Trial,
    settings: Settings,
    model: AnySensorModel,
    terminal: Terminal,
    estimators: Mapping[str, EstimatorFactory] = ESTIMATORS,
) -> Iterator[Measured]:
    """Run every method on the same lengths of a trial, and yield each result."""
    methods = sorted(estimators, key=lambda m: list(METHODS).index(m) if m in METHODS else len(METHODS))
    with terminal.stages(trial.name, {"lengths": 1.0} | {METHODS.get(m, m): PACE.get(m, 1.0) for m in methods}) as bar:
        comparison = TrialComparison(trial, settings, model, bar)
        yield comparison.without_method()
        for method in methods:
            yield comparison.with_method(method, estimators[method])


class TrialComparison:
    """The lengths of a trial, and its truth."""

    def __init__(self, trial: Trial, settings: Settings, model: AnySensorModel, bar: StageBar) -> None:
        self._bar = bar
        self._truth = _truth_of(trial)
        self._name = trial.path.resolve().name
        self._structure = trial.description.structure
        self._pipeline = Pipeline(trial.description, settings, model)
        self._frames = list(self._pipeline.lengths(bar.track("lengths", trial.readings(), trial.row_count())))

    def without_method(self) -> Measured:
        """Return the result of the rest shape alone."""
        return self._measured(NO_METHOD, np.nan, rest_shape_estimate(self._pipeline, self._frames))

    def with_method(self, method: str, factory: EstimatorFactory) -> Measured:
        """Run a method over all frames, and return its result."""
        label = METHODS.get(method, method)
        frames = self._bar.track(label, self._frames, len(self._frames))
        start_s = time.perf_counter()
        try:
            shapes = list(self._pipeline.shapes_by(factory, method, frames))
        except IndeterminateError as error:
            return self._without_errors(label, f"gave up at {error}")
        except InputError as error:  # the method is not for such a trial
            return self._without_errors(label, f"not run: {error}")
        seconds = time.perf_counter() - start_s
        return self._measured(label, seconds, Estimate.of(Reconstruction.of(self._structure, shapes)))

    def _without_errors(self, label: str, note: str) -> Measured:
        """Return the result of a method that gives no shapes."""
        frames = len(self._frames)
        return Measured(trial=self._name, method=label, frames=frames, seconds=np.nan, errors=None, note=note)

    def _measured(self, method: str, seconds: float, estimate: Estimate) -> Measured:
        evaluation = evaluate(self._structure, self._pipeline.rest.node_position_m, estimate, self._truth)
        return Measured(
            trial=self._name,
            method=method,
            frames=len(self._frames),
            seconds=seconds,
            errors=FrameErrors.of(evaluation),
        )


def _truth_of(trial: Trial) -> Truth:
    positions = trial.truth()
    if positions is None:
        raise InputError(f"{trial.path}: has no truth to compare with: expected [truth] in trial.toml")
    return trial.truth_of(positions)


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
    together = [comparison_row(ALL, [m for m in measured if m.method == method]) for method in methods]
    return together + [comparison_row(m.trial, [m]) for m in measured]


def rows_of_parts(parts: Sequence[Path]) -> list[ComparisonRow]:
    """Return the same rows from the files of the trials, of which one method is in memory at a time."""
    methods = dict.fromkeys(method for part in parts for method in measured_methods(part))
    together = [comparison_row(ALL, list(measured_by(method, parts))) for method in methods]
    return together + [
        comparison_row(m.trial, [m]) for part in parts for method in methods for m in measured_by(method, [part])
    ]


def write_comparison(rows: Sequence[ComparisonRow], command: str, path: Path) -> None:
    """Write comparison.csv, comparison.md and comparison.png, all of them or none."""
    names = (COMPARISON_FILE, "comparison.md", "comparison.png")
    with written_whole(*(path / name for name in names)) as (table, page, figure):
        write_comparison_csv(rows, table)
        page.write_text(as_markdown(rows, command), encoding="utf-8")
        published_mm = {p.source: p.node_mm for p in PUBLISHED}
        if len({row.trial for row in rows}) - 1 <= MOST_TRIALS:
            write_comparison_figure(rows, published_mm, figure)
        else:
            write_spread_figure(rows, published_mm, figure)
