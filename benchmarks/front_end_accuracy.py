"""How well the front end measures tendon lengths, against a static gauge curve: `front_end_accuracy.py [TRIAL...]`.

For trials with truth. Both are tared alike; the static curve reads strain off dR/R without memory, eq. (9) when bent.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tensegraph import Settings, Trial, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.sensor.frames import FrameAssembler
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.sensor.taring import Taring
from tensegraph.models.values.readings import TendonLengths
from tensegraph.pipeline import Pipeline

EXAMPLES = Path(__file__).parents[1] / "examples"


def measured_lengths(trial: Trial, model: SensorModel) -> list[TendonLengths]:
    """Return the lengths of all frames, as estimators get them."""
    return list(Pipeline(trial.description, Settings(), model).lengths(trial.readings()))


def static_lengths_m(trial: Trial, model: SensorModel) -> np.ndarray:
    """Return (frames, tendons) lengths by the gauge curve alone."""
    description = trial.description
    pipeline = Pipeline(description, Settings(), model)
    structure = description.structure
    bending = model.bending_curve("strain")
    rest = pipeline.rest.lengths(description.rest_seconds)
    taring = Taring(model.gauge, bending, rest, structure.natural_length_m)
    frames = FrameAssembler(
        description.natural_resistance_ohm,
        len(description.tendons_of_board),
        pipeline.settings.frames,
        pipeline.settings.gate,
    )
    readings = (pipeline.boards.reading(row) for row in trial.readings())
    made = [frame for reading in readings if reading for frame in frames.add(reading)]
    lengths = []
    for frame in [*made, *frames.finish()]:
        change = taring.common_change(frame.t_s, frame.resistance_ohm / description.natural_resistance_ohm - 1)
        bent = change < -bending.polynomial.y_fold  # beyond it no bent tendon reads, and the mode is certain
        strain = np.where(bent, bending.strain(change, 0.01)[0], model.gauge.stretched_strain(change))
        lengths.append((1 + strain) * structure.natural_length_m)
    return np.array(lengths)


def true_lengths_m(trial: Trial, t_s: Sequence[float]) -> np.ndarray:
    """Return (times, tendons) true lengths at some times."""
    truth = trial.truth()
    lengths_m = trial.description.structure.tendon_length_m(truth.node_position_m)
    return np.stack([np.interp(t_s, truth.t_s, column) for column in lengths_m.T], axis=1)


def length_errors_m(trial: Trial, frames: Sequence[TendonLengths]) -> np.ndarray:
    """Return (frames, free tendons) measured minus true length, nan where nothing was measured."""
    error_m = np.array([frame.length_m for frame in frames]) - true_lengths_m(trial, [frame.t_s for frame in frames])
    return error_m[:, trial.description.structure.free_tendons]


def table(trials: Sequence[Path]) -> Iterator[str]:
    """Yield the rows of a Markdown table, one trial a row, lengths in millimetres of the tendons that can change."""
    model = read_sensor_model()
    yield "| trial | RMSE | about | static RMSE | about | within 1.96 sigma | median sigma |"
    yield "|---" * 7 + "|"
    for path in trials:
        trial = open_trial(path)
        free = trial.description.structure.free_tendons
        frames = measured_lengths(trial, model)
        sigma_m = np.array([frame.sigma_m for frame in frames])[:, free]
        error_m = length_errors_m(trial, frames)
        true_m = true_lengths_m(trial, [frame.t_s for frame in frames])
        static_error_m = (static_lengths_m(open_trial(path), model) - true_m)[:, free]
        seen = np.isfinite(error_m)
        covered = np.mean(np.abs(error_m[seen]) < 1.96 * sigma_m[seen])
        cells = [f"{value:.2f}" for error in (error_m, static_error_m) for value in rmse_mm(error)]
        median_mm = 1e3 * np.median(sigma_m[seen])
        yield f"| {path.resolve().name} | {' | '.join(cells)} | {covered:.0%} | {median_mm:.2f} |"


def rmse_mm(error_m: np.ndarray) -> tuple[float, float]:
    """Return the RMSE of (frames, tendons) errors in millimetres, and the same about each tendon's mean."""
    about_m = error_m - np.nanmean(error_m, axis=0)
    return 1e3 * float(np.sqrt(np.nanmean(error_m**2))), 1e3 * float(np.sqrt(np.nanmean(about_m**2)))


if __name__ == "__main__":
    for line in table([Path(argument) for argument in sys.argv[1:]] or [EXAMPLES / "press_01"]):
        print(line, flush=True)
