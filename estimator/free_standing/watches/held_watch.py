"""Whether a hand holds a lifted robot still, and whether it has come down since it was lifted.

Specific forces tell the velocity with an error that grows, and with it the place. Where the sensors are still for
`RISE_WATCH_S`, and the velocity changes by `STEADY_M_PER_S` at most and is zero within `RESTS_SIGMA` meanwhile, the
robot is at rest:

    v = 0, within `STARTS_M_PER_S`

The sensors of a robot that a hand carries slowly measure what they measure at rest, for a second and more in the middle
of its way: only the velocity tells that it is not, as far as it is known. No hand carries it so for `PUT_DOWN_S`: after
that, it is at rest even where the velocity seemed to be another.

It has come down if the velocity along the normal was below zero by `RESTS_SIGMA` standard deviations; a hand that sets
it down more slowly than that is not felt, so that it may stand where it has been still for `PUT_DOWN_S`, too.
"""

import numpy as np
from numpy.typing import NDArray

from ....models.pose.imu_samples import ImuSamples
from ....models.pose.placed import Rows
from ....models.pose.pose_state import PoseState
from ....models.values.chi_squared import squared_distance
from ..imu_trust import is_still
from .rise_watch import RESTS_SIGMA, RISE_WATCH_S, STARTS_M_PER_S
from .stand_watch import PUT_DOWN_S

STEADY_M_PER_S = 0.05
"""Change of the velocity that an attitude which is wrong by 0.3 degrees makes in a second."""


class HeldWatch:
    """Follows a robot in the air, frame by frame."""

    def __init__(self) -> None:
        self.lift()

    @property
    def has_come_down(self) -> bool:
        """Whether it may stand again, if it seems to be at the floor."""
        return self._has_sunk or self._steady_s > PUT_DOWN_S

    def lift(self) -> None:
        """Take note that the robot stands, or is lifted now."""
        self._has_sunk = False
        self.move()

    def move(self) -> None:
        """Take note that the robot in the air moves, or may, as where no sensor is read."""
        self._steady_s = 0.0
        self._may_rest = True
        self._gained_m_per_s = np.zeros(3)

    def observe(
        self,
        step_s: float,
        before: PoseState,
        state: PoseState,
        covariance: NDArray[np.float64],
        samples: ImuSamples,
        normal: NDArray[np.float64],
    ) -> None:
        """Learn from one more frame in the air.

        Args:
            step_s: time since the frame before.
            before: the state in that frame.
            state: the state, moved as the sensors say.
            covariance: (size, size) of its errors.
            samples: of the inertial sensors that are used.
            normal: (3,) of the floor.
        """
        of_velocity = covariance[state.layout.velocity, state.layout.velocity]
        sigma_m_per_s = float(np.sqrt(normal @ of_velocity @ normal))
        self._may_rest &= bool(squared_distance(state.velocity_m_per_s, of_velocity) < RESTS_SIGMA**2)
        self._has_sunk |= float(normal @ state.velocity_m_per_s) < -RESTS_SIGMA * sigma_m_per_s
        self._steady_s += step_s
        self._gained_m_per_s = self._gained_m_per_s + state.velocity_m_per_s - before.velocity_m_per_s
        if not is_still(samples) or float(np.linalg.norm(self._gained_m_per_s)) > STEADY_M_PER_S:
            self.move()

    def rows(self, state: PoseState, step_s: float) -> list[Rows]:
        """Return the rows of the velocity of a robot that is held still: the error of one lasts for all frames."""
        if self._steady_s < (RISE_WATCH_S if self._may_rest else PUT_DOWN_S):
            return []
        jacobian = np.zeros((3, state.layout.size))
        jacobian[:, state.layout.velocity] = np.eye(3)
        variance = np.full(3, STARTS_M_PER_S**2 * RISE_WATCH_S / step_s)
        return [Rows(-state.velocity_m_per_s, jacobian, variance)]
