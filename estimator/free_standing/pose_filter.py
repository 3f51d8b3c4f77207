"""The pose of a free-standing structure: an error-state Kalman filter.

The shape is estimated in body coordinates, where lengths and forces need no base. The filter places it in the world:
between frames the body moves at constant rate and velocity, or as inertial sensors say; in each frame the rows of all
aids (floor, footholds, rods with sensors, gravity, ranges, positions) correct the state,

    S = H P H^T + V,   K = P H^T S^-1,   d = K e,   P <- P - K S K^T

Errors of the own frames of positions are considered and not estimated, after Schmidt: their rows of K are zero, and
their block of P stays. Readings of a robot that rests have the same errors again and again, by which the filter would
take a frame for exact.

Batch runs the same filter, and then `pose_smoother` over its steps.
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
from ...models.values.rotations import rotation, rotation_vector
from ...models.values.slip import Slip
from .contacts import ContactsByHeight, Standing
from .footholds import let_slide, put_down, slips, walk_variance_m2
from .imu_trust import ImuTrust
from .pose_motion import PoseMotion
from .pose_smoother import PoseStep
from .prediction import Prediction
from .slide_watch import LOST_M, WATCH_S, WITH_IT_SIGMA, UnheldPose, at_rest
from .tipping import MISSED_RAD, has_landed, tipped, tipping

STILL = 1e-3
"""Standard deviation of all motion while the structure stands at rest at the start, in rad and m and per second."""
LOCATED_S = 0.2
"""Time for which a position or a range tells where the robot is."""
BELOW_M = 0.001
"""Depth below the floor at which a node that does not stand is lifted to it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """What is known of one frame beside the state."""

    t_s: float
    step_s: float
    body_m: NDArray[np.float64]
    """(nodes, 3) the shape, relative to c."""
    body_covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes)"""
    aids: Sequence[AidReading]
    samples: ImuSamples | None
    """Of the inertial sensors; None without such sensors."""


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
        self.state = self._start(len(robot.imus), len(robot.range_pairs), robot.own_frames)
        self.covariance = self._start_covariance()
        self._standing = robot.floor.carries_at_rest(rest.node_position_m)
        self._contacts = ContactsByHeight(robot.floor, self._standing, settings)
        self._samples: ImuSamples | None = None
        self._turn_before = self.state.turn
        self._body_before_m = rest.node_position_m - self.centre_m
        self._last_s = np.nan
        self._located_s = -np.inf
        self._trust = ImuTrust(self._imus.count)
        self._unheld: UnheldPose | None = None
        self._slides_since_s = np.full(len(self._standing), np.inf)

    def step(
        self,
        t_s: float,
        body_m: NDArray[np.float64],
        body_covariance_m2: NDArray[np.float64],
        aids: Sequence[AidReading],
        standing: Standing | None = None,
        sliding: NDArray[np.bool_] | None = None,
    ) -> PoseStep:
        """Return the state in one more frame.

        Args:
            t_s: time of the frame.
            body_m: (nodes, 3) the shape, in body coordinates.
            body_covariance_m2: (3 nodes, 3 nodes) its covariance.
            aids: the readings since the frame before.
            standing: which nodes stand; None to tell it from heights.
            sliding: (nodes,) which of them slide; None to tell it from inertial sensors.
        """
        step_s = t_s - self._last_s if np.isfinite(self._last_s) else 0.02
        samples = self._imu_samples(t_s, aids)
        back = self._take_on_again(samples)
        samples = None if samples is None else self._trust.used(samples)
        frame = _Frame(t_s, step_s, body_m - self.centre_m, body_covariance_m2, aids, samples)
        predicted = self._predict(frame, self.state, self.covariance, self._turn_before)
        predicted = replace(predicted, transition=predicted.transition @ back)
        before = self.state
        standing = self._contacts_of(predicted, frame, standing)
        stood, self._standing = self._standing, standing.nodes
        kept = standing.nodes & stood
        if has_landed(predicted.placed, self._floor, standing.nodes & ~stood):
            predicted = self._tipped(predicted, standing.nodes, kept)
            self._unheld = None
        if standing.assumed and kept.any():
            predicted = let_slide(predicted, self._body_before_m, standing.nodes, kept, self._floor, self._settings)
        if samples is not None:
            self._trust.observe(self._imus, predicted.placed, samples, step_s)
        slid = np.isfinite(self._slides_since_s)
        if sliding is None:
            predicted, before = self._watched(predicted, frame, standing.nodes & ~stood, kept)
        else:
            self._slides_since_s = np.where(sliding, t_s, np.inf)
        if (np.isfinite(self._slides_since_s) & ~slid).any():
            variance = np.zeros(before.layout.size)
            variance[before.layout.position] = LOST_M**2
            predicted = predicted.then(predicted.placed, np.eye(len(variance)), variance)
        found = self._slips(predicted, before, t_s, kept, slid)
        slipped = np.zeros_like(kept)
        slipped[[slip.node for slip in found]] = True
        started = (standing.nodes & ~stood) | slipped
        predicted = put_down(predicted, started, self._floor, self._settings.floor_m)
        held = kept & ~slipped & ~np.isfinite(self._slides_since_s)
        self._turn_before = before.turn
        rows = self._rows(predicted, before, frame, held)
        rows += self._held_rows(predicted.placed, predicted.covariance, step_s)
        self.state, self.covariance = _corrected(predicted, stacked(rows))
        self._body_before_m = frame.body_m
        self._samples = samples
        self._last_s = t_s
        return PoseStep(
            transition=predicted.transition,
            predicted=predicted.placed.state,
            predicted_covariance=predicted.covariance,
            state=self.state,
            covariance=self.covariance,
            standing=standing,
            slips=tuple(found),
            slides_since_s=self._slides_since_s,
            trusts_imus=bool(self._trust.is_trusted.all()),
        )

    def _contacts_of(self, predicted: Prediction, frame: "_Frame", standing: Standing | None) -> Standing:
        """Return which nodes stand, as told or by heights."""
        if standing is not None:
            self._contacts.stand_on(standing.nodes)
            return standing
        located = any(isinstance(reading, PositionReading | RangeReading) for reading in frame.aids)
        self._located_s = frame.t_s if located else self._located_s
        is_located = frame.t_s - self._located_s < LOCATED_S
        seen = self._seen(predicted, frame)
        return self._contacts.observe(seen.placed, seen.covariance, frame.step_s, is_located=is_located)

    def _watched(
        self, predicted: Prediction, frame: "_Frame", landed: NDArray[np.bool_], kept: NDArray[np.bool_]
    ) -> tuple[Prediction, PoseState]:
        """Return the prediction, that without footholds where nodes slide, and the state before it."""
        slid = np.isfinite(self._slides_since_s)
        if slid.any():
            rests = at_rest(predicted.placed, predicted.covariance, self._floor)
            self._slides_since_s = np.where(kept & ~rests, self._slides_since_s, np.inf)
        if (slid & ~np.isfinite(self._slides_since_s)).any():  # their new footholds are those of the next watch
            self._unheld = None
            return predicted, self.state
        if frame.samples is None or frame.t_s < self._rest_seconds:
            return predicted, self.state
        if self._unheld is None or frame.t_s - self._unheld.since_s > WATCH_S:
            self._unheld = UnheldPose(self._last_s, self.state, self.covariance, self._turn_before)
        unheld = self._unheld
        free = self._predict(frame, unheld.state, unheld.covariance, unheld.turn_before)
        free = put_down(free, landed, self._floor, self._settings.floor_m)
        watched = np.flatnonzero(kept & ~np.isfinite(self._slides_since_s))
        rows = self._foothold_rows(free.placed, unheld.state, watched, 1.0)
        if slips(rows, free, frame.t_s, watched, self._floor, self._settings.slip_sigma):
            slide = slips(rows, free, frame.t_s, watched, self._floor, WITH_IT_SIGMA)
            self._slides_since_s = self._slides_since_s.copy()
            self._slides_since_s[[slip.node for slip in slide]] = unheld.since_s
            self._unheld = None
            return free, unheld.state
        nothing = np.zeros_like(kept)
        state, covariance = _corrected(free, stacked(self._rows(free, unheld.state, frame, nothing)))
        self._unheld = UnheldPose(unheld.since_s, state, covariance, unheld.state.turn)
        return predicted, self.state

    @property
    def standing(self) -> Standing:
        """Which nodes stand in the last frame."""
        return Standing(self._standing, self._standing.astype(np.float64))

    @property
    def used_imus(self) -> NDArray[np.bool_]:
        """(imus,) which inertial sensors agree with the attitude of their rods and are not silent."""
        return self._trust.is_used

    def _start(self, imus: int, pairs: int, own_frames: int) -> PoseState:
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
            own_frame_error=np.zeros((own_frames, 6)),
        )

    def _start_covariance(self) -> NDArray[np.float64]:
        settings, at = self._settings, self.state.layout
        sigma = np.full(at.size, STILL)
        sigma[at.imu_turn] = settings.misalignment_rad
        sigma[at.rate_bias] = settings.rate_bias_rad_per_s
        sigma[at.force_bias] = settings.force_bias_m_per_s2
        sigma[at.misalignment] = settings.misalignment_rad
        sigma[at.range_offset] = settings.range_offset_m
        sigma[at.own_frame] = 1.0
        return np.diag(sigma**2)

    def _imu_samples(self, t_s: float, aids: Sequence[AidReading]) -> ImuSamples | None:
        """Return the means of the inertial sensors' samples; None as long as there has been no sample at all."""
        samples = self._imus.mean([reading for reading in aids if isinstance(reading, ImuReading)], self._samples)
        if self._samples is None:
            heard = samples.count > 0
            if not heard.any():
                return None
            turn = np.where(heard[:, None, None], self._imu_turns(samples), self.state.imu_turn)
            self.state = replace(self.state, imu_turn=turn)
        self._trust.hear(t_s, samples)
        return samples

    def _imu_turns(self, samples: ImuSamples) -> NDArray[np.float64]:
        """Return (imus, 3, 3), the attitudes of sensors in slow motion, by their rods and by gravity."""
        first, second = self._imus.ends.T
        along = (self._body_before_m[second] - self._body_before_m[first]) @ self.state.turn.T
        direction = along / np.linalg.norm(along, axis=1, keepdims=True)
        return self._imus.attitude_at_rest(direction, samples.specific_force_m_per_s2)

    def _take_on_again(self, samples: ImuSamples | None) -> NDArray[np.float64]:
        """Take on sensors that were silent, which are turned now as their rods are.

        Returns:
            (size, size) the transition of the errors: those of a sensor's attitude become those of the body's.
        """
        settings, at = self._settings, self.state.layout
        F = np.eye(at.size)
        if samples is None:
            return F
        back = self._trust.back(self._imus, self._body_before_m @ self.state.turn.T, samples)
        if not len(back):
            return F
        turn = self.state.imu_turn.copy()
        turn[back] = self._imu_turns(samples)[back]
        self.state = replace(self.state, imu_turn=turn)
        noise = np.zeros(at.size)
        for imu in map(int, back):
            place = at.of_imu(at.imu_turn, imu)
            F[place] = np.eye(3, at.size, at.turn.start)
            noise[place] = settings.misalignment_rad**2
            noise[at.of_imu(at.rate_bias, imu)] = settings.rate_bias_rad_per_s**2
            noise[at.of_imu(at.force_bias, imu)] = settings.force_bias_m_per_s2**2
        self.covariance = F @ self.covariance @ F.T + np.diag(noise)
        self._unheld = None
        return F

    def _predict(
        self, frame: "_Frame", before: PoseState, covariance: NDArray[np.float64], turn_before: NDArray[np.float64]
    ) -> Prediction:
        """Return what is expected of a frame.

        Args:
            frame: the frame.
            before: the state in the frame before.
            covariance: (size, size) of its errors.
            turn_before: (3, 3) the turn of the body one frame earlier still.
        """
        settings, at = self._settings, before.layout
        motion = self._motion.after(before, frame.step_s, frame.samples, (self._body_before_m, frame.body_m))
        turned = rotation_vector(before.turn @ turn_before.T)
        rolled_m = rolled_on_floor_m(turned, self._floor, settings.cap_radius_m)
        state = replace(motion.state, foothold_m=before.foothold_m + np.where(self._standing[:, None], rolled_m, 0.0))
        F = motion.transition
        covariance = F @ covariance @ F.T + motion.noise
        turning = float(np.linalg.norm(rotation_vector(state.turn @ before.turn.T)))
        here = np.arange(at.foothold.start, at.foothold.stop)
        covariance[here, here] += walk_variance_m2(self._standing, turning, frame.step_s, settings)
        return Prediction(PlacedShape(state, frame.body_m, frame.body_covariance_m2), F, covariance)

    def _seen(self, predicted: Prediction, frame: "_Frame") -> Prediction:
        """Return the prediction corrected by positions alone, by which contacts are told before the floor holds it."""
        positions = [reading for reading in frame.aids if isinstance(reading, PositionReading)]
        if not positions:
            return predicted
        placed = predicted.placed
        rows = position_rows(placed, positions, frame.t_s, self._settings.position_m)
        state, covariance = _corrected(predicted, rows)
        placed = PlacedShape(state, placed.body_m, placed.body_covariance_m2)
        return Prediction(placed, predicted.transition, covariance)

    def _tipped(self, predicted: Prediction, stands: NDArray[np.bool_], stayed: NDArray[np.bool_]) -> Prediction:
        """Return the shape tipped onto the nodes that stand, by the shortest turn about those that have stayed."""
        placed = predicted.placed
        turn, pivot_m = tipping(placed.node_position_m, stands, stayed, self._floor.normal)
        heading = self._heading_missed(placed, turn)
        if abs(heading) > MISSED_RAD:  # the pose before was wrong, and so are its footholds
            stayed = np.zeros_like(stayed)
        turn = rotation(heading * self._floor.normal) @ turn
        return tipped(predicted, turn, pivot_m, stayed, self._settings)

    def _slips(
        self,
        predicted: Prediction,
        before: PoseState,
        t_s: float,
        kept: NDArray[np.bool_],
        slid: NDArray[np.bool_],
    ) -> list[Slip]:
        """Return the slips of nodes that stand: those found at once, and the slides that have ended.

        Args:
            predicted: what is expected of the frame.
            before: the state in the frame before.
            t_s: time of the frame.
            kept: (nodes,) which nodes have stood since the frame before.
            slid: (nodes,) which of them slid in the frame before.
        """
        slides = np.isfinite(self._slides_since_s)
        found = []
        for nodes, slip_sigma in ((kept & ~slides & ~slid, self._settings.slip_sigma), (kept & ~slides & slid, 0.0)):
            which = np.flatnonzero(nodes)
            rows = self._foothold_rows(predicted.placed, before, which, 1.0)
            found += slips(rows, predicted, t_s, which, self._floor, slip_sigma)
        return found

    def rod_heights(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return (known, 2) ends of rods whose sensors are used, and (known,) the second's height above the first."""
        if self._samples is None:
            return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        used = np.flatnonzero(self._trust.is_used)
        ends = self._imus.ends[used]
        length_m = np.linalg.norm(self._body_before_m[ends[:, 1]] - self._body_before_m[ends[:, 0]], axis=1)
        return ends, length_m * (self._imus.direction(self.state)[used] @ self._floor.normal)

    def _heading_missed(self, placed: PlacedShape, turn: NDArray[np.float64]) -> float:
        """Return the angle about the floor's normal by which rods with sensors still miss their directions, in rad.

        Args:
            placed: the shape before it tipped.
            turn: (3, 3) by which it has tipped.
        """
        used = np.flatnonzero(self._trust.is_used)
        if self._samples is None or not len(used):
            return 0.0
        first, second = self._imus.ends[used].T
        along = (placed.arm_m[second] - placed.arm_m[first]) @ turn.T @ self._floor.axes.T
        told = self._imus.direction(placed.state)[used] @ self._floor.axes.T
        sine = np.sum(along[:, 0] * told[:, 1] - along[:, 1] * told[:, 0])
        return float(np.arctan2(sine, np.sum(along * told)))

    def _rows(
        self,
        predicted: Prediction,
        before: PoseState,
        frame: "_Frame",
        held: NDArray[np.bool_],
    ) -> list[Rows]:
        """Return the rows of all aids in one frame."""
        settings, floor, placed = self._settings, self._floor, predicted.placed
        samples, aids = frame.samples, frame.aids
        repeats = max(settings.shape_holds_s / frame.step_s, 1.0)
        below = floor.clearance_m(placed.node_position_m) < -BELOW_M
        at_height = np.flatnonzero(self._standing | below)
        rows = [
            height_rows(placed, floor, at_height, settings.floor_m, repeats),
            self._foothold_rows(placed, before, np.flatnonzero(held), repeats),
        ]
        if samples is not None:
            rows.append(self._imus.direction_rows(placed, repeats, np.flatnonzero(self._trust.is_used)))
            rows.append(self._imus.gravity_rows(placed.state, samples, settings))
        positions = [reading for reading in aids if isinstance(reading, PositionReading)]
        ranges = [reading for reading in aids if isinstance(reading, RangeReading)]
        if positions:
            rows.append(position_rows(placed, positions, frame.t_s, settings.position_m))
        if ranges:
            rows.append(range_rows(placed, ranges, self._number_of_pair, predicted.covariance, settings.range_m))
        if frame.t_s < self._rest_seconds:
            rows.append(self._still_rows(placed.state))
        return rows

    def _held_rows(self, placed: PlacedShape, covariance: NDArray[np.float64], step_s: float) -> list[Rows]:
        """Return the rows of what else holds the structure: nothing, if it stands free."""
        return []

    def _foothold_rows(self, placed: PlacedShape, before: PoseState, nodes: NDArray[np.int64], repeats: float) -> Rows:
        turned = rotation_vector(placed.state.turn @ before.turn.T)
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


def _corrected(predicted: Prediction, rows: Rows) -> tuple[PoseState, NDArray[np.float64]]:
    """Return state and covariance after the correction by rows; errors of own frames stay as they are."""
    considered = predicted.placed.state.layout.own_frame
    by_rows = predicted.covariance @ rows.jacobian.T
    S = rows.jacobian @ by_rows
    S[np.diag_indices(len(S))] += rows.variance
    K = np.linalg.solve(S, by_rows.T).T
    covariance = predicted.covariance - K @ by_rows.T
    covariance[considered, considered] = predicted.covariance[considered, considered]
    K[considered] = 0.0
    return predicted.placed.state.moved(K @ rows.error), 0.5 * (covariance + covariance.T)
