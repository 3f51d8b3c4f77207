"""Whether feet that should stand slide or leave the floor, which inertial sensors feel while the filter holds them.

Slides are found by a second estimate of the pose, which footholds do not hold, and rises by a second height.

A slow slide of all feet moves the robot by less in one frame than the shape is wrong by, and footholds would hold it
back for ever. Inertial sensors feel it: beside the filter runs a copy without footholds, for up to `WATCH_S`. With its
error e of a foothold and the covariance S of it, the node slides if e^T S^-1 e is too large. The filter then takes the
copy over, and the node has no foothold until it is slow: with the velocity v, of covariance S_v,

    v^T v < s^2 + tr S_v

A robot that is lifted rises. The mean point of the sensors has the height h, as the filter holds it, and the specific
force f in the axes of the world. From a moment in which it is still, without the floor, it has the velocity v and the
height z along the normal n,

    v <- v + (n . f - g n_z) dt,     z <- z + v dt

The robot is lifted if z - h is above `LIFTED_M` and above `LIFTED_SIGMA` standard deviations of it, by the noise of the
force, its bias, and the velocity at the start. After a shock, which may be beyond the range of the sensors, nothing is
told until it is still again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...factors.imu import ImuArray, ImuSamples
from ...models.pose.placed import PlacedShape
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from ...models.values.rotations import cross, cross_matrix
from .contacts import LIFTED_M, LIFTED_SIGMA
from .imu_trust import move_slowly
from .pose_motion import force_sigma_m_per_s2

WATCH_S = 0.3
"""Time after which the copy starts again: over a longer one, inertial sensors do not tell a slide of millimetres."""
LOST_M = 0.005
"""Standard deviation, per axis, of what a robot has slid before the copy started: by less than is found."""
WITH_IT_SIGMA = 2.0
"""Distance from its foothold, in standard deviations, from which a node slides too when another one does."""
REST_M_PER_S = 0.05
"""Speed s below which a foot that slid stands again: friction stops it within a frame or two."""
RISE_WATCH_S = 1.0
"""Time after which the watch starts again: the bias of the force is a centimetre then."""
STARTS_M_PER_S = 0.01
"""Standard deviation of the velocity of a robot that is still."""
CALM_M_PER_S2 = 3.0
"""Difference of a specific force from g that is no shock: a hand lifts by less, and feet that land strike by more."""


@dataclass(frozen=True, slots=True, eq=False)
class UnheldPose:
    """The estimate of the pose without footholds."""

    since_s: float
    """When it was that of the filter."""
    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size) of its errors."""
    turn_before: NDArray[np.float64]
    """(3, 3) the turn in the frame before."""


def at_rest(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> NDArray[np.bool_]:
    """Return (nodes,) which nodes may be at rest along the floor, by the velocity of the body.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor.
    """
    state, at = placed.state, placed.state.layout
    v = (state.velocity_m_per_s + cross(state.rate_rad_per_s, placed.arm_m)) @ floor.axes.T
    jacobian = np.zeros((len(v), 2, at.size))
    jacobian[:, :, at.velocity] = floor.axes
    jacobian[:, :, at.rate] = -floor.axes @ cross_matrix(placed.arm_m)
    variance = np.einsum("kai,ij,kaj->k", jacobian, covariance, jacobian)
    return np.asarray(np.sum(v**2, axis=1) < REST_M_PER_S**2 + variance)


def slid_before(since_s: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames, nodes) which nodes slide in each frame, given the slides that later frames have found.

    Args:
        since_s: (frames, nodes) since when a node slides, see `PoseStep.slides_since_s`.
        t_s: (frames,) time of each frame.
    """
    slides = np.zeros(since_s.shape, dtype=np.bool_)
    for k, node in np.argwhere(np.isfinite(since_s)):
        slides[np.searchsorted(t_s, since_s[k, node], side="right") : k + 1, node] = True
    return slides


def is_still(samples: ImuSamples) -> bool:
    """Return whether all sensors that were read in a frame, one at least, neither turn nor are accelerated."""
    slow = move_slowly(samples)[samples.count > 0]
    return bool(len(slow) and slow.all())


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
        self._sensors = np.zeros(0, dtype=np.int64)
        self._told = np.zeros(2)
        self._noise = np.zeros((2, 2))
        self._by_bias = np.zeros(2)

    def observe(
        self, t_s: float, step_s: float, placed: PlacedShape, covariance: NDArray[np.float64], samples: ImuSamples
    ) -> Rise | None:
        """Return the rise that one more frame has told; None while the robot may be where the filter holds it.

        Args:
            t_s: time of the frame.
            step_s: time since the frame before.
            placed: the shape in the world, as the floor holds it.
            covariance: (size, size) of the errors of its state.
            samples: of the sensors that are used.
        """
        sensors = np.flatnonzero(samples.count)
        excess = samples.excess_m_per_s2[sensors]
        if not len(sensors) or (excess > CALM_M_PER_S2).any() or not np.array_equal(sensors, self._sensors):
            self.forget()
            self._sensors = sensors
            return None
        held = self._held(placed, sensors)
        if t_s - self._since_s > RISE_WATCH_S:
            if is_still(samples):
                self._start(t_s, held)
            return None
        sigma = force_sigma_m_per_s2(excess, self._settings)
        variance = self._move(step_s, placed, covariance, samples, sigma)
        way = self._told - held
        if way[0] < max(LIFTED_M, LIFTED_SIGMA * float(np.sqrt(variance[0, 0]))):
            return None
        return Rise(self._since_s, way, variance)

    def forget(self) -> None:
        """Start again when the robot is still."""
        self._since_s = -np.inf

    def _held(self, placed: PlacedShape, sensors: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (2,) the height of the mean point of some sensors and its velocity, as the filter says."""
        state = placed.state
        arm_m = self._imus.arm_m(placed.arm_m, sensors)
        velocity = state.velocity_m_per_s + np.cross(state.rate_rad_per_s, arm_m)
        return np.array([self._normal @ (state.position_m + arm_m), self._normal @ velocity])

    def _start(self, t_s: float, held: NDArray[np.float64]) -> None:
        self._since_s, self._told = t_s, np.array([held[0], 0.0])
        self._noise = np.diag([self._settings.floor_m**2, STARTS_M_PER_S**2])
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
