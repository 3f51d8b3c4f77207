"""The learned rival's network on disk: safetensors."""

from dataclasses import fields
from importlib.resources import files
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from ..models.sensor.lstm import LstmWeights
from ..models.shape_network import ShapeNetwork
from ..models.values.errors import InputError, reason_of


def write_shape_network(network: ShapeNetwork, path: Path) -> None:
    """Write a network's file; weights are stored in single precision."""
    tensors = {f.name: np.asarray(getattr(network, f.name)) for f in fields(ShapeNetwork) if f.name != "weights"}
    weights = {f.name: getattr(network.weights, f.name).astype(np.float32) for f in fields(LstmWeights)}
    path.write_bytes(save({name: np.ascontiguousarray(tensor) for name, tensor in {**tensors, **weights}.items()}))


def shape_network_path() -> Path:
    """Return the path of the network that ships with the package."""
    return Path(str(files("tensegraph.models.data").joinpath("shape_network.safetensors")))


def read_shape_network(path: Path | None = None) -> ShapeNetwork:
    """Return the network in a file, or the one that ships with the package.

    Raises:
        InputError: when the file is missing or is no such network.
    """
    path = shape_network_path() if path is None else path
    try:
        tensors = load(path.read_bytes())
        weights = LstmWeights(**{f.name: tensors[f.name].astype(np.float64) for f in fields(LstmWeights)})
        return ShapeNetwork(
            weights=weights,
            change_scale=tensors["change_scale"].item(),
            displacement_scale_m=tensors["displacement_scale_m"].item(),
            covariance_m2=tensors["covariance_m2"],
            rods=tensors["rods"],
            tendons=tensors["tendons"],
            anchors=tensors["anchors"],
            rest_length_m=tensors["rest_length_m"],
        )
    except (OSError, SafetensorError) as error:
        raise InputError(f"{path}: cannot be read: {reason_of(error)}") from error
    except KeyError as error:
        raise InputError(f"{path}: is no network of shapes: {error} is missing") from error
