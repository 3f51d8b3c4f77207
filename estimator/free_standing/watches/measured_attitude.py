"""Whether other sensors than those of tendons measure how a robot is turned."""

from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from ....models.pose.robot import FreeStandingRobot
from ....models.structure.rest_shape import RestShape
from ....models.values.aids import READING_HOLDS_S, ImuReading, PositionReading
from ....models.values.readings import TendonLengths

PARALLEL = 0.95
"""Cosine of the angle below which rods have different directions."""


class Attitude(Enum):
    """What other sensors than those of tendons tell of how a robot is turned."""

    UNKNOWN = auto()
    KNOWN_BUT_ONE_TURN = auto()
    """They do not tell the turn about one direction: that of parallel rods with sensors, or of a line of positions."""
    KNOWN = auto()


class MeasuredAttitude:
    """Tells it by which inertial sensors, and the positions of which nodes, were read in the last moments."""

    def __init__(self, rest: RestShape, robot: FreeStandingRobot) -> None:
        self._rest = rest
        self._rods = rest.structure.rods[[imu.rod for imu in robot.imus]].reshape(-1, 2)
        self._imu_s = -np.inf
        self._node_s: dict[int, float] = {}
        self.located_pairs = np.zeros((0, 2), dtype=np.int64)
        """(pairs, 2) the nodes whose positions were read, each with the first of them."""

    def observe(self, lengths: TendonLengths, used_imus: NDArray[np.bool_]) -> Attitude:
        """Return what they tell in one more frame.

        Args:
            lengths: with the readings of other sensors.
            used_imus: (imus,) which inertial sensors count.
        """
        if not used_imus.any():
            self._imu_s = -np.inf
        for reading in lengths.aids:
            if isinstance(reading, PositionReading):
                self._node_s[reading.node] = reading.t_s
            elif isinstance(reading, ImuReading) and used_imus[reading.imu]:
                self._imu_s = reading.t_s
        located = [node for node, latest_s in self._node_s.items() if lengths.t_s - latest_s < READING_HOLDS_S]
        self.located_pairs = np.array([(located[0], node) for node in located[1:]], dtype=np.int64).reshape(-1, 2)
        if lengths.t_s - self._imu_s >= READING_HOLDS_S and len(located) < 2:
            return Attitude.UNKNOWN
        pairs = np.concatenate([self._rods[used_imus], self.located_pairs])
        return Attitude.KNOWN_BUT_ONE_TURN if are_parallel(pairs, self._rest) else Attitude.KNOWN


def are_parallel(pairs: NDArray[np.int64], rest: RestShape) -> bool:
    """Return whether the lines between (pairs, 2) nodes, at least one, all have one direction in the rest shape."""
    a, b = pairs.T
    along = rest.node_position_m[b] - rest.node_position_m[a]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return len(along) > 0 and bool((np.abs(along @ along[0]) > PARALLEL).all())
