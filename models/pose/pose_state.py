"""The state of the pose filter: where a free-standing structure is, and what its sensors are wrong by.

Nodes have body coordinates s, in the frame in which the shape fits the rest shape best. In the world a node is at

    x = p + R (s - c),    with c the centroid of the rest shape in body coordinates.

Errors of the state are vectors: rotations have errors in world axes, R_true = exp(d) R, all else is added.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..values.rotations import rotation, rotation_vector


class ErrorLayout:
    """The place of each part of the state in its vector of errors."""

    def __init__(self, nodes: int, imus: int, ranges: int, tilts: int, beacons: int, own_frames: int) -> None:
        self.turn = slice(0, 3)
        self.position = slice(3, 6)
        self.rate = slice(6, 9)
        self.velocity = slice(9, 12)
        self.foothold = slice(12, 12 + 2 * nodes)
        counts = [0, 3 * imus, 3 * imus, 3 * imus, 2 * imus, ranges, tilts, 3 * imus, beacons, 6 * own_frames]
        ends = self.foothold.stop + np.cumsum(counts)
        parts = [slice(int(start), int(stop)) for start, stop in pairwise(ends)]
        self.imu_turn, self.rate_bias, self.force_bias, self.misalignment = parts[:4]
        self.range_offset, self.floor_tilt, self.rate_scale, self.beacon_error, self.own_frame = parts[4:]
        self.considered = slice(self.rate_scale.start, self.own_frame.stop)
        """Errors that the filter considers, and leaves at zero."""
        self.size = int(ends[-1])
        self._imus = imus
        self.pose = slice(0, 6)

    def of_foothold(self, node: int) -> slice:
        """Return the place of the foothold of one node."""
        return slice(self.foothold.start + 2 * node, self.foothold.start + 2 * node + 2)

    def of_imu(self, part: slice, imu: int) -> slice:
        """Return the place of three numbers of one inertial sensor, in one of the parts that have three for each."""
        return slice(part.start + 3 * imu, part.start + 3 * imu + 3)

    def of_imus(self, part: slice) -> NDArray[np.int64]:
        """Return (imus, numbers) the places of the numbers of every inertial sensor, in one of their parts."""
        return np.arange(part.start, part.stop).reshape(self._imus, (part.stop - part.start) // max(self._imus, 1))

    def of_own_frame(self, number: int) -> slice:
        """Return the place of the six errors of one own frame."""
        return slice(self.own_frame.start + 6 * number, self.own_frame.start + 6 * number + 6)


layout_of = cache(ErrorLayout)
"""The layout of some numbers of parts; one object for all states."""


@dataclass(frozen=True, eq=False)
class PoseState:
    """Pose, motion, footholds, and errors of the sensors at one time."""

    turn: NDArray[np.float64]
    """(3, 3) R, from body to world."""
    position_m: NDArray[np.float64]
    """(3,) p, in the world."""
    rate_rad_per_s: NDArray[np.float64]
    """(3,) angular rate, in the world."""
    velocity_m_per_s: NDArray[np.float64]
    """(3,) of p, in the world."""
    foothold_m: NDArray[np.float64]
    """(nodes, 2) where each node stands, in coordinates of the floor; without meaning for nodes that do not stand."""
    imu_turn: NDArray[np.float64]
    """(imus, 3, 3) Q, from each sensor's axes to the world."""
    rate_bias_rad_per_s: NDArray[np.float64]
    """(imus, 3) in the sensor's axes."""
    force_bias_m_per_s2: NDArray[np.float64]
    """(imus, 3) in the sensor's axes."""
    misalignment: NDArray[np.float64]
    """(imus, 2) of the rod's direction in the sensor's axes, across it, in rad."""
    range_offset_m: NDArray[np.float64]
    """(pairs,) of each pair of beacon and node."""
    floor_tilt: NDArray[np.float64]
    """(2,) of the floor against its normal as told, see `models.structure.floor`; (0,) where that is exact."""
    rate_scale: NDArray[np.float64]
    """(imus, 3) k, the error of the rate in proportion to it, about each of the sensor's axes; considered."""
    beacon_error_m: NDArray[np.float64]
    """(beacons,) by how much all ranges of a beacon are too long; considered."""
    own_frame_error: NDArray[np.float64]
    """(own frames, 6) z, in standard deviations, see `OwnFrame`; considered."""

    @cached_property
    def layout(self) -> ErrorLayout:
        """The place of each part in a vector of errors."""
        return layout_of(
            nodes=len(self.foothold_m),
            imus=len(self.imu_turn),
            ranges=len(self.range_offset_m),
            tilts=len(self.floor_tilt),
            beacons=len(self.beacon_error_m),
            own_frames=len(self.own_frame_error),
        )

    def moved(self, error: NDArray[np.float64]) -> "PoseState":
        """Return the state with (size,) errors added."""
        at = self.layout
        turned = rotation(np.concatenate([error[at.turn], error[at.imu_turn]]).reshape(-1, 3))
        return replace(
            self,
            turn=turned[0] @ self.turn,
            position_m=self.position_m + error[at.position],
            rate_rad_per_s=self.rate_rad_per_s + error[at.rate],
            velocity_m_per_s=self.velocity_m_per_s + error[at.velocity],
            foothold_m=self.foothold_m + error[at.foothold].reshape(-1, 2),
            imu_turn=turned[1:] @ self.imu_turn,
            rate_bias_rad_per_s=self.rate_bias_rad_per_s + error[at.rate_bias].reshape(-1, 3),
            force_bias_m_per_s2=self.force_bias_m_per_s2 + error[at.force_bias].reshape(-1, 3),
            misalignment=self.misalignment + error[at.misalignment].reshape(-1, 2),
            range_offset_m=self.range_offset_m + error[at.range_offset],
            floor_tilt=self.floor_tilt + error[at.floor_tilt],
            rate_scale=self.rate_scale + error[at.rate_scale].reshape(-1, 3),
            beacon_error_m=self.beacon_error_m + error[at.beacon_error],
            own_frame_error=self.own_frame_error + error[at.own_frame].reshape(-1, 6),
        )

    def errors_to(self, other: "PoseState") -> NDArray[np.float64]:
        """Return the (size,) errors that, added to this state, give the other."""
        turns = np.concatenate([(other.turn @ self.turn.T)[None], other.imu_turn @ np.swapaxes(self.imu_turn, 1, 2)])
        vectors = rotation_vector(turns)
        return np.concatenate(
            [
                vectors[0],
                other.position_m - self.position_m,
                other.rate_rad_per_s - self.rate_rad_per_s,
                other.velocity_m_per_s - self.velocity_m_per_s,
                (other.foothold_m - self.foothold_m).ravel(),
                vectors[1:].ravel(),
                (other.rate_bias_rad_per_s - self.rate_bias_rad_per_s).ravel(),
                (other.force_bias_m_per_s2 - self.force_bias_m_per_s2).ravel(),
                (other.misalignment - self.misalignment).ravel(),
                other.range_offset_m - self.range_offset_m,
                other.floor_tilt - self.floor_tilt,
                (other.rate_scale - self.rate_scale).ravel(),
                other.beacon_error_m - self.beacon_error_m,
                (other.own_frame_error - self.own_frame_error).ravel(),
            ]
        )
