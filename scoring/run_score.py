"""The score of a run against the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..io.mocap.truth_file import read_truth
from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.evaluation import Evaluation
from ..models.evaluation.metrics import evaluate as evaluate_estimate
from ..models.evaluation.motion_capture import lay_onto
from ..models.evaluation.truth import Truth
from ..models.settings import Settings, checked_settings
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.structure import Structure
from ..models.values.errors import InputError, naming
from ..models.values.tracks import MarkerTracks, StampedPositions
from ..pipeline import rest_shape_of_trial

TOLD_ALIKE_M = 1e-6
"""Largest difference of lengths and positions that are told alike."""


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
    _check_same(opened, result.structure)
    path = None if truth is None else Path(truth)
    return evaluation_of(opened, result, checked_settings(settings), path, align=align, offset_s=offset_s)


def _check_same(trial: Trial, of_run: Structure) -> None:
    """Raise InputError for a trial whose structure is told otherwise than that of a run."""
    told = trial.description.structure
    if not told.joins_as(of_run):
        raise InputError(f"{trial.path}: expected the trial of the run: its nodes are joined otherwise, or anchored")
    for name in ("rod_length_m", "natural_length_m", "anchor_position_m"):
        there, here = getattr(of_run, name), getattr(told, name)
        apart_m = np.abs(here - there).max(initial=0.0)
        if apart_m > TOLD_ALIKE_M:
            raise InputError(
                f"{trial.path}: expected the trial of the run: its {name} differs, by up to {1e3 * apart_m:.3g} mm"
            )


def evaluation_of(
    trial: Trial,
    estimate: Reconstruction,
    settings: Settings,
    truth: Path | None,
    *,
    align: bool,
    offset_s: float | None,
) -> Evaluation:
    """Return the evaluation of an estimate against the truth of its trial, or of a file; see `evaluate`.

    Raises:
        InputError: when the truth cannot be read, or does not match the estimate.
    """
    rest = rest_shape_of_trial(trial, settings)
    known = truth_of_trial(trial, truth, estimate, offset_s)
    return evaluate_estimate(
        rest.node_position_m,
        estimate,
        known,
        align=align,
        load_threshold_n=settings.load_threshold_n,
    )


def truth_of_trial(trial: Trial, path: Path | None, estimate: Reconstruction, offset_s: float | None) -> Truth:
    """Return the truth of a trial, with positions from another file if one is given, on the host's clock.

    Raises:
        InputError: when there is none, or it cannot be read, or laid onto the estimate.
    """
    structure = trial.description.structure
    recorded = trial.recorded_truth() if path is None else read_truth(path, structure.node_count)
    if recorded is None:
        raise InputError(f"{trial.path}: has no truth: expected [truth] in trial.toml, or --truth FILE")
    if isinstance(recorded, MarkerTracks):
        with naming(path or trial.path):
            positions, capture = lay_onto(
                recorded,
                estimate,
                marked=trial.marked_nodes(),
                offset_s=offset_s,
                rest_seconds=trial.description.rest_seconds,
            )
        return replace(trial.truth_of(positions, trial.true_loads()), capture=capture)
    positions = StampedPositions(recorded.t_s + (offset_s or 0.0), recorded.node_position_m)
    truth = trial.truth_of(positions, trial.true_loads())
    if path is not None or not offset_s:
        return truth
    loads, contacts = truth.loads, truth.contacts
    return replace(
        truth,
        loads=loads and replace(loads, t_s=loads.t_s + offset_s),
        contacts=contacts and replace(contacts, t_s=contacts.t_s + offset_s),
    )
