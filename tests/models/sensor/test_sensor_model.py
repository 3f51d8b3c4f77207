"""The sensor model guards its network by a golden vector."""

from dataclasses import replace

import pytest

from tensegraph import InputError
from tensegraph.models.sensor.sensor_model import SensorModel


def test_a_changed_weight_is_noticed(model: SensorModel) -> None:
    weights = replace(model.network.weights, bias=model.network.weights.bias + 1e-3)
    with pytest.raises(InputError, match="golden vector is off"):
        replace(model.network, weights=weights)
