"""The pose of a structure on a ball, by the filter alone."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Settings
from tensegraph.estimator.free_standing.pose_smoother import PoseStep
from tensegraph.estimator.hanging.hands import HandTorque
from tensegraph.estimator.hanging.hanging_filter import HangingFilter, limited
from tensegraph.models.pose.placed import Rows
from tensegraph.models.pose.robot import HangingRobot
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import Imu, ImuReading
from tensegraph.models.values.rotations import rotation

ALONG = np.array([0.0, 0, 1])
NO_HANDS = HandTorque(np.zeros(3), np.zeros((3, 3)))
STEP_S, REST_S, ENDS_S, SPINS_S = 0.02, 0.4, 0.6, 1.0


@pytest.fixture(scope="module")
def hung(balanced) -> RestShape:
    """The six-strut at the highest of its nodes alone."""
    x = balanced.node_position_m
    top = [int(np.argmax(x[:, 2]))]
    structure = replace(balanced.structure, anchors=np.array(top), anchor_position_m=x[top])
    return replace(balanced, structure=structure)


class Hung:
    """The filter of a structure that rests, and then turns at some rate for some time, with sensors on some rods."""

    def __init__(
        self, hung: RestShape, rods: tuple[int, ...], rate_rad_per_s: np.ndarray, turns_s: float = np.inf
    ) -> None:
        x = hung.node_position_m
        a, b = x[hung.structure.rods[list(rods)]].swapaxes(0, 1)
        along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        aside = np.cross(along, [0.3, 0.5, 0.81])
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        self._mounted = np.stack([aside, np.cross(along, aside), along], axis=2)
        self._rate_rad_per_s = rate_rad_per_s
        self._turns_s = turns_s
        self._x = x
        self._read_s = -0.5 * STEP_S
        imus = tuple(Imu(rod, 0.5, ALONG) for rod in rods)
        self.poses = HangingFilter(hung, HangingRobot(imus=imus, rest_seconds=REST_S, anchor_m=0.001), Settings())

    def hang(self, t_s: float, imus: tuple[int, ...], hands: HandTorque | None) -> PoseStep:
        """Return one more frame, with two samples in each 20 ms of some sensors."""
        aids = []
        while self._read_s <= t_s + 1e-9:
            since_s = max(self._read_s - SPINS_S, 0.0)
            rate = self._rate_rad_per_s * (0 < since_s < self._turns_s)
            up = rotation(self._rate_rad_per_s * min(since_s, self._turns_s)).T @ UP
            aids += [  # the axis is the same in body and world
                ImuReading(i, self._read_s, self._mounted[i].T @ rate, GRAVITY_M_PER_S2 * self._mounted[i].T @ up)
                for i in imus
            ]
            self._read_s += 0.5 * STEP_S
        shape = Shape(t_s, self._x, 1e-8 * np.eye(self._x.size), Status.OK, None)
        return self.poses.hang(shape, hands, aids)


def spins_unseen(hung: RestShape, rods: tuple[int, ...], left: tuple[int, ...]) -> bool:
    """Return whether a spin is in doubt; `left` are the numbers of the sensors that do not end before it."""
    robot = Hung(hung, rods, 5.0 * UP)
    for frame in range(80):
        t_s = frame * STEP_S
        robot.hang(t_s, tuple(range(len(rods))) if t_s < ENDS_S else left, NO_HANDS)
    return robot.poses.is_contradicted


def test_a_spin_that_the_sensors_in_use_do_not_tell_is_in_doubt(hung) -> None:
    """Two sensors on rods of other directions tell how it spins; one of them does not, told alone or left alone."""
    assert not spins_unseen(hung, (4, 0), left=(0, 1))
    assert spins_unseen(hung, (4,), left=(0,))
    assert spins_unseen(hung, (4, 0), left=(0,))


def test_it_turns_for_all_of_a_gap_in_which_its_sensors_were_read(hung) -> None:
    """Three seconds without a frame, at 0.5 rad/s: by hand, 1.5 rad about the vertical, where it was 0.5."""
    robot = Hung(hung, (4, 0), 0.5 * UP)
    for frame in range(51):
        robot.hang(frame * STEP_S, (0, 1), None)
    step = robot.hang(4.0, (0, 1), None)
    assert step.state.turn == pytest.approx(rotation(np.array([0.0, 0.0, 1.5])), abs=0.03)


def test_sensors_tell_how_a_hand_that_nobody_sees_holds_it_aside(hung) -> None:
    """Turned by 0.5 rad in 1 s, and held there for 4 s, while the balance of forces tells of no hand."""
    robot = Hung(hung, (4, 0), np.array([0.0, 0.5, 0.0]), turns_s=1.0)
    for frame in range(301):
        step = robot.hang(frame * STEP_S, (0, 1), NO_HANDS)
        assert not robot.poses.is_contradicted
    assert step.state.turn == pytest.approx(rotation(np.array([0.0, 0.5, 0.0])), abs=0.01)
    assert np.abs(step.state.rate_bias_rad_per_s).max() < 1e-3


def test_rows_of_what_is_known_exactly_say_nothing() -> None:
    """Of three rows the first is of what is known, the second tells, the third contradicts, and counts in full."""
    rows = Rows(np.ones(3), np.eye(3), np.full(3, 2.0))
    told = limited(rows, np.diag([0.0, 4.0, 0.0]), np.array([False, False, True]))
    np.testing.assert_array_equal(told.jacobian, np.eye(3)[1:])
    np.testing.assert_allclose(told.variance, [4.0, 2.0])
