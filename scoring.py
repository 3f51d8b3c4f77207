"""Scores as values: of a run against the truth, of several methods, and of a sensor model that is calibrated."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .commands.paths import distinct_names
from .estimator.rest_step import rest_shape_of
from .io.calibration.recording_files import read_rig
from .io.mocap.truth_file import read_truth
from .io.trial_directory import Trial, open_trial
from .models.calibration.recipe import TrainingSettings
from .models.evaluation.comparison import ComparisonRow
from .models.evaluation.estimate import Estimate
from .models.evaluation.evaluation import Evaluation
from .models.evaluation.metrics import evaluate as evaluate_estimate
from .models.evaluation.motion_capture import lay_onto
from .models.evaluation.truth import Truth
from .models.settings import Settings, checked_settings
from .models.structure.reconstruction import Reconstruction
from .models.values.errors import InputError
from .models.values.marker_tracks import MarkerTracks
from .models.values.stamped_positions import StampedPositions
from .models.values.tables import parse_table
from .pipeline import AnySensorModel, sensor_model_of

if TYPE_CHECKING:
    from .io.reports.model_card import CalibrationReport


def evaluate(
    result: Reconstruction,
    trial: Trial | str | Path,
    truth: str | Path | None = None,
    *,
    align: bool = False,
    offset_s: float | None = None,
    settings: Settings | None = None,
) -> Evaluation:
    """Return errors, consistency, detected faults and loads of a run, against the truth.

    Args:
        result: the run, as `reconstruct` and `load` return it.
        trial: the trial that it was made from, opened, or the path of its directory.
        truth: a file of stamped node positions or of motion capture; that of the trial if None.
        align: whether the truth is rotated and translated first, so that it fits best.
        offset_s: host time minus the time of the truth; if None, 0, or for motion capture what its motion tells.
        settings: the settings of the run; the defaults if None.

    Raises:
        InputError: when the trial or the truth cannot be read, or does not match the run.
    """
    opened = trial if isinstance(trial, Trial) else open_trial(trial)
    if result.structure.node_count != opened.description.structure.node_count:
        raise InputError(
            f"{opened.path}: expected the trial of the run, whose structure has {result.structure.node_count} "
            f"nodes, got one of {opened.description.structure.node_count}"
        )
    estimate = Estimate.of(result)
    path = None if truth is None else Path(truth)
    return evaluation_of(opened, estimate, checked_settings(settings), path, align=align, offset_s=offset_s)


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
        TensegraphError: for a trial that cannot be read or has no truth, two trials of one name, or a method that is
            none.
    """
    from .commands.compare import comparison_rows, estimators_of, measure  # rich and matplotlib
    from .io.reports.terminal import Terminal

    if isinstance(trials, str | Path | Trial):
        raise InputError(f"trials: expected a list of trials, as [{str(getattr(trials, 'path', trials))!r}], got one")
    opened = [trial if isinstance(trial, Trial) else open_trial(trial) for trial in trials]
    distinct_names([trial.path for trial in opened])
    with_settings, with_model = checked_settings(settings), sensor_model_of(model)
    estimators, terminal = estimators_of(methods), Terminal(quiet=True)
    measured = [one for trial in opened for one in measure(trial, with_settings, with_model, terminal, estimators)]
    return comparison_rows(measured)


def calibrate(
    folder: str | Path,
    *,
    rig: str | Path | None = None,
    hold_out: Sequence[str] = (),
    hold_out_tail: float | None = None,
    settings: TrainingSettings | None = None,
    progress: Callable[[int, float], None] = lambda epoch, loss: None,
) -> "CalibrationReport":
    """Train a sensor model on a folder of recordings; `report.model()` is what `reconstruct` takes as `model`.

    Nothing is written: `write_sensor_model` writes a model file.

    Args:
        folder: folder of recordings.
        rig: file that describes the recordings; see `read_rig`.
        hold_out: patterns of the names of the recordings that test the model; see `Split.by_recordings` for none.
        hold_out_tail: share of each recording, at its end, that tests the model instead.
        settings: settings of the training; the defaults if None.
        progress: called after each epoch with its number and mean loss.

    Raises:
        TensegraphError: when there is nothing to train on, or a setting is not allowed.
    """
    from .commands.calibrate import HoldOut, report_of, training_data  # rich and matplotlib
    from .models.calibration.training import train  # torch takes seconds to import

    start_s = time.perf_counter()
    chosen, strip_rig = HoldOut(tuple(hold_out), hold_out_tail), read_rig(None if rig is None else Path(rig))
    checked = parse_table(TrainingSettings, asdict(settings or TrainingSettings()), "settings")
    data = training_data(Path(folder), strip_rig, chosen)
    trained = train(data.split, data.curve, checked, progress)
    return report_of(data, trained, checked, strip_rig, chosen, start_s)


def evaluation_of(
    trial: Trial, estimate: Estimate, settings: Settings, truth: Path | None, *, align: bool, offset_s: float | None
) -> Evaluation:
    """Return the evaluation of an estimate against the truth of its trial, or of a file; see `evaluate`.

    Raises:
        InputError: when the truth cannot be read, or does not match the estimate.
    """
    rest = rest_shape_of(trial.description, settings.rest)
    known = truth_of_trial(trial, truth, estimate, offset_s)
    return evaluate_estimate(
        trial.description.structure,
        rest.node_position_m,
        estimate,
        known,
        align=align,
        load_threshold_n=settings.load_threshold_n,
    )


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
