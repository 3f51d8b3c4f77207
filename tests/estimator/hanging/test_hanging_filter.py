"""The pose of a structure on a ball, by the filter alone."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Settings
from tensegraph.estimator.hanging.hands import HandTorque
from tensegraph.estimator.hanging.hanging_filter import HangingFilter
from tensegraph.models.pose.robot import HangingRobot
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import Imu, ImuReading

ALONG = np.array([0.0, 0, 1])
NO_HANDS = HandTorque(np.zeros(3), np.zeros((3, 3)))
STEP_S, REST_S, SILENT_S, SPINS_RAD_PER_S = 0.02, 0.4, 0.6, 5.0


@pytest.fixture(scope="module")
def hung(balanced) -> RestShape:
    """The six-strut at the highest of its nodes alone."""
    x = balanced.node_position_m
    top = [int(np.argmax(x[:, 2]))]
    structure = replace(balanced.structure, anchors=np.array(top), anchor_position_m=x[top])
    return replace(balanced, structure=structure)


def spun(hung: RestShape, rods: tuple[int, ...], ending: tuple[int, ...] = ()) -> HangingFilter:
    """Return the filter of a structure that is at rest, and then spins, after the sensors of some rods have ended."""
    x = hung.node_position_m
    imus = tuple(Imu(rod, 0.5, ALONG) for rod in rods)
    a, b = x[hung.structure.rods[list(rods)]].swapaxes(0, 1)
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    aside = np.cross(along, [0.3, 0.5, 0.81])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    mounted = np.stack([aside, np.cross(along, aside), along], axis=2)
    poses = HangingFilter(hung, HangingRobot(imus, (), REST_S, 0.001), Settings())
    for frame in range(80):
        aids = []
        for sample in (0, 1):
            t_s = (frame - 0.5 + 0.5 * sample) * STEP_S
            rate = SPINS_RAD_PER_S * UP * (t_s > 1.0)
            aids += [  # a turn about the vertical leaves gravity as it is
                ImuReading(i, t_s, mounted[i].T @ rate, GRAVITY_M_PER_S2 * mounted[i].T @ UP)
                for i in range(len(rods))
                if rods[i] not in ending or t_s < SILENT_S
            ]
        shape = Shape(frame * STEP_S, x, 1e-8 * np.eye(x.size), Status.OK, None)
        poses.hang(shape, NO_HANDS, aids)
    return poses


def test_a_spin_that_the_sensors_in_use_do_not_tell_is_in_doubt(hung) -> None:
    """Two sensors on rods of other directions tell how it spins; one of them does not, told alone or left alone."""
    assert not spun(hung, (4, 0)).is_contradicted
    assert spun(hung, (4,)).is_contradicted
    assert spun(hung, (4, 0), ending=(0,)).is_contradicted
