"""Real strips, one model a file or one a mix, against both baselines: `real_strips.py FOLDER [RIG.toml]`.

First each file by itself: its first 60 % train, its last 40 % test. Then the files of the 7.5 % mix: every other one
trains, the others test, each tared on its first 10 s.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from tensegraph.io.calibration.recording_files import read_recordings, read_rig
from tensegraph.models.calibration.calibrated_model import LSTM, POLYNOMIAL, STATIC, calibrate_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.calibration.recordings import Recording, Split
from tensegraph.models.calibration.strip_scores import StripScore
from tensegraph.models.calibration.training import train
from tensegraph.models.sensor.bending import BendingCurve

RIG = Path(__file__).parents[1] / "examples" / "cb_silicone_rig.toml"
OTHER_MIX = "1_10_*"
ESTIMATORS = (LSTM, STATIC, POLYNOMIAL)

Scores = dict[str, dict[str, StripScore]]
"""Of each recording, by estimator."""


def scores(split: Split, settings: TrainingSettings) -> Scores:
    """Train on a split, and return the scores on what it holds out."""
    calibration = calibrate_model(split, train(split, BendingCurve(), settings), None, settings)
    found: Scores = {}
    for name, runs in calibration.runs.items():
        for run in runs:
            if name in ESTIMATORS:
                found.setdefault(run.name, {})[name] = StripScore.of([run])
    return found


def table(folder: Path, rig: Path, settings: TrainingSettings) -> Iterator[str]:
    """Yield the rows of a Markdown table, RMSE in per cent of strain, and a line that counts where the network wins."""
    recordings = read_recordings(folder, read_rig(rig)).recordings
    alone: Scores = {}
    for k, recording in enumerate(recordings):
        alone |= scores(Split.by_time([recording], 0.4), settings)
        if k == 0:
            yield f"| file | {' | '.join(ESTIMATORS)} | LSTM in 95 % |"
            yield "|---" * (len(ESTIMATORS) + 2) + "|"
        yield row(recording.name, alone[recording.name])
    same_mix = [r for r in recordings if not Path(r.name).match(OTHER_MIX)]
    unseen = scores(split_by_files(same_mix), settings)
    for name, found in unseen.items():
        yield row(f"trained on other files of the mix: {name}", found)
    yield ""
    yield f"The LSTM is best on {wins(alone)} of {len(alone)} files, and on {wins(unseen)} of {len(unseen)} never seen."


def row(name: str, found: dict[str, StripScore]) -> str:
    """Return one recording's row, the least error in bold."""
    least = min(score.rmse for score in found.values())
    cells = [f"**{100 * s.rmse:.2f}**" if s.rmse == least else f"{100 * s.rmse:.2f}" for s in found.values()]
    return f"| {name} | {' | '.join(cells)} | {found[LSTM].coverage_95:.0%} |"


def wins(found: Scores) -> int:
    """Return on how many recordings the network has the least error."""
    return sum(
        estimators[LSTM].rmse == min(score.rmse for score in estimators.values()) for estimators in found.values()
    )


def split_by_files(recordings: list[Recording]) -> Split:
    """Hold out every other recording."""
    return Split.by_name(recordings, [r.name for r in recordings[1::2]])


if __name__ == "__main__":
    for line in table(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else RIG, TrainingSettings()):
        print(line, flush=True)
