"""The estimator in worlds whose sensors are unlike its model of them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from plan_edits import PLANS, SHORT, replaced
from tensegraph import Settings, Trial
from tensegraph.commands.simulate import simulate
from tensegraph.io.model_file import read_sensor_model
from tensegraph.pipeline import Pipeline


def length_error_m(trial: Trial) -> NDArray[np.float64]:
    """(frames, free tendons) of the front end."""
    structure, truth = trial.description.structure, trial.truth()
    frames = list(Pipeline(trial.description, Settings(), read_sensor_model()).lengths(trial.readings()))
    t_s = [frame.t_s for frame in frames]
    true_m = structure.tendon_length_m(truth.node_position_m)
    true_m = np.stack([np.interp(t_s, truth.t_s, column) for column in true_m.T], axis=1)
    return (np.array([frame.length_m for frame in frames]) - true_m)[:, structure.free_tendons]


WORLDS = {
    "gauge": (("gauge_factor = [0.823, 2.11,", "gauge_factor = [0.4, 5.0,"), ("strain = [0.111", "strain = [0.08")),
    "hysteresis": (("hysteresis_gain = [0.215, 0.188, 0.118]", "hysteresis_gain = [0.6, 0.5, 0.3]"),),
    "fresh": (("hysteresis_at_rest = 0.0", "hysteresis_at_rest = 1.0"),),
    "slow": (("stretching_time_s = [0.122, 0.402]", "stretching_time_s = [0.6, 2.0]"),),
}
"""Sensors of other kinds than those the shipped model was trained on."""


@pytest.mark.parametrize("world", sorted(WORLDS))
def test_sensors_of_another_kind_are_measured_worse(made, tmp_path, world) -> None:
    """The twin is no copy of the estimator's sensor model: agreement is lost with its sensors, and only so much.

    The motion is the same in all worlds, so that only the sensor differs.
    """
    (tmp_path / "plan.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT, *WORLDS[world]))
    other = simulate(tmp_path / "plan.toml", tmp_path / "out")
    np.testing.assert_array_equal(other.truth().node_position_m, made.truth().node_position_m)
    ordinary, worse = (np.sqrt(np.nanmean(length_error_m(trial) ** 2)) for trial in (made, other))
    assert ordinary < 0.001
    assert 1.2 * ordinary < worse < 0.03
