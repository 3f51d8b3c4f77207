"""Real strips, one model a file or one a mix, against both baselines: `real_strips.py FOLDER [RIG.toml]`.

First each file by itself: its first 60 % train, its last 40 % test. Then the files of the 7.5 % mix: every other one
trains, the others test, each tared on its first 10 s.
"""

import sys
from pathlib import Path

from tensegraph.io.recording_files import read_recordings, read_rig
from tensegraph.models.calibration.calibrated_model import LSTM, calibrate_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.calibration.recordings import Recording, Split
from tensegraph.models.calibration.strip_scores import StripScore
from tensegraph.models.calibration.training import train
from tensegraph.models.sensor.bending import BendingCurve

RIG = Path(__file__).parents[1] / "examples" / "cb_silicone_rig.toml"
OTHER_MIX = "1_10_*"


def scores(split: Split, settings: TrainingSettings) -> dict[str, list[tuple[str, StripScore]]]:
    """Return each estimator's scores, recording by recording."""
    calibration = calibrate_model(split, train(split, BendingCurve(), settings), None, settings)
    return {name: [(run.name, StripScore.of([run])) for run in runs] for name, runs in calibration.runs.items()}


def show(found: dict[str, list[tuple[str, StripScore]]]) -> int:
    """Print a line for each recording; return on how many the network has the least error."""
    wins = 0
    for k, (name, _) in enumerate(found[LSTM]):
        rmse = {estimator: 100 * rows[k][1].rmse for estimator, rows in found.items()}
        won = rmse[LSTM] == min(rmse.values())
        wins += won
        cells = "".join(f"{value:20.2f}" for value in rmse.values())
        print(f"{name:45}{cells}{found[LSTM][k][1].coverage_95:12.0%}  {'LSTM' if won else '-'}", flush=True)
    return wins


def main(folder: Path, rig: Path) -> None:
    """Print both tables, RMSE in per cent of strain."""
    recordings, settings = read_recordings(folder, read_rig(rig)).recordings, TrainingSettings()
    print(f"{'RMSE, % strain':45}{'LSTM':>20}{'static curve':>20}{'polynomial of rates':>20}{'in 95 %':>12}  best")
    wins = sum(show(scores(Split.by_time([recording], 0.4), settings)) for recording in recordings)
    print(f"the LSTM is best on {wins} of {len(recordings)} files\n")
    same_mix = [r for r in recordings if not Path(r.name).match(OTHER_MIX)]
    wins = show(scores(split_by_files(same_mix), settings))
    print(f"the LSTM is best on {wins} of {len(same_mix[1::2])} files of the same mix that it never saw")


def split_by_files(recordings: list[Recording]) -> Split:
    """Hold out every other recording."""
    return Split.by_name(recordings, [r.name for r in recordings[1::2]])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else RIG)
