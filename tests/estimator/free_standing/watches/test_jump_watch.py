"""Positions whose frame moves, and poses that are wrong."""

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.prediction import Frame, Prediction
from tensegraph.estimator.free_standing.watches.jump_watch import JumpWatch
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.values.aids import PositionReading

STATE = any_state(0, 0)
SIZE = STATE.layout.size
SHAPE_M2 = 1e-8 * np.eye(36)
BODY_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))
PLACED = PlacedShape(STATE, BODY_M, SHAPE_M2)


def jumps(errors_m: list[dict[int, float]]) -> bool:
    """Return whether positions jump that are off along x by so much, of each node seen in each frame."""
    watch = JumpWatch(PoseSettings())
    for k, error_m in enumerate(errors_m):
        t_s = 0.02 * k
        aids = [
            PositionReading(t_s, node, PLACED.node_position_m[node] + np.array([off_m, 0.0, 0.0]))
            for node, off_m in error_m.items()
        ]
        frame = Frame(t_s, t_s - 0.02, 0.02, BODY_M, BODY_M, SHAPE_M2, aids, [], None)
        watch.observe(Prediction(PLACED, np.eye(SIZE), 1e-8 * np.eye(SIZE), np.zeros(3)), frame)
        watch.keep(PLACED, frame)
    return watch.has_jumped


SEEN = {3: 0.0, 8: 0.0}
GAP: dict[int, float] = {}


@pytest.mark.parametrize(
    ("errors_m", "jumped"),
    [
        ([SEEN, {3: 0.05, 8: 0.05}], True),
        ([SEEN, {3: 0.05, 8: -0.05}], False),  # apart: the robot has turned
        ([SEEN, {3: 0.03, 8: 0.14}], False),  # one of both is an outlier
        ([{3: 0.0}, {3: 0.1}], False),  # so may be the only one in sight
        ([{3: 0.05, 8: 0.05}, {3: 0.05, 8: 0.05}], False),  # the pose is wrong, and was
        ([{3: 0.0}, {3: 0.0, 8: 0.1}], False),  # node 8 comes into sight
        ([SEEN, *10 * [GAP], {3: 0.05, 8: 0.05}], False),  # out of sight the robot may move
    ],
)
def test_a_frame_moves_where_nodes_in_sight_are_off_alike_all_at_once(errors_m, jumped: bool) -> None:
    assert jumps(errors_m) == jumped
