"""What a result is made with: the choice of the sensor model, and what run.toml tells of model files and plug-ins."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..io.model_file import model_path, read_sensor_model
from ..io.provenance import model_tables, plug_in_tables
from ..models.plug_ins import PlugIn
from ..models.sensor.sensor_model import SensorModel
from ..models.settings import Settings
from ..models.trial_description import TrialDescription
from ..models.values.errors import InputError, naming
from ..pipeline import ESTIMATORS, AnySensorModel, estimator_plug_ins, sensor_model_of, sensor_model_plug_ins
from .many import Workers


def chosen_model(model: Path | None) -> AnySensorModel:
    """Return the sensor model of `--model`: that in a file, or the one of another package that has this name.

    Raises:
        InputError: when there is neither, or the file is no sound model.
    """
    if _model_plug_in(model):
        return sensor_model_of(str(model))
    others = sensor_model_plug_ins()
    if others and model is not None and not model.exists():
        raise InputError(f"--model {model}: no such file: expected one, or one of {', '.join(others)}")
    return read_sensor_model(model)


def trained_model(
    trial: TrialDescription, settings: Settings, model: Path | None, config: Path | None
) -> AnySensorModel:
    """Return the sensor model of `--model`, after the check of `check_trained`.

    Raises:
        InputError: see `chosen_model` and `check_trained`.
    """
    chosen = chosen_model(model)
    check_trained(chosen, trial, settings, config or model)
    return chosen


def check_trained(model: AnySensorModel, trial: TrialDescription, settings: Settings, told_in: Path | None) -> None:
    """Check that a sensor model was trained at the rate of a trial's frames; with lengths, a trial needs none.

    Raises:
        InputError: when it was not, naming the file `told_in`, or that of the model in the package.
    """
    if isinstance(model, SensorModel) and trial.source != "lengths":
        with naming(model_path(told_in)):
            model.check_rate(settings.frames.rate_hz)


def placed_model(model: Path | None, workers: Workers) -> Path | None:
    """Return `--model` as workers find it, after a check here that it is one; a name stays a name.

    Raises:
        InputError: see `chosen_model`.
    """
    chosen_model(model)
    return model if model is None or _model_plug_in(model) else workers.place(model)


def made_with(method: str, model: Path | None, of_trial: Sequence[PlugIn]) -> dict[str, Any]:
    """Return the tables of run.toml that name model files and plug-ins.

    Args:
        method: of the estimate.
        model: file or name of the sensor model; the one in the package if None.
        of_trial: see `Trial.plug_ins`.
    """
    estimator = estimator_plug_ins().get(method) if method not in ESTIMATORS else None
    sensor_model = _model_plug_in(model)
    used = [one for one in (estimator, sensor_model, *of_trial) if one is not None]
    tables: dict[str, Any] = model_tables(None if sensor_model else model, method)
    if sensor_model:
        del tables["model"]
    return tables | ({"plug_ins": plug_in_tables(used)} if used else {})


def _model_plug_in(model: Path | None) -> PlugIn | None:
    """Return the sensor model of another package that has this name; None for a file."""
    return None if model is None or model.exists() else sensor_model_plug_ins().get(str(model))
