"""The scores of several methods on the same lengths of trials."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.comparison import ALL, ComparisonRow, FrameErrors, Measured, comparison_row
from ..models.evaluation.metrics import evaluate
from ..models.evaluation.truth import Truth
from ..models.settings import Settings, checked_settings
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.shape import Shape, Status
from ..models.values.errors import IndeterminateError, InputError, naming
from ..models.values.readings import TendonLengths
from ..pipeline import (
    ESTIMATORS,
    OFFLINE_FRAMES,
    AnySensorModel,
    EstimatorFactory,
    Pipeline,
    estimator_of,
    estimator_plug_ins,
    sensor_model_of,
)

if TYPE_CHECKING:
    from ..io.reports.progress import StageBar
    from ..io.reports.terminal import Terminal

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


def compare(
    trials: Iterable[Trial | str | Path],
    methods: Sequence[str] | None = None,
    *,
    settings: Settings | None = None,
    model: AnySensorModel | str | None = None,
) -> list[ComparisonRow]:
    """Run methods on the same lengths of trials, and return what `tensegraph compare` writes into its table.

    Args:
        trials: opened trials, or the paths of their directories.
        methods: names as `reconstruct` takes them; all, those of other packages included, for None.
        settings: the settings of the run; the defaults if None.
        model: see `reconstruct`.

    Returns:
        A row for each method on all trials together, and then one for each trial and method.

    Raises:
        TensegraphError: for a trial that cannot be read or has no truth, two trials of one name, a method that is none,
            or no methods.
    """
    from ..io.reports.terminal import Terminal  # rich

    if isinstance(trials, str | Path | Trial):
        raise InputError(f"trials: expected a list of trials, as [{str(getattr(trials, 'path', trials))!r}], got one")
    opened = [trial if isinstance(trial, Trial) else open_trial(trial) for trial in trials]
    names = [trial.path.resolve().name for trial in opened]
    for name in {name for name in names if names.count(name) > 1}:
        raise InputError(f"trials: expected different names, got two named {name}")
    with_settings, with_model = checked_settings(settings), sensor_model_of(model)
    estimators, terminal = estimators_of(methods), Terminal(quiet=True)
    measured = [one for trial in opened for one in measure(trial, with_settings, with_model, terminal, estimators)]
    return comparison_rows(by_method(measured))


def estimators_of(methods: Sequence[str] | None) -> dict[str, EstimatorFactory]:
    """Return what makes the estimator of each method; of all, those of other packages included, for None.

    Raises:
        InputError: for one name in place of several, for none, and see `estimator_of`.
    """
    if methods is None:
        methods = [*ESTIMATORS, *estimator_plug_ins()]
    if isinstance(methods, str):
        raise InputError(f"methods: expected a list of names, as [{methods!r}], got one")
    if not methods:
        raise InputError("methods: expected names, or None for all, got none")
    return {method: estimator_of(method) for method in methods}


def measure(
    trial: Trial,
    settings: Settings,
    model: AnySensorModel,
    terminal: "Terminal",
    estimators: Mapping[str, EstimatorFactory] = ESTIMATORS,
) -> Iterator[Measured]:
    """Run every method on the same lengths of a trial, and yield each result."""
    methods = sorted(estimators, key=lambda m: list(METHODS).index(m) if m in METHODS else len(METHODS))
    stages = {"lengths": 1.0} | {METHODS.get(m, m): PACE.get(m, 1.0) for m in methods}
    with naming(trial.path), terminal.stages(trial.name, stages) as bar:
        comparison = TrialComparison(trial, settings, model, bar)
        yield comparison.without_method()
        for method in methods:
            yield comparison.with_method(method, estimators[method])


class TrialComparison:
    """The lengths of a trial, and its truth."""

    def __init__(self, trial: Trial, settings: Settings, model: AnySensorModel, bar: "StageBar") -> None:
        self._bar = bar
        self._truth = _truth_of(trial)
        self._name = trial.path.resolve().name
        self._structure = trial.description.structure
        self._pipeline = Pipeline(trial.description, settings, model)
        readings = bar.track("lengths", trial.readings(), trial.row_count())
        self._frames = list(self._pipeline.after_rest(self._pipeline.lengths(readings, OFFLINE_FRAMES)))

    def without_method(self) -> Measured:
        """Return the result of the rest shape alone."""
        return self._measured(NO_METHOD, np.nan, rest_shape_held(self._pipeline, self._frames))

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
        return self._measured(label, seconds, Reconstruction.of(self._structure, shapes))

    def _without_errors(self, label: str, note: str) -> Measured:
        """Return the result of a method that gives no shapes."""
        frames = len(self._frames)
        return Measured(trial=self._name, method=label, frames=frames, seconds=np.nan, errors=None, note=note)

    def _measured(self, method: str, seconds: float, estimate: Reconstruction) -> Measured:
        evaluation = evaluate(self._pipeline.rest.node_position_m, estimate, self._truth)
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


def rest_shape_held(pipeline: Pipeline, frames: Sequence[TendonLengths]) -> Reconstruction:
    """Return the rest shape in every frame, without a covariance."""
    rest_m = pipeline.rest.node_position_m
    unknown_m2 = np.full((rest_m.size, rest_m.size), np.nan)
    contacts = np.full(len(rest_m), np.nan) if pipeline.trial.floor else None
    return Reconstruction.of(
        pipeline.rest.structure,
        (Shape(frame.t_s, rest_m, unknown_m2, Status.PRIOR_ONLY, frame, contacts=contacts) for frame in frames),
    )


def by_method(measured: Iterable[Measured]) -> list[list[Measured]]:
    """Return the results of each method, on one trial after the other, in the order in which methods come first."""
    of_method: dict[str, list[Measured]] = {}
    for one in measured:
        of_method.setdefault(one.method, []).append(one)
    return list(of_method.values())


def comparison_rows(of_methods: Iterable[Sequence[Measured]]) -> list[ComparisonRow]:
    """Return one row for each method on all trials, then one row for each trial and method.

    Args:
        of_methods: the results of each method, see `by_method`; those of one are needed at a time.
    """
    together, single = [], []
    for measured in of_methods:
        together.append(comparison_row(ALL, measured))
        single += [comparison_row(one.trial, [one]) for one in measured]
    order = {trial: number for number, trial in enumerate(dict.fromkeys(row.trial for row in single))}
    return together + sorted(single, key=lambda row: order[row.trial])
