"""Whether other sensors than those of tendons measure how a robot is turned."""

import numpy as np
from numpy.typing import NDArray

from ....models.pose.imu_gate import ATTITUDE_HOLDS_S
from ....models.structure.rest_shape import RestShape
from ....models.values.aids import ImuReading, PositionReading
from ....models.values.readings import TendonLengths

PARALLEL = 0.95
"""Cosine of the angle below which rods have different directions."""


class MeasuredAttitude:
    """Tells whether an inertial sensor, or the positions of two nodes or more, were read in the last moments."""

    def __init__(self) -> None:
        self._imu_s = -np.inf
        self._node_s: dict[int, float] = {}
        self.located_pairs = np.zeros((0, 2), dtype=np.int64)
        """(pairs, 2) the nodes whose positions were read, each with the first of them."""

    def observe(self, lengths: TendonLengths, used_imus: NDArray[np.bool_]) -> bool:
        """Return whether they were, in one more frame.

        Args:
            lengths: with the readings of other sensors.
            used_imus: (imus,) which inertial sensors count.
        """
        for reading in lengths.aids:
            if isinstance(reading, PositionReading):
                self._node_s[reading.node] = reading.t_s
            elif isinstance(reading, ImuReading) and used_imus[reading.imu]:
                self._imu_s = reading.t_s
        located = [node for node, latest_s in self._node_s.items() if lengths.t_s - latest_s < ATTITUDE_HOLDS_S]
        self.located_pairs = np.array([(located[0], node) for node in located[1:]], dtype=np.int64).reshape(-1, 2)
        return lengths.t_s - self._imu_s < ATTITUDE_HOLDS_S or len(located) > 1


def are_parallel(pairs: NDArray[np.int64], rest: RestShape) -> bool:
    """Return whether the lines between (pairs, 2) nodes, at least one, all have one direction in the rest shape."""
    a, b = pairs.T
    along = rest.node_position_m[b] - rest.node_position_m[a]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return len(along) > 0 and bool((np.abs(along @ along[0]) > PARALLEL).all())
