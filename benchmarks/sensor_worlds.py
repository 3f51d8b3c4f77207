"""The front end in the twin's worlds, whose sensors are unlike its model of them: `sensor_worlds.py`.

The motion is that of examples/plans/press.toml in all of them.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from front_end_accuracy import length_errors_m, measured_lengths
from tensegraph import Trial, simulate
from tensegraph.io.model_file import read_sensor_model

PLAN = Path(__file__).parents[1] / "examples" / "plans" / "press.toml"
WORLDS = {
    "another gauge curve (slopes of 0.4 and 5 instead of 0.8 and 2.1)": (
        ("gauge_factor = [0.823, 2.11,", "gauge_factor = [0.4, 5.0,"),
        ("strain = [0.111", "strain = [0.08"),
    ),
    "three times the hysteresis": (("hysteresis_gain = [0.215, 0.188, 0.118]", "hysteresis_gain = [0.6, 0.5, 0.3]"),),
    "five times as slow": (("stretching_time_s = [0.122, 0.402]", "stretching_time_s = [0.6, 2.0]"),),
    "never moved between mounting and the trial (`hysteresis_at_rest = 1`)": (
        ("hysteresis_at_rest = 0.0", "hysteresis_at_rest = 1.0"),
    ),
}
"""Sensors of other kinds than those the shipped model was trained on, each with the edits of the plan that make it."""


def length_rmse_m(trial: Trial) -> float:
    """Return the RMSE of the lengths that the front end measures."""
    error_m = length_errors_m(trial, measured_lengths(trial, read_sensor_model()))
    return float(np.sqrt(np.nanmean(error_m**2)))


def table(plan: str) -> Iterator[str]:
    """Yield the rows of a Markdown table, one world a row, from the text of a plan."""
    yield "| sensor | RMSE |"
    yield "|---|---|"
    for world, edits in {"as in the plan": (), **WORLDS}.items():
        text = plan
        for old, new in edits:
            text = text.replace(old, new)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "plan.toml"
            path.write_text(text)
            rmse_m = length_rmse_m(simulate(path, Path(folder) / "trial"))
        yield f"| {world} | {1e3 * rmse_m:.2f} |"


if __name__ == "__main__":
    for line in table(PLAN.read_text()):
        print(line, flush=True)
