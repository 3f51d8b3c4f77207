"""Sensor models on disk: safetensors, all metadata as one JSON string, so that one model gives the same bytes."""

import json
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from ..models.sensor.sensor_model import SensorModel
from ..models.values.errors import InputError

METADATA_KEY = "tensegraph"


def write_sensor_model(model: SensorModel, path: Path) -> None:
    """Write a model file."""
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in model.tensors.items()}
    save_file(tensors, path, {METADATA_KEY: json.dumps(model.metadata, sort_keys=True)})


def read_sensor_model(path: Path | None = None) -> SensorModel:
    """Return the model in a file, or the one that ships with the package.

    Raises:
        InputError: when the file is missing or is no sound model.
    """
    name = Path(str(files("tensegraph.models.data").joinpath("stretching.safetensors"))) if path is None else path
    return _named(name, lambda: _read(name))


def _read(path: Path) -> SensorModel:
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata() or {}
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    return SensorModel(tensors, json.loads(metadata.get(METADATA_KEY, "{}")))


def _named(path: Path, read: Callable[[], SensorModel]) -> SensorModel:
    try:
        return read()
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, SafetensorError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: is no model file: {error}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
