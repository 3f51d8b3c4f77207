"""Sensor models on disk: safetensors, all metadata as one JSON string, so that one model gives the same bytes."""

import json
from dataclasses import asdict, dataclass, field, fields
from importlib.resources import files
from math import comb, isfinite
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, Le
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from ..models.sensor.gauge import StaticGauge
from ..models.sensor.lstm import LstmWeights, Scaling
from ..models.sensor.rate_curve import DEGREE, RateCurve
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
from ..models.values.errors import InputError, reason_of
from ..models.values.readings import MOST_STRETCH
from ..models.values.tables import Positive, parse_table
from ..models.values.tensors import Tensors, check_covariance, check_rising, checked_tensors
from .input_files import check_regular

FORMAT: Literal[2] = 2
METADATA_KEY = "tensegraph"
UNITS = {"change": "dR/R, fraction", "strain": "fraction of L0", "rate": "1/s", "step": "s"}
GATES = "i f g o"
"""Order of the gates in the weights of the LSTM, the same as in torch."""
AXES = {
    "weight_hh": "4 hidden, hidden",
    "weight_ih": "4 hidden, features",
    "bias": "4 hidden",
    "head_weight": "2, hidden",
    "head_bias": "2",
    "golden_input": "steps, features",
    "golden_output": "steps, 2",
    "strain_knots": "knots",
    "change_knots": "knots",
    "curve_scale": "inputs",
    "curve_range": "2, inputs",
    "curve_coefficients": "terms",
    "curve_factor": "terms, terms",
    "mode_change": "bins",
    "mode_log_odds": "bins",
}
"""Axes of every tensor, see `checked_tensors`, in the words of the docstrings of `SensorModel` and its parts."""
BENDING_AXES = {"bending": "6", "bending_covariance": "6, 6"}
"""Axes of the tensors that are there if a strip was bent in the recordings."""
LARGEST_BYTES = 64 << 20
"""Size above which a file is no model; the one of the package has 39 kB."""
LEAST_SCALE = 1e-6
"""Least scale of an input of the curve, in dR/R: no ADC resolves so little."""

SmallSigma = Annotated[float, Interval(ge=0, le=10)]
"""Standard deviation of a gain, whose mean is 1, or of an offset of dR/R."""


@dataclass(frozen=True, slots=True)
class _Spread:
    """Standard deviations over strips."""

    gain_sigma: SmallSigma
    offset_sigma: SmallSigma


@dataclass(frozen=True, slots=True)
class _Metadata:
    """The metadata of a model file, except its `Provenance`."""

    memory_s: list[Annotated[Positive, Le(1e5)]]
    spread: _Spread
    ranges: TrainedRanges
    sigma_scale: tuple[Annotated[Positive, Le(1e9)], Annotated[float, Interval(ge=0, le=50)]]
    scaling: Scaling = field(default_factory=Scaling)
    lag_s: Annotated[float, Interval(ge=0, le=60)] = 0.0
    unified: bool = False


def write_sensor_model(model: SensorModel, path: str | Path) -> None:
    """Write a model file; one that stands there is replaced."""
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in _tensors(model).items()}
    metadata = {METADATA_KEY: json.dumps(_metadata(model), sort_keys=True)}
    # safetensors' own writer makes files that only their owner can read
    Path(path).write_bytes(save(tensors, metadata))


def model_path(path: Path | None) -> Path:
    """Return the path of a model file, of the one that ships with the package if None."""
    return Path(str(files("tensegraph.models.data").joinpath("stretching.safetensors"))) if path is None else path


def read_sensor_model(path: str | Path | None = None) -> SensorModel:
    """Return the model in a file, or the one that ships with the package.

    Raises:
        InputError: when the file is missing or is no sound model.
    """
    path = model_path(None if path is None else Path(path))
    check_regular(path, LARGEST_BYTES)
    try:
        with safe_open(path, framework="numpy") as file:
            text = (file.metadata() or {}).get(METADATA_KEY)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (OSError, SafetensorError, TypeError, ValueError) as error:  # a damaged header
        raise InputError(f"{path}: is no model file: {reason_of(error)}") from error
    if text is None:
        raise InputError(f"{path}: is no model file: expected the metadata '{METADATA_KEY}', as calibrate writes it")
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError) as error:  # Python also refuses numbers of thousands of digits
        raise InputError(f"{path}: is no model file: expected JSON in the metadata '{METADATA_KEY}'") from error
    try:
        model = _sensor_model(tensors, metadata)
        _check_curve(model)
    except InputError as error:
        raise InputError(f"{path}: sensor model: {error}") from error
    return model


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


def _sensor_model(tensors: Tensors, table: Any) -> SensorModel:
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        got = table.get("format", "none") if isinstance(table, dict) else f"{table!r:.60}"
        raise InputError(f"metadata: expected a table with format = {FORMAT}, got {got}")
    metadata = parse_table(_Metadata, table, "metadata")
    provenance = parse_table(Provenance, table, "metadata")
    tensors = _checked(tensors, metadata)
    weights = LstmWeights(**{part.name: tensors[part.name] for part in fields(LstmWeights)})
    memory_s = np.array(metadata.memory_s, dtype=np.float64)
    golden = GoldenVector(tensors["golden_input"], tensors["golden_output"])
    bends = "bending" in tensors
    return SensorModel(
        network=StretchingNetwork(weights, metadata.scaling, memory_s, golden),
        curve=_rate_curve(tensors, memory_s, metadata.spread),
        mode_odds=ModeOdds(tensors["mode_change"], tensors["mode_log_odds"]),
        bending=BendingCoefficients(tensors["bending"], tensors["bending_covariance"]) if bends else None,
        ranges=metadata.ranges,
        provenance=provenance,
        sigma_scale=SigmaScale(*metadata.sigma_scale),
        lag_s=metadata.lag_s,
        unified=metadata.unified,
    )


def _checked(tensors: Tensors, metadata: _Metadata) -> Tensors:
    """Return the tensors of a model, all of which fit together, before any of them is used."""
    memories = len(metadata.memory_s)
    inputs = tensors["curve_scale"].size if "curve_scale" in tensors else 1
    if not 1 <= inputs <= 1 + memories:
        raise InputError(f"tensor 'curve_scale': expected 1 to {1 + memories} numbers, got {inputs}")
    sizes = {"features": 3 + memories, "inputs": inputs, "terms": comb(inputs + DEGREE, DEGREE) + 1}
    bends = bool(BENDING_AXES.keys() & tensors.keys())
    checked = checked_tensors(tensors, AXES | (BENDING_AXES if bends else {}), sizes)
    for name in ("strain_knots", "change_knots", "mode_change"):
        check_rising(name, checked[name])
    if (checked["curve_scale"] < LEAST_SCALE).any():
        raise InputError(
            f"tensor 'curve_scale': expected at least {LEAST_SCALE:g}, got {checked['curve_scale'].min():g}"
        )
    if (np.diff(checked["curve_range"], axis=0) < 0).any():
        raise InputError("tensor 'curve_range': expected the least values in the first row, the greatest in the second")
    if bends:
        check_covariance("bending_covariance", checked["bending_covariance"])
    _check_ranges(metadata.ranges, checked["strain_knots"])
    return checked


def _check_ranges(ranges: TrainedRanges, strain_knots: NDArray[np.float64]) -> None:
    """Check that the ranges of the training are ranges, and that the strains of the static gauge curve are in them.

    The gauge curve may end long before: it is fitted to strips that stay stretched alone.
    """
    for name in ("change", "strain", "step_s"):
        least, most = getattr(ranges, name)
        if not (isfinite(least) and isfinite(most) and least <= most):
            raise InputError(f"metadata: ranges.{name}: expected [least, most], got [{least:g}, {most:g}]")
    if ranges.step_s[0] <= 0:
        raise InputError(f"metadata: ranges.step_s: expected positive times, got {ranges.step_s[0]:g}")
    if strain_knots[0] != 0 or not 1e-3 * ranges.strain[1] < strain_knots[-1] < 2 * ranges.strain[1]:
        got = f"{strain_knots[0]:.3g} to {strain_knots[-1]:.3g}"
        raise InputError(f"tensor 'strain_knots': expected 0 to about ranges.strain, {ranges.strain[1]:.3g}, got {got}")


def _check_curve(model: SensorModel) -> None:
    """Check that the curve gives strains and sigmas that a tendon can have at each dR/R of its training, held for long.

    A strip that was stretched most is seldom held there, so that the curve is uncertain of it, and its sigma large.
    """
    change = np.linspace(0, max(model.ranges.change[1], 0))
    means = np.repeat(change[:, None], len(model.curve.memory_s), axis=1)
    strain, sigma = model.curve.estimate(change, means)
    if np.abs(strain).max() > MOST_STRETCH:
        got = f"{strain.min():.3g} to {strain.max():.3g}"
        raise InputError(f"its curve gives strains from {got}: expected magnitudes of at most {MOST_STRETCH:g}")
    if sigma.max() > MOST_STRETCH:
        raise InputError(f"its curve gives a sigma of strain of {sigma.max():.3g}: expected at most {MOST_STRETCH:g}")


def _rate_curve(tensors: Tensors, memory_s: NDArray[np.float64], spread: _Spread) -> RateCurve:
    gauge = StaticGauge(tensors["strain_knots"], tensors["change_knots"], spread.gain_sigma, spread.offset_sigma)
    scale = tensors["curve_scale"]
    return RateCurve(
        gauge=gauge,
        memory_s=memory_s[: len(scale) - 1],
        scale=scale,
        range=tensors["curve_range"],
        coefficients=tensors["curve_coefficients"],
        factor=tensors["curve_factor"],
    )
