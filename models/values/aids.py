"""What a free-standing robot carries beside its tendons, and one reading of each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
class PositionReading:
    """The position of one node in the world."""

    t_s: float
    node: int
    position_m: NDArray[np.float64]
    """(3,)"""
    recording: int = 0
    """Number of the recording."""


AidReading = ImuReading | RangeReading | PositionReading
"""One reading of what a free-standing robot carries beside its tendons."""
