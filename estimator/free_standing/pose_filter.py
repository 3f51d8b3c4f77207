"""The pose of a free-standing structure: an error-state Kalman filter, and its smoother.

The shape is estimated in body coordinates, where lengths and forces need no base. The filter places it in the world:
between frames the body moves at constant rate and velocity, or as inertial sensors say; in each frame the rows of all
aids (floor, footholds, rods with sensors, gravity, ranges, positions) correct the state,

    S = H P H^T + V,   K = P H^T S^-1,   d = K e,   P <- P - K S K^T

Batch runs the same filter and then the smoother of Rauch, Tung and Striebel over its steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...factors.ground import foothold_rows, height_rows, rolled_on_floor_m
from ...factors.imu import ImuArray, ImuSamples
from ...factors.position import position_rows
from ...factors.range import range_rows
from ...models.pose.placed import PlacedShape, Rows, stacked
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import FreeStandingRobot
from ...models.structure.rest_shape import RestShape
from ...models.values.aids import AidReading, ImuReading, PositionReading, RangeReading
from ...models.values.rotations import rotation, rotation_vector, shortest_rotation
from .contacts import ContactsByHeight, Standing
from .imu_trust import ImuTrust
from .pose_motion import PoseMotion

STILL = 1e-3
"""Standard deviation of all motion while the structure stands at rest at the start, in rad and m and per second."""
LANDED_M = 0.015
"""Height above the floor at which a node cannot stand: the structure has tipped further than was predicted."""
LANDING_RAD = 0.1
"""Standard deviation of the turn, beside the shortest one onto the face that stands."""
LANDING_M = 0.01
"""Standard deviation of the motion, beside that turn about the nodes that have stayed."""
UNSEEN_SLIP = 4.0
"""Factor of the variance by which nodes slip while the structure tips unseen: the way of its caps is unknown."""
MISSED_RAD = 0.3
"""Heading that the shortest turn misses, above which the pose before it was wrong."""
LEAP_RAD = 0.8
"""Standard deviation of the turn when no node has stayed: the robot has rolled over several faces."""
LEAP_M = 0.25
"""Standard deviation of the motion when no node has stayed."""
LOCATED_S = 0.2
"""Time for which a position or a range tells where the robot is."""
BELOW_M = 0.001
"""Depth below the floor at which a node that does not stand is lifted to it."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStep:
    """One step of the filter, as the smoother needs it."""

    transition: NDArray[np.float64]
    """(size, size) F, from the errors of the step before."""
    predicted: PoseState
    predicted_covariance: NDArray[np.float64]
    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size)"""
    standing: Standing
    """Which nodes stand."""
    trusts_imus: bool
    """Whether all inertial sensors agree with the inclination of their rods."""


class PoseFilter:
    """Follows the pose, frame by frame."""

    def __init__(
        self,
        rest: RestShape,
        robot: FreeStandingRobot,
        settings: PoseSettings,
    ) -> None:
        self._settings = settings
        self._floor = robot.floor
        self._rest = rest
        self._rest_seconds = robot.rest_seconds
        self._imus = ImuArray(robot.imus, rest.structure.rods)
        self._motion = PoseMotion(self._imus, settings)
        self._number_of_pair = {pair: number for number, pair in enumerate(robot.range_pairs)}
        self.centre_m = rest.node_position_m.mean(axis=0)
        """(3,) c, the origin of body coordinates."""
        self.state = self._start(len(robot.imus), len(robot.range_pairs))
        self.covariance = self._start_covariance()
        self._standing = robot.floor.carries_at_rest(rest.node_position_m)
        self._contacts = ContactsByHeight(robot.floor, self._standing, settings)
        self._samples: ImuSamples | None = None
        self._turn_before = self.state.turn
        self._body_before_m = rest.node_position_m - self.centre_m
        self._last_s = np.nan
        self._located_s = -np.inf
        self._trust = ImuTrust(self._imus.count)

    def step(
        self,
        t_s: float,
        body_m: NDArray[np.float64],
        body_covariance_m2: NDArray[np.float64],
        aids: Sequence[AidReading],
        standing: Standing | None = None,
    ) -> PoseStep:
        """Return the state in one more frame.

        Args:
            t_s: time of the frame.
            body_m: (nodes, 3) the shape, in body coordinates.
            body_covariance_m2: (3 nodes, 3 nodes) its covariance.
            aids: the readings since the frame before.
            standing: which nodes stand; None to tell it from heights.
        """
        step_s = t_s - self._last_s if np.isfinite(self._last_s) else 0.02
        samples = self._imu_samples(aids)
        body_m = body_m - self.centre_m
        transition, state, covariance = self._predict(step_s, samples, body_m)
        placed = PlacedShape(state, body_m, body_covariance_m2)
        if standing is None:
            located = any(isinstance(reading, PositionReading | RangeReading) for reading in aids)
            self._located_s = t_s if located else self._located_s
            is_located = t_s - self._located_s < LOCATED_S
            standing = self._contacts.observe(placed, covariance, step_s, is_located=is_located)
        else:
            self._contacts.stand_on(standing.nodes)
        stood, self._standing = self._standing, standing.nodes
        kept = standing.nodes & stood
        if self._landed(placed, standing.nodes & ~stood):
            transition, placed, covariance = self._tipped(placed, transition, covariance, standing.nodes, kept)
        slipped = self._slipped(placed, covariance, kept)
        put_down = (standing.nodes & ~stood) | slipped
        transition, placed, covariance = self._put_down(placed, transition, covariance, put_down)
        predicted = (placed.state, covariance)
        rows = self._rows(placed, covariance, t_s, step_s, aids, samples, kept & ~slipped)
        rows += self._held_rows(placed, covariance, step_s)
        self._turn_before = self.state.turn
        self.state, self.covariance = _corrected(placed.state, covariance, stacked(rows))
        self._body_before_m = body_m
        self._samples = samples
        self._last_s = t_s
        trusts_imus = bool(self._trust.is_trusted.all())
        return PoseStep(transition, *predicted, self.state, self.covariance, standing, trusts_imus)

    @property
    def standing(self) -> Standing:
        """Which nodes stand in the last frame."""
        return Standing(self._standing, self._standing.astype(np.float64))

    @property
    def trusted_imus(self) -> NDArray[np.bool_]:
        """(imus,) which inertial sensors agree with the attitude of their rods."""
        return self._trust.is_trusted

    def _start(self, imus: int, pairs: int) -> PoseState:
        return PoseState(
            turn=np.eye(3),
            position_m=self.centre_m,
            rate_rad_per_s=np.zeros(3),
            velocity_m_per_s=np.zeros(3),
            foothold_m=self._rest.node_position_m @ self._floor.axes.T,
            imu_turn=np.tile(np.eye(3), (imus, 1, 1)),
            rate_bias_rad_per_s=np.zeros((imus, 3)),
            force_bias_m_per_s2=np.zeros((imus, 3)),
            misalignment=np.zeros((imus, 2)),
            range_offset_m=np.zeros(pairs),
        )

    def _start_covariance(self) -> NDArray[np.float64]:
        settings, at = self._settings, self.state.layout
        sigma = np.full(at.size, STILL)
        sigma[at.imu_turn] = settings.misalignment_rad
        sigma[at.rate_bias] = settings.rate_bias_rad_per_s
        sigma[at.force_bias] = settings.force_bias_m_per_s2
        sigma[at.misalignment] = settings.misalignment_rad
        sigma[at.range_offset] = settings.range_offset_m
        return np.diag(sigma**2)

    def _imu_samples(self, aids: Sequence[AidReading]) -> ImuSamples | None:
        """Return the means of the inertial sensors' samples; None as long as one of them has had none."""
        samples = self._imus.mean([reading for reading in aids if isinstance(reading, ImuReading)], self._samples)
        if self._samples is None:
            if not self._imus.count or not samples.count.all():
                return None
            first, second = self._imus.ends.T
            along = (self._body_before_m[second] - self._body_before_m[first]) @ self.state.turn.T
            direction = along / np.linalg.norm(along, axis=1, keepdims=True)
            turn = self._imus.attitude_at_rest(direction, samples.specific_force_m_per_s2)
            self.state = replace(self.state, imu_turn=turn)
        return self._trust.trusted(samples)

    def _predict(
        self, step_s: float, samples: ImuSamples | None, body_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], PoseState, NDArray[np.float64]]:
        """Return the transition F, and the state and its covariance after a time step."""
        settings, before = self._settings, self.state
        motion = self._motion.after(before, step_s, samples, (self._body_before_m, body_m))
        turned = rotation_vector(before.turn @ self._turn_before.T)
        rolled_m = rolled_on_floor_m(turned, self._floor, settings.cap_radius_m)
        state = replace(motion.state, foothold_m=before.foothold_m + np.where(self._standing[:, None], rolled_m, 0.0))
        F = motion.transition
        covariance = F @ self.covariance @ F.T + motion.noise
        turning = float(np.linalg.norm(rotation_vector(state.turn @ before.turn.T)))
        self._let_slip(covariance, self._standing, turning, step_s)
        return F, state, covariance

    def _let_slip(
        self, covariance: NDArray[np.float64], stands: NDArray[np.bool_], turned_rad: float, step_s: float
    ) -> None:
        """Add the random walk of the footholds to a covariance, for a turn of the body and a time step."""
        settings, at = self._settings, self.state.layout
        walk = settings.creep_m_per_s05**2 * step_s + settings.slip_m_per_rad05**2 * turned_rad
        here = np.arange(at.foothold.start, at.foothold.stop)
        covariance[here, here] += np.repeat(np.where(stands, walk, 0.0), 2)

    def _landed(self, placed: PlacedShape, nodes: NDArray[np.bool_]) -> bool:
        """Return whether one of the nodes, which stand now, was predicted to be far above the floor."""
        clearance_m = self._floor.clearance_m(placed.node_position_m[nodes])
        return bool((clearance_m > LANDED_M).any())

    def _tipped(
        self,
        placed: PlacedShape,
        transition: NDArray[np.float64],
        covariance: NDArray[np.float64],
        stands: NDArray[np.bool_],
        stayed: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], PlacedShape, NDArray[np.float64]]:
        """Return the shape tipped onto the nodes that stand, by the shortest turn about those that have stayed."""
        turn, pivot_m = tipping(placed.node_position_m, stands, stayed, self._floor.normal)
        heading = self._heading_missed(placed, turn)
        if abs(heading) > MISSED_RAD:  # the pose before was wrong, and so are its footholds
            stayed = np.zeros_like(stayed)
        turn = rotation(heading * self._floor.normal) @ turn
        state = replace(
            placed.state,
            turn=turn @ placed.state.turn,
            position_m=pivot_m + turn @ (placed.state.position_m - pivot_m),
            rate_rad_per_s=np.zeros(3),
            velocity_m_per_s=np.zeros(3),
        )
        settings, at = self._settings, state.layout
        F = np.eye(at.size)
        F[at.turn, at.turn] = F[at.position, at.position] = turn
        F[at.rate] = F[at.velocity] = 0.0
        turned_rad, moved_m = (LANDING_RAD, LANDING_M) if stayed.any() else (LEAP_RAD, LEAP_M)
        sigma = np.repeat([turned_rad, moved_m, settings.turn_rad_per_s, settings.motion_m_per_s], 3)
        covariance = F @ covariance @ F.T
        covariance[np.diag_indices(12)] += sigma**2
        self._let_slip(covariance, stayed, UNSEEN_SLIP * float(np.linalg.norm(rotation_vector(turn))), 0.0)
        return F @ transition, PlacedShape(state, placed.body_m, placed.body_covariance_m2), covariance

    def rod_heights(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return (known, 2) ends of rods with trusted sensors, and (known,) the second's height above the first."""
        if self._samples is None:
            return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        trusted = np.flatnonzero(self._trust.is_trusted)
        ends = self._imus.ends[trusted]
        length_m = np.linalg.norm(self._body_before_m[ends[:, 1]] - self._body_before_m[ends[:, 0]], axis=1)
        return ends, length_m * (self._imus.direction(self.state)[trusted] @ self._floor.normal)

    def _heading_missed(self, placed: PlacedShape, turn: NDArray[np.float64]) -> float:
        """Return the angle about the floor's normal by which rods with sensors still miss their directions, in rad.

        Args:
            placed: the shape before it tipped.
            turn: (3, 3) by which it has tipped.
        """
        trusted = np.flatnonzero(self._trust.is_trusted)
        if self._samples is None or not len(trusted):
            return 0.0
        first, second = self._imus.ends[trusted].T
        along = (placed.arm_m[second] - placed.arm_m[first]) @ turn.T @ self._floor.axes.T
        told = self._imus.direction(placed.state)[trusted] @ self._floor.axes.T
        sine = np.sum(along[:, 0] * told[:, 1] - along[:, 1] * told[:, 0])
        return float(np.arctan2(sine, np.sum(along * told)))

    def _slipped(
        self, placed: PlacedShape, covariance: NDArray[np.float64], stands: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return (nodes,) which of the nodes that stand are not where they stood."""
        slipped = np.zeros(len(stands), dtype=np.bool_)
        nodes = np.flatnonzero(stands)
        if not len(nodes):
            return slipped
        rows = self._foothold_rows(placed, nodes, 1.0)
        e = rows.error.reshape(-1, 2)
        H = rows.jacobian.reshape(len(nodes), 2, -1)
        S = H @ covariance @ np.swapaxes(H, 1, 2) + rows.variance.reshape(-1, 2)[:, :, None] * np.eye(2)
        squared = np.einsum("ka,ka->k", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])
        slipped[nodes] = squared > self._settings.slip_sigma**2
        return slipped

    def _put_down(
        self,
        placed: PlacedShape,
        transition: NDArray[np.float64],
        covariance: NDArray[np.float64],
        nodes: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], PlacedShape, NDArray[np.float64]]:
        """Start new footholds where nodes begin to stand."""
        if not nodes.any():
            return transition, placed, covariance
        at = placed.state.layout
        axes = self._floor.axes
        F = np.eye(at.size)
        noise = np.zeros(at.size)
        for node in np.flatnonzero(nodes):
            place = at.of_foothold(int(node))
            F[place] = axes @ placed.jacobian[node]
            of_shape = np.einsum("ai,ij,aj->a", axes, placed.node_covariance_m2[node], axes)
            noise[place] = of_shape + self._settings.floor_m**2
        foothold_m = np.where(nodes[:, None], placed.node_position_m @ axes.T, placed.state.foothold_m)
        covariance = F @ covariance @ F.T
        covariance[np.diag_indices(at.size)] += noise
        placed = PlacedShape(replace(placed.state, foothold_m=foothold_m), placed.body_m, placed.body_covariance_m2)
        return F @ transition, placed, covariance

    def _rows(
        self,
        placed: PlacedShape,
        covariance: NDArray[np.float64],
        t_s: float,
        step_s: float,
        aids: Sequence[AidReading],
        samples: ImuSamples | None,
        kept: NDArray[np.bool_],
    ) -> list[Rows]:
        """Return the rows of all aids in one frame."""
        settings, floor = self._settings, self._floor
        repeats = max(settings.shape_holds_s / step_s, 1.0)
        below = floor.clearance_m(placed.node_position_m) < -BELOW_M
        at_height = np.flatnonzero(self._standing | below)
        rows = [
            height_rows(placed, floor, at_height, settings.floor_m, repeats),
            self._foothold_rows(placed, np.flatnonzero(kept), repeats),
        ]
        if samples is not None:
            self._trust.observe(self._imus, placed, samples, step_s)
            rows.append(self._imus.direction_rows(placed, repeats, np.flatnonzero(self._trust.is_trusted)))
            rows.append(self._imus.gravity_rows(placed.state, samples, settings))
        positions = [reading for reading in aids if isinstance(reading, PositionReading)]
        ranges = [reading for reading in aids if isinstance(reading, RangeReading)]
        if positions:
            rows.append(position_rows(placed, positions, settings.position_m))
        if ranges:
            rows.append(range_rows(placed, ranges, self._number_of_pair, covariance, settings.range_m))
        if t_s < self._rest_seconds:
            rows.append(self._still_rows(placed.state))
        return rows

    def _held_rows(self, placed: PlacedShape, covariance: NDArray[np.float64], step_s: float) -> list[Rows]:
        """Return the rows of what else holds the structure: nothing, if it stands free."""
        return []

    def _foothold_rows(self, placed: PlacedShape, nodes: NDArray[np.int64], repeats: float) -> Rows:
        turned = rotation_vector(placed.state.turn @ self.state.turn.T)
        settings = self._settings
        return foothold_rows(placed, self._floor, nodes, turned, settings.cap_radius_m, settings.floor_m, repeats)

    def _still_rows(self, state: PoseState) -> Rows:
        """Return rows that say that the structure stands still where it was measured at rest."""
        jacobian = np.eye(12, state.layout.size)
        error = -np.concatenate(
            [
                rotation_vector(state.turn),
                state.position_m - self.centre_m,
                state.rate_rad_per_s,
                state.velocity_m_per_s,
            ]
        )
        return Rows(error, jacobian, np.full(12, STILL**2))


def tipping(
    node_position_m: NDArray[np.float64],
    stands: NDArray[np.bool_],
    stayed: NDArray[np.bool_],
    normal: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (3, 3), the shortest turn that puts a structure on some of its nodes, and (3,) the point that stays.

    Three nodes or more come to lie level; over two the centroid comes to lie.

    Args:
        node_position_m: (nodes, 3) before.
        stands: (nodes,) which nodes stand after it.
        stayed: (nodes,) which of them have stood before; the structure turns about these, or else about its centroid.
        normal: (3,) of the floor.
    """
    centroid_m = node_position_m.mean(axis=0)
    corner_m = node_position_m[stands]
    middle_m = corner_m.mean(axis=0)
    up = centroid_m - middle_m
    if len(corner_m) > 2:
        across = np.linalg.svd(corner_m - middle_m)[2][2]
        up = across * np.sign(across @ up)
    pivot_m = node_position_m[stayed].mean(axis=0) if stayed.any() else centroid_m
    return shortest_rotation(up / np.linalg.norm(up), normal), pivot_m


def _corrected(state: PoseState, covariance: NDArray[np.float64], rows: Rows) -> tuple[PoseState, NDArray[np.float64]]:
    """Return state and covariance after the correction by rows."""
    by_rows = covariance @ rows.jacobian.T
    S = rows.jacobian @ by_rows
    S[np.diag_indices(len(S))] += rows.variance
    K = np.linalg.solve(S, by_rows.T).T
    corrected = covariance - K @ by_rows.T
    return state.moved(K @ rows.error), 0.5 * (corrected + corrected.T)


def smoothed(steps: Sequence[PoseStep]) -> list[tuple[PoseState, NDArray[np.float64]]]:
    """Return state and covariance in each step, given all steps, by the smoother of Rauch, Tung and Striebel."""
    state, covariance = steps[-1].state, steps[-1].covariance
    found = [(state, covariance)]
    for k in range(len(steps) - 2, -1, -1):
        after, now = steps[k + 1], steps[k]
        tiny = 1e-16 * np.eye(len(covariance))
        gain = np.linalg.solve(after.predicted_covariance + tiny, after.transition @ now.covariance).T
        covariance = now.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        state = now.state.moved(gain @ after.predicted.errors_to(state))
        found.append((state, covariance))
    return found[::-1]
