"""Whether the frame of the positions has moved while nodes are in sight: all of them are off alike, all at once.

A node in sight has the error e in this frame, by the pose that is expected, and had e' in the frame before, by the
corrected pose. What is new is e - e': a pose that is wrong, as after a tip that no position told, is no jump. Nor is a
node that appears where the pose does not expect it. Nodes that are off each in another way are outliers, or those of a
robot that tips unseen; so may be a node that is alone in sight.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....factors.position import position_rows
from ....models.pose.placed import PlacedShape, Rows
from ....models.pose.pose_settings import PoseSettings
from ....models.pose.position_gate import MOST_SIGMA
from ....models.values.aids import READING_HOLDS_S
from ....models.values.chi_squared import squared_distance
from ..prediction import Frame, Prediction

ALIKE = 0.5
"""Scatter of what is new of several nodes, over its mean, up to which they are off alike."""


class JumpWatch:
    """Compares the positions of nodes in sight, frame by frame."""

    def __init__(self, settings: PoseSettings) -> None:
        self._settings = settings
        self._before: dict[int, tuple[float, NDArray[np.float64]]] = {}
        self.has_jumped = False
        """Whether it has moved ever: where it is now, no position tells."""

    def observe(self, predicted: Prediction, frame: Frame) -> None:
        """Judge the positions of a frame by what is expected of it.

        Feet that begin to slide move by `motion_m_per_s`, which footholds do not expect.
        """
        in_sight = [reading for reading in frame.positions if self._is_in_sight(reading.node, frame.t_s)]
        if not in_sight:
            return
        rows = position_rows(predicted.placed, in_sight, frame.t_s, self._settings.position_m)
        before_m = np.concatenate([self._before[reading.node][1] for reading in in_sight])
        slides_m = self._settings.motion_m_per_s * frame.step_s
        news_m = rows.error - before_m
        misfit = common_misfit(replace(rows, error=news_m), predicted.covariance, slides_m)
        self.has_jumped |= misfit > MOST_SIGMA**2 and _are_alike(news_m.reshape(-1, 3))

    def keep(self, corrected: PlacedShape, frame: Frame) -> None:
        """Keep the errors of the positions of a frame by the corrected pose."""
        if not frame.positions:
            return
        rows = position_rows(corrected, frame.positions, frame.t_s, self._settings.position_m)
        for reading, of_node in zip(frame.positions, rows.error.reshape(-1, 3), strict=True):
            self._before[reading.node] = (frame.t_s, of_node)

    def _is_in_sight(self, node: int, t_s: float) -> bool:
        return node in self._before and t_s - self._before[node][0] < READING_HOLDS_S


def _are_alike(news_m: NDArray[np.float64]) -> bool:
    """Return whether (nodes, 3) two vectors or more differ from their mean by less than `ALIKE` of it, rms."""
    mean_m = news_m.mean(axis=0)
    scatter_m = np.sqrt(np.mean(np.sum((news_m - mean_m) ** 2, axis=1)))
    return len(news_m) > 1 and bool(scatter_m < ALIKE * np.linalg.norm(mean_m))


def common_misfit(rows: Rows, covariance: NDArray[np.float64], moves_m: float) -> float:
    """Return e^T S^-1 e of the mean error e of some positions; if it is far above three, they are off alike.

    Args:
        rows: of these positions, one at least.
        covariance: (size, size) of the errors of the state.
        moves_m: standard deviation, per axis, of what the robot may move beside them.
    """
    count = len(rows.error) // 3
    mean = np.tile(np.eye(3), count) / count
    e, H = mean @ rows.error, mean @ rows.jacobian
    S = H @ covariance @ H.T + (mean * rows.variance) @ mean.T + moves_m**2 * np.eye(3)
    return float(squared_distance(e, S))
