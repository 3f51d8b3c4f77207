"""Calibrate a sensor model on recordings of strips, see how good it is, and reconstruct with it.

python examples/04_calibrate.py [FOLDER]

Few recordings and few epochs, so that it ends in seconds: the network is not better than a curve yet. `tensegraph
calibrate FOLDER --out MODEL` does all of it, with a card and figures.
"""

import sys
from itertools import takewhile
from pathlib import Path

import tensegraph as tg
from tensegraph.io.calibration.recording_files import read_recording
from tensegraph.models.calibration.calibrated_model import calibrate_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.calibration.recordings import Split
from tensegraph.models.calibration.strip_rig import StripRig
from tensegraph.models.calibration.strip_scores import StripScore
from tensegraph.models.calibration.training import train
from tensegraph.models.sensor.bending import BendingCurve

HERE = Path(__file__).parent

# Each recording is strain and resistance of one strip on a test rig; another rig is described with `StripRig`.
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "calibration"
paths = sorted(folder.glob("random_small_s[015].csv"))
recordings = [read_recording(path, StripRig()) for path in paths]

# What tests the model is held out whole: it trains neither the network nor its sigma.
split = Split.by_name(recordings, ["random_small_s5"])
settings = TrainingSettings(epochs=8, sequences=8, steps=400, hidden=8)
trained = train(split, BendingCurve(), settings)  # nothing bends in these recordings: the paper's eq. (9) stands in
calibration = calibrate_model(split, trained, None, settings)

print("errors of strain on recordings held out")
print(f"{'':22}{'RMSE':>8}{'in 95 % band':>15}{'median sigma':>15}")
for name, runs in calibration.runs.items():
    score = StripScore.of(runs)
    print(f"{name:22}{score.rmse:8.4f}{score.coverage_95:15.0%}{score.median_sigma:15.4f}")

# A model file serves `reconstruct`, `stream`, and the command line's --model.
tg.write_sensor_model(calibration.model, "own_sensor.safetensors")
model = tg.read_sensor_model("own_sensor.safetensors")
trial = tg.open_trial(HERE / "press_01")
readings = takewhile(lambda row: row.host_s < 4.0, trial.readings())
shapes = list(tg.stream(readings, trial.description, model=model))
print(f"{len(shapes)} shapes with the model; the last at {shapes[-1].t_s:.2f} s, {shapes[-1].status.name}")
