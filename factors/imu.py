"""Inertial sensors on rods: they tell how rods turn, how the robot is accelerated, and where gravity is.

A sensor has the attitude Q in the world, its rod the direction a + B m in the sensor's axes, with the axis a as told,
B two directions across it, and the misalignment m. It may be turned about the rod by any angle, and the rod may spin in
the structure. With a shape whose rod has the direction u in body axes, and the pose R,

    Q (a + B m) = R u                                  direction of the rod
    Q (f - b_f) = g z                                  gravity, in slow motion, with the specific force f
    w = b_w                                            at rest, with the rate w

How sensors and body turn and move between frames is in `estimator.free_standing.pose_motion`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..models.pose.imu_agreement import LEAST_M_PER_S2
from ..models.pose.imu_samples import ImuSamples
from ..models.pose.placed import PlacedShape, Rows, put_blocks
from ..models.pose.pose_settings import PoseSettings
from ..models.pose.pose_state import PoseState
from ..models.structure.floor import GRAVITY_M_PER_S2, UP
from ..models.values.aids import Imu
from ..models.values.rotations import across, cross_matrix

FAST_FORCE = 10.0
"""Growth of the sigma of gravity with the difference between the specific force and g."""
FAST_RATE_M_PER_S = 20.0
"""Growth of the same sigma with the rate of the rod."""
REST_RAD_PER_S = 0.01
"""Standard deviation of the rate of a rod at rest in a frame, such as the sway of a robot that hangs."""
SLOW_M_PER_S2 = 1.5
"""Sigma above which the specific force says nothing of gravity."""
LEAST_INCLINED = 0.3
"""Sine of the angle of a rod to the vertical below which gravity does not tell the turn about it: at 17 degrees,
offsets and the misalignment turn a sensor by 0.08 rad. A robot that hung from the end of an upright rod with a sensor
was estimated up to 230 mm beside its place."""


class ImuArray:
    """The inertial sensors of one robot."""

    def __init__(self, imus: Sequence[Imu], rods: NDArray[np.int64]) -> None:
        self.count = len(imus)
        self.axis = np.array([imu.axis for imu in imus]).reshape(-1, 3)
        self.ends = np.array([rods[imu.rod] for imu in imus], dtype=np.int64).reshape(-1, 2)
        self._fraction = np.array([imu.fraction for imu in imus]).reshape(-1, 1)
        self.across = np.linalg.svd(self.axis[:, :, None])[0][:, :, 1:] if imus else np.zeros((0, 3, 2))
        """(imus, 3, 2) B"""

    def direction(self, state: PoseState) -> NDArray[np.float64]:
        """Return (imus, 3), the direction of each sensor's rod in the world, as its attitude says."""
        in_sensor = self.axis + np.einsum("iab,ib->ia", self.across, state.misalignment)
        return np.asarray(np.einsum("iab,ib->ia", state.imu_turn, in_sensor))

    def rod_m(self, node_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (imus, 3), from the first to the second end of each sensor's rod, in the axes of (nodes, 3) nodes."""
        first, second = self.ends.T
        return np.asarray(node_m[second] - node_m[first])

    def rod_direction(self, node_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (imus, 3), the direction of each sensor's rod, in the axes of (nodes, 3) nodes."""
        rod_m = self.rod_m(node_m)
        return np.asarray(rod_m / np.linalg.norm(rod_m, axis=1, keepdims=True))

    def is_inclined(self, node_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (imus,) whether gravity tells the turns about their rods, with (nodes, 3) nodes in world axes."""
        upright = np.cross(self.rod_direction(node_m), UP)
        return np.asarray(np.linalg.norm(upright, axis=1) > LEAST_INCLINED)

    def inclination(self, samples: ImuSamples) -> NDArray[np.float64]:
        """Return (imus,) f . a / |f|, the sine of the angle of each rod to the horizontal, if its sensor is at rest."""
        force = samples.specific_force_m_per_s2
        size = np.maximum(np.linalg.norm(force, axis=1), LEAST_M_PER_S2)
        return np.asarray(np.sum(force * self.axis, axis=1) / size)

    def arm_m(self, arm_m: NDArray[np.float64], imus: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (3,), the mean place of some sensors, from (nodes, 3) places of the nodes."""
        first, second = self.ends[imus].T
        share = self._fraction[imus]
        return np.asarray(((1 - share) * arm_m[first] + share * arm_m[second]).mean(axis=0))

    def attitude_at_rest(
        self, rod_direction: NDArray[np.float64], specific_force: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (imus, 3, 3) Q, from (imus, 3) directions of the rods in the world and specific forces at rest."""
        return np.array(
            [
                _frame(direction, UP) @ _frame(axis, force).T
                for direction, axis, force in zip(rod_direction, self.axis, specific_force, strict=True)
            ]
        ).reshape(-1, 3, 3)

    def direction_rows(self, placed: PlacedShape, repeats: float, imus: NDArray[np.int64]) -> Rows:
        """Return two rows for each of some sensors: the direction of its rod in the shape, across the rod.

        Args:
            placed: the shape in the world.
            repeats: number of frames for which the error of the shape lasts.
            imus: the numbers of these sensors.
        """
        at = placed.state.layout
        first, second = self.ends[imus].T
        length_m = np.linalg.norm(self.rod_m(placed.arm_m)[imus], axis=1)
        u = self.rod_direction(placed.arm_m)[imus]
        d = self.direction(placed.state)[imus]
        E = across(u)
        rows = np.arange(2 * len(imus)).reshape(-1, 2)
        jacobian = np.zeros((rows.size, at.size))
        jacobian[:, at.turn] = (E @ cross_matrix(u)).reshape(-1, 3)
        put_blocks(jacobian, rows, at.of_imus(at.imu_turn)[imus], -E @ cross_matrix(d))
        by_misalignment = E @ placed.state.imu_turn[imus] @ self.across[imus]
        put_blocks(jacobian, rows, at.of_imus(at.misalignment)[imus], by_misalignment)
        c = placed.covariance_m2
        of_ends = c[first, first] + c[second, second] - c[first, second] - c[second, first]
        variance = np.sum(E @ of_ends * E, axis=2) / length_m[:, None] ** 2
        error = np.einsum("iab,ib->ia", E, u - d)
        return Rows(error.ravel(), jacobian, repeats * variance.ravel() + 1e-6)

    def gravity_rows(self, state: PoseState, samples: ImuSamples, settings: PoseSettings) -> Rows:
        """Return three rows for each sensor that moves slowly: its specific force is against gravity.

        They are linearised where it is, so that they say nothing of a turn about the vertical.
        """
        at = state.layout
        excess = samples.excess_m_per_s2
        rate = np.linalg.norm(samples.rate_rad_per_s - state.rate_bias_rad_per_s, axis=1)
        sigma = settings.force_m_per_s2 + FAST_FORCE * excess + FAST_RATE_M_PER_S * rate
        sigma = np.where(samples.count > 0, np.nan_to_num(sigma, nan=np.inf), np.inf)
        slow = np.flatnonzero(sigma < SLOW_M_PER_S2)
        turn = state.imu_turn[slow]
        force = np.einsum("iab,ib->ia", turn, samples.specific_force_m_per_s2[slow] - state.force_bias_m_per_s2[slow])
        rows = np.arange(3 * len(slow)).reshape(-1, 3)
        jacobian = np.zeros((rows.size, at.size))
        by_turn = np.broadcast_to(-cross_matrix(GRAVITY_M_PER_S2 * UP), (len(slow), 3, 3))
        put_blocks(jacobian, rows, at.of_imus(at.imu_turn)[slow], by_turn)
        put_blocks(jacobian, rows, at.of_imus(at.force_bias)[slow], -turn)
        error = GRAVITY_M_PER_S2 * UP - force
        return Rows(error.ravel(), jacobian, np.repeat(sigma[slow] ** 2, 3))

    def rest_rows(self, state: PoseState, samples: ImuSamples) -> Rows:
        """Return three rows for each sensor that was read at rest: its rate is its bias.

        About a rod that stands nearly upright nothing else tells the bias.
        """
        at, read = state.layout, np.flatnonzero(samples.count)
        error = samples.rate_rad_per_s[read] - state.rate_bias_rad_per_s[read]
        rows = np.arange(error.size).reshape(-1, 3)
        jacobian = np.zeros((error.size, at.size))
        put_blocks(jacobian, rows, at.of_imus(at.rate_bias)[read], np.broadcast_to(np.eye(3), (len(read), 3, 3)))
        return Rows(error.ravel(), jacobian, np.full(error.size, REST_RAD_PER_S**2))


def _frame(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3, 3), a right-handed frame with a first axis, and a second axis near another vector."""
    second = second - first * (first @ second)
    if np.linalg.norm(second) < 1e-3 * np.linalg.norm(first):
        second = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)
