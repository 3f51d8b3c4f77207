"""The estimator in worlds whose sensors are unlike its model of them."""

import numpy as np
import pytest

from plan_edits import PLANS, SHORT, replaced
from sensor_worlds import WORLDS, length_rmse_m
from tensegraph.commands.simulate import simulate


@pytest.fixture(scope="module")
def ordinary_rmse_m(made) -> float:
    return length_rmse_m(made)


TWO = ("another gauge curve", "three times the hysteresis")
"""What the names of those begin with that are tried by default: another curve, and another memory."""


@pytest.mark.parametrize(
    "world", [pytest.param(name, marks=() if name.startswith(TWO) else pytest.mark.long) for name in sorted(WORLDS)]
)
def test_sensors_of_another_kind_are_measured_worse(made, ordinary_rmse_m, tmp_path, world) -> None:
    """The twin is no copy of the estimator's sensor model: agreement is lost with its sensors, and only so much.

    The motion is the same in all worlds, so that only the sensor differs.
    """
    (tmp_path / "plan.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT, *WORLDS[world]))
    other = simulate(tmp_path / "plan.toml", tmp_path / "out")
    np.testing.assert_array_equal(other.truth().node_position_m, made.truth().node_position_m)
    assert ordinary_rmse_m < 0.001
    assert 1.2 * ordinary_rmse_m < length_rmse_m(other) < 0.03
