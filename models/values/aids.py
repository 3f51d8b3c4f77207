"""What a free-standing robot carries beside its tendons, and one reading of each."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .rotations import cross_matrix

READING_HOLDS_S = 0.2
"""Time for which a reading tells where the robot is, or how it is turned; without another, a sensor is silent then."""
DECIMALS = 4
"""Decimals of stamps in s, rates in rad/s and specific forces in m/s^2 in the files of a trial."""


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """An inertial sensor on a rod, which may be turned about the rod by any angle."""

    rod: int
    fraction: float
    """Place along the rod: 0 at its first node, 1 at its second."""
    axis: NDArray[np.float64]
    """(3,) unit vector along the rod, from its first node to its second, in the axes of the sensor."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuReading:
    """One sample of one inertial sensor."""

    imu: int
    t_s: float
    """On the host clock."""
    rate_rad_per_s: NDArray[np.float64]
    """(3,) angular rate in the axes of the sensor."""
    specific_force_m_per_s2: NDArray[np.float64]
    """(3,) acceleration minus gravity, in the axes of the sensor."""
    due_s: float = math.inf
    """When the next sample should have come, on the host clock; infinite while that is not known, see `ImuCadence`."""


@dataclass(frozen=True, slots=True, eq=False)
class RangeReading:
    """One distance between a beacon and a node."""

    t_s: float
    beacon_position_m: NDArray[np.float64]
    """(3,) in the world."""
    pair: tuple[int, int, int]
    """The numbers of the recording, the beacon and the node, which have an offset in common."""
    range_m: float

    @property
    def node(self) -> int:
        """The node."""
        return self.pair[2]


@dataclass(frozen=True, slots=True, eq=False)
class OwnFrame:
    """Where the own frame of a recording of positions is in the world, see `models.pose.position_frames`."""

    number: int
    """Among the own frames of a trial."""
    turn: NDArray[np.float64]
    """(3, 3) R, from the frame to the world."""
    origin_m: NDArray[np.float64]
    """(3,) of the frame, in the world."""
    pivot_m: NDArray[np.float64]
    """(3,) the point in the world about which the turn is wrong."""
    root: NDArray[np.float64]
    """(6, 6) L, with L L^T the covariance of the errors of turn and shift, in rad and m: they are L z, z ~ N(0, 1)."""

    def world_m(self, position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3) positions in the world, from those in the frame."""
        return np.asarray(self.origin_m + position_m @ self.turn.T)

    def jacobian(self, world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3, 6), the derivative of a position in the world by z."""
        return np.asarray(np.hstack([-cross_matrix(world_m - self.pivot_m), np.eye(3)]) @ self.root)

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(4,) x, y, z, w of the turn."""
        from scipy.spatial.transform import Rotation  # a tenth of a second, which an estimate does without

        return np.asarray(Rotation.from_matrix(self.turn).as_quat())

    @property
    def turn_sigma_rad(self) -> NDArray[np.float64]:
        """(3,) standard deviation of the turn about each axis of the world."""
        return np.asarray(np.linalg.norm(self.root[:3], axis=1))

    @property
    def origin_sigma_m(self) -> NDArray[np.float64]:
        """(3,) standard deviation of the origin."""
        return np.asarray(np.linalg.norm(self.jacobian(self.origin_m), axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class PositionReading:
    """The position of one node."""

    t_s: float
    node: int
    position_m: NDArray[np.float64]
    """(3,) in the world; as recorded, in the frame of its recording."""
    recording: int = 0
    """Number of the recording."""
    frame: OwnFrame | None = None
    """The frame from which it was placed in the world; None where it was measured there."""


AidReading = ImuReading | RangeReading | PositionReading
"""One reading of what a free-standing robot carries beside its tendons."""
