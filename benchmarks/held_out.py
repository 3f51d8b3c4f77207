"""The scores of the shipped sensor model, which its file holds, and what another training gives: `held_out.py`.

With `--train`, three models are trained besides: with another seed, and with recordings held out that reach beyond all
others in speed or in strain.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tensegraph.io.calibration.recording_files import read_recordings
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.calibration.bending_fit import fit_bending
from tensegraph.models.calibration.calibrated_model import LSTM, calibrate_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.calibration.recordings import Recording, Split
from tensegraph.models.calibration.strip_rig import StripRig
from tensegraph.models.calibration.strip_scores import StripScore, by_speed
from tensegraph.models.calibration.training import train
from tensegraph.models.sensor.bending import BendingCurve

RECORDINGS = Path(__file__).parents[1] / "examples" / "calibration"
BEYOND = {
    "0.2 /s, trained at up to 0.1 /s": ("stretch_0.20*", "random_*"),
    "up to a strain of 0.69, trained up to 0.3": ("stretch_*_s2", "random_large*"),
}
"""What is held out to see the model beyond its training."""


def held_out_table() -> Iterator[str]:
    """Yield the rows of a Markdown table: errors of strain of the shipped model and of what it is compared with."""
    provenance = read_sensor_model().provenance
    yield "| held out | estimator | RMSE | R² | in 95 % band | median sigma |"
    yield "|---" * 6 + "|"
    for recording, scores in sorted(provenance.held_out.items()):
        baselines = {name: by_recording[recording] for name, by_recording in provenance.baselines.items()}
        rows = {"LSTM": scores, **baselines}
        for k, (name, score) in enumerate(rows.items()):
            yield f"| {'' if k else recording} | {name} | {_cells(score)} |"


def _cells(score: Mapping[str, Any]) -> str:
    return f"{score['rmse']:.4f} | {score['r2']:.3f} | {score['coverage_95']:.0%} | {score['median_sigma']:.4f}"


def training_table(recordings: list[Recording], settings: TrainingSettings) -> Iterator[str]:
    """Yield the rows of a Markdown table: the network alone, of other trainings."""
    yield "| training | held out | RMSE | in 95 % band | median sigma |"
    yield "|---" * 5 + "|"
    other = replace(settings, seed=settings.seed + 1)
    yield from _training_rows(f"seed {other.seed}", Split.by_recordings(recordings), other)
    for name, patterns in BEYOND.items():
        yield from _training_rows(name, Split.by_name(recordings, patterns), settings)


def _training_rows(name: str, split: Split, settings: TrainingSettings) -> Iterator[str]:
    bending = fit_bending([*split.training, *split.validation], split.held_out)
    trained = train(split, bending.curve() if bending else BendingCurve(), settings)
    runs = calibrate_model(split, trained, bending, settings).runs[LSTM]
    for group, members in by_speed(runs).items():
        score = StripScore.of(members)
        yield f"| {name} | {group} | {score.rmse:.4f} | {score.coverage_95:.0%} | {score.median_sigma:.4f} |"


def shipped_recordings() -> list[Recording]:
    """Return the recordings that the shipped model was made from."""
    return list(read_recordings(RECORDINGS, StripRig()).recordings)


if __name__ == "__main__":
    for line in held_out_table():
        print(line)
    for line in training_table(shipped_recordings(), TrainingSettings()) if "--train" in sys.argv else ():
        print(line, flush=True)
