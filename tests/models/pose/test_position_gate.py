"""Which positions are believed: those of one body, or where the pose expects them."""

import numpy as np
import pytest

from tensegraph.models.pose.position_gate import believed
from tensegraph.models.values.aids import PositionReading
from tensegraph.models.values.rotations import rotation

X = 0.15 * np.random.default_rng(3).standard_normal((12, 3))
POSE_M2 = 1e-6 * np.eye(36)
SHAPE_M2 = 1e-6 * np.eye(36)
SEEN = (2, 4, 9, 11)


def passed(read_m: dict[int, np.ndarray], pose_m2: np.ndarray = POSE_M2, unseen_s: float = 1.0) -> list[int]:
    """Return the nodes whose readings are believed."""
    readings = [PositionReading(1.0, node, position_m) for node, position_m in read_m.items()]
    passes = believed(readings, X, pose_m2, SHAPE_M2, 0.02, unseen_s, 5e-4).passes
    return [reading.node for reading, passes_gate in zip(readings, passes, strict=True) if passes_gate]


def test_positions_with_their_noise_are_believed() -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        assert passed({node: X[node] + 1e-3 * rng.standard_normal(3) for node in SEEN}) == list(SEEN)


@pytest.mark.parametrize("wrong_m", [[1e6, 0, 0], [0.1, 0, 0], [0, -0.05, 0.05]])
def test_an_absurd_position_is_left_out(wrong_m) -> None:
    read_m = {node: X[node] for node in SEEN}
    read_m[9] = X[9] + wrong_m
    assert passed(read_m) == [2, 4, 11]


def test_two_nodes_that_are_exchanged_are_left_out() -> None:
    """Two agree with each other on either side: the pose tells which."""
    assert passed({2: X[4], 4: X[2], 9: X[9], 11: X[11]}) == [9, 11]


@pytest.mark.parametrize("swapped", [(5, 11), (3, 8)])
def test_markers_that_are_exchanged_in_a_symmetric_structure_are_left_out(balanced, swapped) -> None:
    """Three nodes of six keep their distances when two of them are exchanged, while the fourth is left over."""
    x = balanced.node_position_m
    a, b = swapped
    readings = [PositionReading(1.0, node, x[{a: b, b: a}.get(node, node)]) for node in (3, 5, 8, 11)]
    for unseen_s in (0.02, 0.005):
        told = believed(readings, x, POSE_M2, SHAPE_M2, 0.02, unseen_s, 5e-4)
        assert told.agreeing == 3
        assert [r.node for r, passes in zip(readings, told.passes, strict=True) if passes] == sorted(
            {3, 5, 8, 11} - {a, b}
        )


def test_a_node_that_is_frozen_while_the_body_moves_is_left_out() -> None:
    turned_m = X @ rotation(np.array([0.3, 0.2, 0.0])).T + [0.1, 0, 0]
    assert passed({2: turned_m[2], 4: X[4], 9: turned_m[9], 11: turned_m[11]}) == [2, 9, 11]


def test_a_body_that_was_carried_away_is_found_at_once() -> None:
    """A metre from where the pose expects it, and upside down: all nodes agree."""
    turned_m = X @ rotation(np.array([3.0, 0.2, 0.0])).T + [1.0, -0.5, 0.2]
    assert passed({node: turned_m[node] for node in SEEN}) == list(SEEN)


def test_a_node_alone_is_believed_where_the_pose_expects_it() -> None:
    """By hand: sigma of 20 mm by its motion in a frame and 1 mm by the pose; 6 sigma are 120 mm."""
    for far_m, believes in ((0.118, True), (0.123, False)):
        assert passed({4: X[4] + [0, far_m, 0]}) == ([4] if believes else [])
    assert passed({4: X[4] + [0, 0.3, 0]}, 0.1**2 * np.eye(36)) == [4]


def test_nodes_in_sight_do_not_jump_together() -> None:
    """By hand: six sigma of 20 mm in a frame are 120 mm; after 0.2 s unseen they are 1.2 m."""
    jumped_m = {node: X[node] + [0.5, 0, 0] for node in SEEN}
    assert passed(jumped_m, unseen_s=0.02) == []
    assert passed(jumped_m, unseen_s=0.2) == list(SEEN)
