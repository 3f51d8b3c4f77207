"""How well the front end measures tendon lengths, against a static gauge curve: `front_end_accuracy.py TRIAL...`.

For trials with truth. Both are tared alike; the static curve reads strain off dR/R without memory, eq. (9) when bent.
"""

import sys
from pathlib import Path

import numpy as np

from tensegraph import Settings, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.sensor.frames import FrameAssembler
from tensegraph.models.sensor.taring import Taring
from tensegraph.pipeline import Pipeline

EXAMPLES = Path(__file__).parents[1] / "examples"


def static_lengths(trial, pipeline: Pipeline, model) -> np.ndarray:
    """Return (frames, tendons) lengths by the gauge curve alone."""
    description, settings = trial.description, pipeline.settings
    structure, bending = description.structure, model.bending_curve("strain")
    rest = pipeline.rest.lengths(structure, description.rest_seconds)
    taring = Taring(model.gauge, bending, rest, structure.natural_length_m)
    frames = FrameAssembler(
        description.natural_resistance_ohm, len(description.tendons_of_board), settings.frames, settings.gate
    )
    readings = (pipeline.boards.reading(row) for row in trial.readings())
    made = [frame for reading in readings if reading for frame in frames.add(reading)]
    lengths = []
    for frame in [*made, *frames.finish()]:
        change = taring.common_change(frame.t_s, frame.resistance_ohm / description.natural_resistance_ohm - 1)
        bent = change < -bending.ambiguous_change
        strain = np.where(bent, bending.strain(change, 0.01)[0], model.gauge.stretched_strain(change))
        lengths.append((1 + strain) * structure.natural_length_m)
    return np.array(lengths)


def main(trials: list[Path]) -> None:
    """Print a table, one trial a row, lengths in millimetres over the tendons that do not join two anchors."""
    model = read_sensor_model()
    print("trial         RMSE   about its mean   static: RMSE   about   in 1.96 sigma   median sigma")
    for path in trials:
        trial = open_trial(path)
        structure = trial.description.structure
        truth = trial.truth()
        pipeline = Pipeline(trial.description, Settings(), model)
        frames = list(pipeline.lengths(trial.readings()))
        t_s = np.array([f.t_s for f in frames])
        true_m = structure.tendon_length_m(truth.node_position_m)
        true_m = np.stack([np.interp(t_s, truth.t_s, column) for column in true_m.T], axis=1)
        sigma_m = np.array([f.sigma_m for f in frames])
        error = np.array([f.length_m for f in frames]) - true_m
        static = static_lengths(open_trial(path), Pipeline(trial.description, Settings(), model), model) - true_m
        error, static, sigma_m = (a[:, structure.free_tendons] for a in (error, static, sigma_m))
        row = [1e3 * np.sqrt(np.nanmean(e**2)) for x in (error, static) for e in (x, x - np.nanmean(x, axis=0))]
        seen = np.isfinite(error)
        covered = np.mean(np.abs(error[seen]) < 1.96 * sigma_m[seen])
        print(
            f"{path.name:12} {row[0]:5.2f} {row[1]:16.2f} {row[2]:14.2f} {row[3]:7.2f}"
            f" {covered:14.1%} {1e3 * np.median(sigma_m[seen]):14.2f}"
        )


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]] or [EXAMPLES / "press_01"])
