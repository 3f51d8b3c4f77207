"""Which positions are trusted: told by the robot at rest, by their scale, and by where they were before."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.position_trust import PositionTrust
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import PositionReading

SEEN = (2, 4, 9, 11)
REST_S = 0.5
STEP_S = 0.02
Edit = Callable[[int, np.ndarray], tuple[int, np.ndarray]]


def right(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
    return node, position_m


def shifted(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
    return node, position_m + np.array([0.5, 0, 0])


def exchanged(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
    return {2: 11, 11: 2}.get(node, node), position_m


def larger(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
    return node, 1.05 * position_m


class Watched:
    """A robot that stays at rest, seen by motion capture."""

    def __init__(self, rest: RestShape) -> None:
        free = replace(rest.structure, anchors=np.empty(0), anchor_position_m=np.empty((0, 3)))
        rest = replace(rest, structure=free, covariance_m2=1e-7 * np.eye(36))
        centre_m = rest.node_position_m.mean(axis=0)
        state = replace(any_state(0, 0), turn=np.eye(3), position_m=centre_m)
        self.trust = PositionTrust(rest, REST_S, 5e-4)
        self.placed = PlacedShape(state, rest.node_position_m - centre_m, rest.covariance_m2)
        self.t_s = 0.0

    def see(self, seconds: float, edit: Edit, nodes: tuple[int, ...] = SEEN) -> set[int]:
        """Return the nodes that are used in the last of the frames of some seconds, in which positions are edited."""
        used: list[PositionReading] = []
        size = self.placed.state.layout.size
        for _ in range(round(seconds / STEP_S)):
            told = [edit(node, self.placed.node_position_m[node]) for node in nodes]
            readings = [PositionReading(self.t_s, node, position_m) for node, position_m in told]
            used = self.trust.trusted(self.t_s, readings, self.placed, 1e-6 * np.eye(size), STEP_S)
            self.t_s += STEP_S
        return {reading.node for reading in used}


@pytest.fixture
def watched(balanced: RestShape) -> Watched:
    return Watched(balanced)


@pytest.mark.parametrize(
    "edit", [shifted, larger, lambda node, y: (node, y * [1, 1, -1]), lambda n, y: (n, y[[0, 2, 1]])]
)
def test_a_wrong_frame_unit_or_axis_at_rest_is_never_believed(watched, edit) -> None:
    assert watched.see(REST_S, edit) <= {2}  # at z = 0, it is where it should be
    assert watched.trust.is_doubted
    assert watched.see(0.5, edit) == set()
    watched.see(0.5, right, nodes=())
    assert watched.see(0.1, edit) == set()
    assert watched.trust.is_doubted


def test_exchanged_nodes_are_left_out_with_no_other_in_sight_too(watched) -> None:
    assert watched.see(REST_S, exchanged) == {4, 9}
    watched.see(1.0, right, nodes=())
    assert watched.see(0.1, exchanged, nodes=(2, 11)) == set()
    assert watched.trust.is_doubted


def test_right_positions_are_used_and_a_wrong_one_is_left_out_without_doubt(watched) -> None:
    assert watched.see(1.0, right) == set(SEEN)
    assert watched.see(2.0, lambda node, y: (node, y + 0.1 * (node == 9))) == {2, 4, 11}
    assert not watched.trust.is_doubted
    watched.see(1.2, right, nodes=())
    assert not watched.trust.is_doubted


@pytest.mark.parametrize(("up_m", "is_doubted"), [(0.0015, False), (0.003, True)])
def test_a_frame_that_is_shifted_a_little_at_rest_is_used_and_doubted(watched, up_m, is_doubted) -> None:
    """By hand: with four nodes known to 0.32 mm and positions to 0.5 mm, the mean is known to 0.53 mm; four are 2.1."""

    def lifted(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
        return node, position_m + np.array([0.0, 0.0, up_m])

    assert watched.see(1.0, lifted) == set(SEEN)
    assert watched.trust.is_doubted == is_doubted


@pytest.mark.parametrize(("up_m", "is_doubted"), [(0.002, False), (0.003, True)])
def test_a_marker_on_a_stalk_is_used_and_doubted(watched, up_m, is_doubted) -> None:
    """By hand: a node known to 0.32 mm and its positions to 0.5 mm differ by 0.59 mm; four are 2.4."""

    def lifted(node: int, position_m: np.ndarray) -> tuple[int, np.ndarray]:
        return node, position_m + np.array([0.0, 0.0, up_m if node == 4 else 0.0])

    assert watched.see(1.0, lifted) == set(SEEN)
    assert watched.trust.is_doubted == is_doubted


@pytest.mark.parametrize("seconds", [0.1, 1.0], ids=["at rest", "later"])
def test_a_node_in_two_places_at_one_instant_is_in_neither(watched, seconds) -> None:
    """A marker that has the name of another, too; a row that was written twice is no contradiction."""
    seen = watched.see(seconds, right)
    assert seen == set(SEEN)
    assert watched.see(STEP_S, lambda node, x: shifted(9, x) if node == 11 else (node, x)) == {2, 4}
    assert watched.see(STEP_S, right, nodes=(2, 4, 9, 9, 11)) == set(SEEN)


def test_all_nodes_that_jump_in_sight_are_doubted_until_they_are_back(watched) -> None:
    watched.see(1.0, right)
    assert watched.see(1.0, shifted) == set()
    assert watched.trust.is_doubted
    assert watched.see(1.1, right) == set(SEEN)
    assert not watched.trust.is_doubted


def test_a_robot_that_was_carried_away_unseen_is_found(watched) -> None:
    watched.see(1.0, right)
    watched.see(0.5, right, nodes=())
    assert watched.see(STEP_S, shifted) == set(SEEN)


def test_a_frame_that_was_not_seen_at_rest_has_to_agree_with_the_pose(watched) -> None:
    watched.see(2.0, right, nodes=())
    assert watched.see(STEP_S, shifted) == set()
    assert watched.see(STEP_S, right) == set(SEEN)


def test_a_scale_that_was_not_seen_at_rest_is_found_within_a_second(watched) -> None:
    """By hand: a mean that starts at 1 is at 1.05 (1 - exp(-t)) + exp(-t), above 1.03 from t = 0.92 s on."""
    watched.see(1.0, right, nodes=())
    assert len(watched.see(0.3, larger)) > 1
    assert watched.see(0.8, larger) == set()


def test_a_node_that_is_told_twice_in_one_frame_tells_no_scale(balanced) -> None:
    """Between both positions there is no distance."""
    robot = Watched(balanced)
    robot.see(1.0, right)
    assert robot.see(0.1, right, nodes=(4, 4)) == {4}
    assert robot.see(0.1, right) == set(SEEN)
