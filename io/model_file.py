"""Sensor models on disk: safetensors, all metadata as one JSON string, so that one model gives the same bytes."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from ..models.sensor.gauge import StaticGauge
from ..models.sensor.lstm import LstmWeights, Scaling
from ..models.sensor.rate_curve import RateCurve
from ..models.sensor.sensor_model import (
    BendingCoefficients,
    GoldenVector,
    ModeOdds,
    Provenance,
    SensorModel,
    SigmaScale,
    StretchingNetwork,
    TrainedRanges,
)
from ..models.values.errors import InputError
from ..models.values.tables import parse_table

FORMAT: Literal[2] = 2
METADATA_KEY = "tensegraph"
UNITS = {"change": "dR/R, fraction", "strain": "fraction of L0", "rate": "1/s", "step": "s"}
GATES = "i f g o"
"""Order of the gates in the weights of the LSTM, the same as in torch."""

Tensors = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class _Spread:
    """Standard deviations over strips."""

    gain_sigma: float
    offset_sigma: float


@dataclass(frozen=True, slots=True)
class _Metadata:
    """The metadata of a model file, except its `Provenance`."""

    memory_s: list[float]
    spread: _Spread
    ranges: TrainedRanges
    sigma_scale: tuple[float, float]
    scaling: Scaling = field(default_factory=Scaling)
    lag_s: float = 0.0
    unified: bool = False


def write_sensor_model(model: SensorModel, path: Path) -> None:
    """Write a model file."""
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in _tensors(model).items()}
    metadata = {METADATA_KEY: json.dumps(_metadata(model), sort_keys=True)}
    path.write_bytes(save(tensors, metadata))  # safetensors' own writer makes files that only their owner can read


def model_path(path: Path | None = None) -> Path:
    """Return the path of a model file, or of the one that ships with the package."""
    return Path(str(files("tensegraph.models.data").joinpath("stretching.safetensors"))) if path is None else path


def read_sensor_model(path: Path | None = None) -> SensorModel:
    """Return the model in a file, or the one that ships with the package.

    Raises:
        InputError: when the file is missing or is no sound model.
    """
    path = model_path(path)
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = json.loads((file.metadata() or {}).get(METADATA_KEY, "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, SafetensorError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: is no model file: {error}") from error
    try:
        return _sensor_model({name: tensor.astype(np.float64) for name, tensor in tensors.items()}, metadata)
    except InputError as error:
        raise InputError(f"{path}: sensor model: {error}") from error


def _tensors(model: SensorModel) -> Tensors:
    weights = model.network.weights
    curve = model.curve
    golden = model.network.golden
    tensors = {part.name: getattr(weights, part.name) for part in fields(weights)} | {
        "strain_knots": curve.gauge.strain_knots,
        "change_knots": curve.gauge.change_knots,
        "curve_scale": curve.scale,
        "curve_range": curve.range,
        "curve_coefficients": curve.coefficients,
        "curve_factor": curve.factor,
        "mode_change": model.mode_odds.change,
        "mode_log_odds": model.mode_odds.log_odds,
        "golden_input": golden.input,
        "golden_output": golden.output,
    }
    if model.bending is not None:
        tensors |= {"bending": model.bending.coefficients, "bending_covariance": model.bending.covariance}
    return tensors


def _metadata(model: SensorModel) -> dict[str, Any]:
    gauge = model.gauge
    scale = model.sigma_scale
    return {
        "format": FORMAT,
        "units": UNITS,
        "gates": GATES,
        "unified": model.unified,
        "scaling": asdict(model.network.scaling),
        "memory_s": model.network.memory_s.tolist(),
        "ranges": asdict(model.ranges),
        "spread": {"gain_sigma": gauge.gain_sigma, "offset_sigma": gauge.offset_sigma},
        "sigma_scale": [scale.factor, scale.power],
        "lag_s": model.lag_s,
        **asdict(model.provenance),
    }


def _sensor_model(tensors: Tensors, table: Mapping[str, Any]) -> SensorModel:
    if table.get("format") != FORMAT:
        raise InputError(f"expected format {FORMAT}, got {table.get('format')}")
    metadata = parse_table(_Metadata, table, "metadata")

    def tensor(name: str) -> NDArray[np.float64]:
        if name not in tensors:
            raise InputError(f"tensor '{name}' is missing")
        if not np.isfinite(tensors[name]).all():
            raise InputError(f"tensor '{name}' has values that are not finite")
        return tensors[name]

    weights = LstmWeights(**{part.name: tensor(part.name) for part in fields(LstmWeights)})
    memory_s = np.array(metadata.memory_s, dtype=np.float64)
    golden = GoldenVector(tensor("golden_input"), tensor("golden_output"))
    bends = "bending" in tensors
    return SensorModel(
        network=StretchingNetwork(weights, metadata.scaling, memory_s, golden),
        curve=_rate_curve(tensor, memory_s, metadata.spread),
        mode_odds=ModeOdds(tensor("mode_change"), tensor("mode_log_odds")),
        bending=BendingCoefficients(tensor("bending"), tensor("bending_covariance")) if bends else None,
        ranges=metadata.ranges,
        provenance=parse_table(Provenance, table, "metadata"),
        sigma_scale=SigmaScale(*metadata.sigma_scale),
        lag_s=metadata.lag_s,
        unified=metadata.unified,
    )


def _rate_curve(
    tensor: Callable[[str], NDArray[np.float64]], memory_s: NDArray[np.float64], spread: _Spread
) -> RateCurve:
    gauge = StaticGauge(tensor("strain_knots"), tensor("change_knots"), spread.gain_sigma, spread.offset_sigma)
    scale = tensor("curve_scale")
    return RateCurve(
        gauge=gauge,
        memory_s=memory_s[: len(scale) - 1],
        scale=scale,
        range=tensor("curve_range"),
        coefficients=tensor("curve_coefficients"),
        factor=tensor("curve_factor"),
    )
