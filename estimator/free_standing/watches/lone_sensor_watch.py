"""Whether a lone inertial sensor has lost the robot: it does not tell the turn about its rod, in a tip or a roll.

Tendons hold a rod in the structure so that it spins little, but a sensor on it, or several on parallel rods, tell the
direction of the rod alone where it does. The rest is told by the nodes that stand, as long as these are the right ones.
They are wrong where the floor contradicts the pose. Of the height e of the standing node that is furthest from the
floor, after the correction, over its standard deviation by shape and floor, the mean square of the last
`FLOOR_MEMORY_S` is then above `FLOOR_CONTRADICTS` while the rod turns. A robot that does not turn may be lifted, which
the sensor feels.

Then the sensor is lost, as one that was silent: the robot is followed without it, in doubt, until it rests on a face
that forces tell.
"""

import numpy as np
from numpy.typing import NDArray

from ....factors.imu import ImuArray
from ....models.pose.imu_samples import ImuSamples
from ....models.pose.placed import PlacedShape
from ....models.structure.floor import Floor
from ....models.values.time_series import low_pass_weight
from ..tipping import TIPS_RAD_PER_S

FLOOR_MEMORY_S = 0.1
"""Time constant of the mean square: feet that strike the floor contradict the pose for a frame or two."""
FLOOR_CONTRADICTS = 25.0
"""The mean square: below 20 in tips onto the next face, 26 to 79 in those that were lost."""


class LoneSensorWatch:
    """Follows the rate of sensors and the heights of the nodes that stand, frame by frame.

    Args:
        imus: all inertial sensors of the robot.
        floor_m: standard deviation of the height of a node that stands, as `PoseSettings.floor_m`.
    """

    def __init__(self, imus: ImuArray, floor_m: float) -> None:
        self._imus = imus
        self._floor_m = floor_m
        self._mean_square = 0.0

    def observe(
        self,
        placed: PlacedShape,
        floor: Floor,
        stands: NDArray[np.bool_],
        samples: ImuSamples,
        used: NDArray[np.bool_],
        step_s: float,
    ) -> bool:
        """Return whether the sensors that are used have lost the robot, if they do not tell the turn about their rods.

        Args:
            placed: the shape in the world, corrected.
            floor: the floor.
            stands: (nodes,) which nodes stand, at least one.
            samples: of the sensors in the frame.
            used: (imus,) which sensors are used.
            step_s: time since the frame before.
        """
        above_m = floor.clearance_m(placed.node_position_m)[stands]
        variance = np.diag(placed.height_covariance_m2(floor.normal))[stands] + self._floor_m**2
        squared = float((above_m**2 / variance).max())
        self._mean_square += float(low_pass_weight(step_s, FLOOR_MEMORY_S)) * (squared - self._mean_square)
        across = np.cross(self._imus.axis, samples.rate_rad_per_s)[used]
        rate_rad_per_s = float(np.linalg.norm(across, axis=1).max())
        return rate_rad_per_s > TIPS_RAD_PER_S and self._mean_square > FLOOR_CONTRADICTS
