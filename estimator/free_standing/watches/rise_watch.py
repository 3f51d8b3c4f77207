"""Whether the robot leaves the floor, which inertial sensors feel while the floor holds the pose down.

A robot that is lifted rises. The mean point of the sensors that are read in a frame has the height h, as the filter
holds it, and the specific force f in the axes of the world. From a moment in which it is still, without the floor, it
has the velocity v and the height z along the normal n,

    a = n . f - g n_z,     z <- z + v dt + a dt^2 / 2,     v <- v + a dt

The robot is lifted if z - h is above `LIFTED_M`, and either it or v above `LIFTED_SIGMA` standard deviations, by the
noise of the force, its bias, and the velocity at the start; while nothing carries it, v alone tells it. Where positions
or ranges have told that it is above the floor, it has risen as the sensors say: the floor held it down until then.

After `RISE_WATCH_S` the watch starts again as soon as the robot is still and |v| is at most `RESTS_SIGMA` standard
deviations of it: the sensors of a robot that rises steadily measure what they measure at rest. After a shock, which may
be beyond the range of the sensors, the watch waits until the robot is still, and starts once more after `SETTLES_S`, as
the floor tells its velocity better by then. What is a shock depends on whether the robot has rested, for `SETTLES_S`,
since the watch was last forgotten: a hand that throws the robot accelerates it as much as feet do that strike the
floor, so that more than `CALM_M_PER_S2` is followed only from rest. What accelerates a robot that rises from rest
already, by `LIFTED_SIGMA` standard deviations of v, is no floor. While samples of one of several sensors are missing,
the others are followed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....factors.imu import ImuArray
from ....models.pose.imu_samples import ImuSamples
from ....models.pose.placed import PlacedShape
from ....models.pose.pose_settings import PoseSettings
from ....models.pose.pose_state import PoseState
from ....models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from ..contacts import LIFTED_M, LIFTED_SIGMA
from ..imu_trust import is_still
from ..pose_motion import SHOCK_M_PER_S2, force_sigma_m_per_s2
from .stand_watch import SETTLES_S

RISE_WATCH_S = 1.0
"""Time after which the watch starts again, as the bias of the force has moved the point by a centimetre then. No hand
that sets a robot down is steady for so long: a robot that is still for longer while it stands is at rest."""
RESTS_SIGMA = 2.0
"""Velocity, in its standard deviations, up to which a robot that is still is at rest."""
STARTS_M_PER_S = 0.01
"""Standard deviation of the velocity of a robot that is still."""
CALM_M_PER_S2 = 3.0
"""Largest difference of a specific force from g that is no shock, where the robot has not rested before: feet that
strike the floor make more. Where it has, it is `SHOCK_M_PER_S2`."""


@dataclass(frozen=True, slots=True, eq=False)
class Rise:
    """How the sensors say that the robot has risen, beyond what the filter says."""

    since_s: float
    """When it stood at the latest."""
    way: NDArray[np.float64]
    """(2,) the height z - h in m, and its velocity in m/s."""
    covariance: NDArray[np.float64]
    """(2, 2) of both."""


class RiseWatch:
    """Follows how far the sensors say that the robot has risen, frame by frame."""

    def __init__(self, imus: ImuArray, floor: Floor, settings: PoseSettings) -> None:
        self._imus = imus
        self._normal = floor.normal
        self._settings = settings
        self._since_s = -np.inf
        self._still_s = 0.0
        self._has_rested = False
        self._rises = False
        self._sensors = np.zeros(0, dtype=np.int64)
        self._told = np.zeros(2)
        self._noise = np.zeros((2, 2))
        self._by_bias = np.zeros(2)

    def observe(
        self,
        t_s: float,
        step_s: float,
        placed: PlacedShape,
        covariance: NDArray[np.float64],
        samples: ImuSamples,
        *,
        flies: bool,
        is_above: bool,
    ) -> Rise | None:
        """Return the rise that one more frame has told; None while the robot may be where the filter holds it.

        Args:
            t_s: time of the frame.
            step_s: time since the frame before.
            placed: the shape in the world, as the floor holds it.
            covariance: (size, size) of the errors of its state.
            samples: of the sensors that are used.
            flies: whether nothing carries the robot, which may bounce: then the velocity alone may tell the rise.
            is_above: whether positions or ranges have told that it is above the floor.
        """
        sensors = np.flatnonzero(samples.count)
        has_settled = self._has_settled(step_s, samples)
        if not self._is_followed(samples, sensors):
            self.forget(self._still_s)
            return None
        held, held_m_per_s = self._held(placed, sensors), self._held_m_per_s(placed, covariance)
        if not np.isfinite(self._since_s):
            self._sensors = sensors
            if is_still(samples):
                self._start(t_s, held, STARTS_M_PER_S if self._has_rested else held_m_per_s)
            return None
        if not np.array_equal(sensors, self._sensors):
            self._told += held - self._held(placed, self._sensors)
            self._sensors = sensors
        sigma = force_sigma_m_per_s2(samples, sensors, self._settings)
        variance = self._move(step_s, placed, covariance, samples, sigma)
        m_per_s = float(np.sqrt(variance[1, 1]))
        speed_m_per_s = abs(self._told[1])
        self._rises = self._has_rested and bool(self._told[1] > LIFTED_SIGMA * m_per_s)
        if t_s - self._since_s > RISE_WATCH_S and is_still(samples) and speed_m_per_s <= RESTS_SIGMA * m_per_s:
            self._start(t_s, held, STARTS_M_PER_S)
            return None
        if has_settled and speed_m_per_s <= RESTS_SIGMA * held_m_per_s < m_per_s:
            self._start(t_s, held, held_m_per_s)  # the floor has told its velocity since the shock
            return None
        way = self._told - held
        has_risen = self._has_risen(way[0], variance, flies=flies)
        if not has_risen and not is_above:
            return None
        return Rise(self._since_s if has_risen else t_s, way, variance)

    def _has_settled(self, step_s: float, samples: ImuSamples) -> bool:
        """Return whether the robot has been still for `SETTLES_S` with this frame, for the first time."""
        self._still_s = self._still_s + step_s if is_still(samples) else 0.0
        has_settled = self._still_s > SETTLES_S and not self._has_rested
        self._has_rested |= has_settled
        return has_settled

    def _is_followed(self, samples: ImuSamples, sensors: NDArray[np.int64]) -> bool:
        """Return whether sensors feel no shock, and all others that were followed are missing.

        One that is trusted no more has told what is not true.
        """
        calm = samples.excess_m_per_s2[sensors] <= (SHOCK_M_PER_S2 if self._has_rested else CALM_M_PER_S2)
        if not len(sensors) or not (calm.all() or self._rises):
            return False
        gone = np.setdiff1d(self._sensors, sensors)
        return not np.isfinite(self._since_s) or bool(samples.are_missing[gone].all())

    def _has_risen(self, height_m: float, variance: NDArray[np.float64], *, flies: bool) -> bool:
        """Return whether the height z - h, or the velocity v, is more than (2, 2) their covariance allows."""
        sigma_m, sigma_m_per_s = np.sqrt(np.diagonal(variance))
        is_high, is_fast = height_m >= LIFTED_M, self._told[1] > LIFTED_SIGMA * sigma_m_per_s
        return bool((is_high and (is_fast or height_m >= LIFTED_SIGMA * sigma_m)) or (flies and is_fast))

    def forget(self, still_s: float = 0.0) -> None:
        """Start again when the robot is still.

        Args:
            still_s: for how long it has been still; inf where it is known to be at rest.
        """
        self._since_s = -np.inf
        self._has_rested = self._rises = False
        self._still_s = still_s

    def _held(self, placed: PlacedShape, sensors: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (2,) the height of the mean point of some sensors and its velocity, as the filter says."""
        state = placed.state
        arm_m = self._imus.arm_m(placed.arm_m, sensors)
        velocity = state.velocity_m_per_s + np.cross(state.rate_rad_per_s, arm_m)
        return np.array([self._normal @ (state.position_m + arm_m), self._normal @ velocity])

    def _held_m_per_s(self, placed: PlacedShape, covariance: NDArray[np.float64]) -> float:
        """Return the standard deviation of the velocity, as the filter says, of a robot that may have come down."""
        velocity = placed.state.layout.velocity
        return max(STARTS_M_PER_S, float(np.sqrt(self._normal @ covariance[velocity, velocity] @ self._normal)))

    def _start(self, t_s: float, held: NDArray[np.float64], sigma_m_per_s: float) -> None:
        self._since_s, self._told = t_s, np.array([held[0], 0.0])
        self._noise = np.diag([self._settings.floor_m**2, sigma_m_per_s**2])
        self._by_bias = np.zeros(2)

    def _move(
        self,
        step_s: float,
        placed: PlacedShape,
        covariance: NDArray[np.float64],
        samples: ImuSamples,
        sigma_m_per_s2: float,
    ) -> NDArray[np.float64]:
        """Move the point by the specific forces of a frame; return (2, 2) the covariance of its height and velocity."""
        state, at, sensors = placed.state, placed.state.layout, self._sensors
        share = self._normal @ state.imu_turn[sensors] / len(sensors)
        force = samples.specific_force_m_per_s2[sensors] - state.force_bias_m_per_s2[sensors]
        accelerated = float(np.sum(share * force) - GRAVITY_M_PER_S2 * self._normal @ UP)
        F = np.array([[1.0, step_s], [0.0, 1.0]])
        by_force = np.array([step_s**2 / 2, step_s])
        self._told = F @ self._told + by_force * accelerated
        self._noise = F @ self._noise @ F.T + sigma_m_per_s2**2 * np.outer(by_force, by_force)
        self._by_bias = F @ self._by_bias + by_force
        bias = at.of_imus(at.force_bias)[sensors].ravel()
        of_bias = float(share.ravel() @ covariance[np.ix_(bias, bias)] @ share.ravel())
        return np.asarray(self._noise + of_bias * np.outer(self._by_bias, self._by_bias))


def risen(
    state: PoseState, covariance: NDArray[np.float64], rise: Rise, floor: Floor
) -> tuple[PoseState, NDArray[np.float64]]:
    """Return a state and (size, size) the covariance of its errors after a rise along the floor's normal."""
    at, n = state.layout, floor.normal
    G = np.zeros((at.size, 2))
    G[at.position, 0] = G[at.velocity, 1] = n
    return state.moved(G @ rise.way), covariance + G @ rise.covariance @ G.T
