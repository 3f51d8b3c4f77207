"""Which inertial sensors to trust."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.imu_trust import ImuTrust
from tensegraph.factors.imu import ImuArray, ImuSamples
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import UP
from tensegraph.models.values.aids import Imu
from tensegraph.models.values.rotations import rotation

SIGMA_RAD = 0.01


@pytest.mark.parametrize(("apart_rad", "disagrees"), [(0.05, False), (0.07, True)])
def test_a_sensor_that_contradicts_the_direction_of_its_rod_is_doubted(apart_rad: float, disagrees: bool) -> None:
    """By hand: body and sensor are known to 0.01 rad each, so that 4 sigma are 0.057 rad."""
    imus = ImuArray([Imu(0, 0.5, np.array([1.0, 0.0, 0.0]))], np.array([[0, 1]]))
    state = replace(
        any_state(1, 0),
        turn=np.eye(3),
        imu_turn=rotation(np.array([[0.0, 0.0, apart_rad]])),
        misalignment=np.zeros((1, 2)),
    )
    variance = np.zeros(state.layout.size)
    variance[state.layout.turn] = variance[state.layout.imu_turn] = SIGMA_RAD**2
    body_m = np.zeros((12, 3))
    body_m[1, 0] = 0.3
    placed = PlacedShape(state, body_m, 1e-12 * np.eye(36))
    samples = ImuSamples(np.zeros((1, 3)), 9.81 * UP[None], np.array([2]))
    trust = ImuTrust(1, 0.0, PoseSettings())
    told = []
    for k in range(200):
        trust.observe(imus, placed, np.diag(variance), samples, 0.02 * k, 0.02)
        told.append(trust.disagree)
    assert told[-1] == disagrees
    assert not told[10]


def test_without_a_sensor_in_use_nothing_is_told() -> None:
    imus = ImuArray([Imu(0, 0.5, np.array([1.0, 0.0, 0.0]))], np.array([[0, 1]]))
    state = any_state(1, 0)
    placed = PlacedShape(state, 0.1 * np.random.default_rng(1).standard_normal((12, 3)), 1e-6 * np.eye(36))
    trust = ImuTrust(1, 0.0, PoseSettings())
    trust.give_up()
    samples = ImuSamples(np.zeros((1, 3)), 9.81 * UP[None], np.array([2]))
    trust.observe(imus, placed, np.eye(state.layout.size), samples, 0.02, 0.02)
    assert not trust.disagree
    assert trust.contradicted.all()
