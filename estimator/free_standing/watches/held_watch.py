"""Whether a hand holds the robot still in the air, or it stands again without having been found to.

Specific forces tell the velocity with an error that grows, and with it the place. The sensors of a robot that moves
steadily measure what they measure at rest, but no hand carries it so for long: where they are still for
`RISE_WATCH_S`, and the velocity changes by `STEADY_M_PER_S` at most meanwhile, the robot is at rest:

    v = 0, within `STARTS_M_PER_S`
"""

import numpy as np
from numpy.typing import NDArray

from ....models.pose.imu_samples import ImuSamples
from ....models.pose.placed import Rows
from ....models.pose.pose_state import PoseState
from ..imu_trust import is_still
from .rise_watch import RISE_WATCH_S, STARTS_M_PER_S

STEADY_M_PER_S = 0.05
"""Change of the velocity that an attitude which is wrong by 0.3 degrees makes in a second."""


class HeldWatch:
    """Follows how long the robot has been still in the air, frame by frame."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Take note that the robot stands, or that no sensor tells how it moves."""
        self._steady_s = 0.0
        self._gained_m_per_s = np.zeros(3)

    def observe(self, step_s: float, gained_m_per_s: NDArray[np.float64], samples: ImuSamples) -> None:
        """Learn from one more frame in the air.

        Args:
            step_s: time since the frame before.
            gained_m_per_s: (3,) change of the velocity since then, by the sensors.
            samples: of the inertial sensors that are used.
        """
        self._steady_s += step_s
        self._gained_m_per_s = self._gained_m_per_s + gained_m_per_s
        if not is_still(samples) or float(np.linalg.norm(self._gained_m_per_s)) > STEADY_M_PER_S:
            self.forget()

    def rows(self, state: PoseState, step_s: float) -> list[Rows]:
        """Return the rows of the velocity of a robot that is held still: the error of one lasts for all frames."""
        if self._steady_s < RISE_WATCH_S:
            return []
        jacobian = np.zeros((3, state.layout.size))
        jacobian[:, state.layout.velocity] = np.eye(3)
        variance = np.full(3, STARTS_M_PER_S**2 * RISE_WATCH_S / step_s)
        return [Rows(-state.velocity_m_per_s, jacobian, variance)]
