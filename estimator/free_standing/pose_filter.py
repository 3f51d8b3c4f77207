"""The pose of a free-standing structure: an error-state Kalman filter.

The shape is estimated in body coordinates, where lengths and forces need no base. The filter places it in the world:
between frames the body moves at constant rate and velocity, or as inertial sensors say; in each frame the rows of all
aids (floor, footholds, rods with sensors, gravity, ranges, positions) correct the state, see `Prediction.corrected`.

Errors of the own frames of positions are considered and not estimated, after Schmidt: their rows of K are zero, and
their block of P stays. Readings of a robot that rests have the same errors again and again, by which the filter would
take a frame for exact.

Batch runs the same filter, and then `pose_smoother` over its steps.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...factors.ground import height_rows, rolled_on_floor_m
from ...factors.imu import ImuArray, ImuSamples
from ...factors.position import common_misfit, position_rows
from ...factors.range import outlying, range_rows
from ...models.pose.placed import PlacedShape, Rows, stacked
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.pose.position_gate import MOST_SIGMA
from ...models.pose.position_trust import PositionTrust
from ...models.pose.robot import FreeStandingRobot
from ...models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from ...models.structure.rest_shape import RestShape
from ...models.values.aids import AidReading, ImuReading, PositionReading, RangeReading
from ...models.values.rotations import rotation, rotation_vector
from ...models.values.slip import Slip
from .contacts import ContactsByHeight, Standing
from .footholds import Feet, let_slide, put_down, slips, walk_variance_m2
from .imu_trust import ImuTrust, taken_on_again
from .pose_motion import PoseMotion
from .pose_smoother import PoseStep
from .pose_start import covariance_at_rest, rest_rows, state_at_rest
from .prediction import Frame, Prediction
from .slide_watch import LOST_M, WATCH_S, WITH_IT_SIGMA, RiseWatch, UnheldPose, at_rest, risen
from .stable_face import StandWatch
from .tipping import MISSED_RAD, has_landed, heading_missed, tipped, tipping

FIRST_STEP_S = 0.02
"""Time before the first frame for which its readings count."""
FORGOTTEN_S = 60.0
"""Time without frames after which the pose is lost; of a longer one, the covariance would not be exact any more."""
LOCATED_S = 0.2
"""Time for which a position or a range tells where the robot is."""
LEAST_CARRIED = 0.25
"""Share of the weight below which the floor is taken to carry nothing: friction and height hold no node then."""
BELOW_M = 0.001
"""Depth below the floor at which a node that does not stand is lifted to it."""


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
        self._rest_seconds = robot.rest_seconds
        self._imus = ImuArray(robot.imus, rest.structure.rods)
        self._motion = PoseMotion(self._imus, settings)
        self._number_of_pair = {pair: number for number, pair in enumerate(robot.range_pairs)}
        self.centre_m = rest.node_position_m.mean(axis=0)
        """(3,) c, the origin of body coordinates."""
        self.state = state_at_rest(rest.node_position_m, robot)
        self.covariance = covariance_at_rest(self.state, robot.floor, settings)
        self._standing = robot.floor.carries_at_rest(rest.node_position_m)
        self._contacts = ContactsByHeight(robot.floor, self._standing, settings)
        self._samples: ImuSamples | None = None
        self._turn_before = self.state.turn
        self._body_before_m = rest.node_position_m - self.centre_m
        self._last_s = np.nan
        self._located_s = -np.inf
        self._trust = ImuTrust(self._imus.count, robot.rest_seconds, settings)
        self._position_trust = PositionTrust(rest, robot.rest_seconds, settings.position_m)
        self._seen_s = -np.inf
        self._has_jumped = False
        self._unheld: UnheldPose | None = None
        self._flies = False
        self._lifted_since_s = np.inf
        self._rise_watch = RiseWatch(self._imus, robot.floor, settings)
        self._stand_watch = StandWatch()
        self._slides_since_s = np.full(len(self._standing), np.inf)
        self._held_m = self.state.position_m
        self._size_m = 2 * float(np.linalg.norm(rest.node_position_m - self.centre_m, axis=1).max())

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
        frame, predicted = self._expected(t_s, body_m, body_covariance_m2, aids)
        by_heights = standing is None
        standing = self._contacts_of(predicted, frame, standing)
        stood, self._standing = self._standing, standing.nodes
        kept, landed = standing.nodes & stood, standing.nodes & ~stood
        if stood.any() or not self._is_felt(frame):  # in the air the robot turns as the sensors say
            predicted, kept, landed = self._landed(predicted, standing, kept, landed)
        if frame.samples is not None:
            self._trust.observe(self._imus, predicted.placed, frame.samples, frame.t_s, frame.step_s)
        predicted, found = self._corrected_on_feet(predicted, frame, sliding, landed, kept)
        if by_heights:
            self._watched_rise(frame)
            standing = self._watched_stand(frame, standing)
        strays = self._strays(t_s, found)
        if strays and self._standing.any():  # friction stops a slide: the sensors that tell it are wrong
            self._trust.give_up()
        return PoseStep(
            transition=predicted.transition,
            predicted=predicted.placed.state,
            predicted_covariance=predicted.covariance,
            state=self.state,
            covariance=self.covariance,
            standing=standing,
            slips=tuple(found),
            slides_since_s=self._slides_since_s,
            lifted_since_s=self._lifted_since_s,
            contradicted_imus=self._trust.contradicted,
            strays=strays,
            outlying_ranges=self._outlying_ranges(predicted, frame),
        )

    def _outlying_ranges(self, predicted: Prediction, frame: Frame) -> tuple[int, ...]:
        """Return the recordings of the ranges that are left out of a frame."""
        ranges = [reading for reading in frame.aids if isinstance(reading, RangeReading)]
        pairs, sigma_m = self._number_of_pair, self._settings.range_m
        left_out = outlying(predicted.placed, ranges, pairs, predicted.covariance, sigma_m)
        return tuple(reading.pair[0] for reading in left_out)

    def _expected(
        self,
        t_s: float,
        body_m: NDArray[np.float64],
        body_covariance_m2: NDArray[np.float64],
        aids: Sequence[AidReading],
    ) -> tuple[Frame, Prediction]:
        """Return one more frame, and what is expected of it; arguments as those of `step`."""
        samples, taken_on = self._imu_samples(t_s, aids)
        step_s = self._step_s(t_s)
        frame = Frame(t_s, step_s, body_m - self.centre_m, body_covariance_m2, aids, samples)
        predicted = self._predict(frame, self.state, self.covariance, self._turn_before)
        if taken_on is not None:
            predicted = replace(predicted, transition=predicted.transition @ taken_on)
        return frame, predicted

    def _step_s(self, t_s: float) -> float:
        """Return the time since the frame before, for which the pose is predicted."""
        return min(t_s - self._last_s, FORGOTTEN_S) if np.isfinite(self._last_s) else FIRST_STEP_S

    def _corrected_on_feet(
        self,
        predicted: Prediction,
        frame: Frame,
        sliding: NDArray[np.bool_] | None,
        landed: NDArray[np.bool_],
        kept: NDArray[np.bool_],
    ) -> tuple[Prediction, list[Slip]]:
        """Correct the state, held by the footholds of nodes that neither slide nor slip.

        Args:
            predicted: what is expected of the frame.
            frame: the frame.
            sliding: (nodes,) which nodes slide; None to tell it from inertial sensors.
            landed: (nodes,) which nodes have begun to stand.
            kept: (nodes,) which nodes have stood since the frame before.

        Returns:
            The prediction with new footholds, and the slips.
        """
        slid = self._slides
        predicted, before = self._slid(predicted, frame, sliding, landed, kept)
        feet = self._feet(predicted, kept)
        found = self._slips(predicted, feet, frame.t_s, slid)
        slipped = np.isin(np.arange(len(kept)), [slip.node for slip in found])
        predicted = put_down(predicted, landed | slipped, self._floor, self._settings.floor_m)
        self._correct(predicted, before, frame, feet.among(~slipped & ~self._slides))
        return predicted, found

    def _landed(
        self, predicted: Prediction, standing: Standing, kept: NDArray[np.bool_], landed: NDArray[np.bool_]
    ) -> tuple[Prediction, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the prediction tipped onto nodes that have landed, or with feet that slide by least friction.

        After a tip all nodes that stand have landed.

        Args:
            predicted: what is expected of the frame.
            standing: which nodes stand.
            kept: (nodes,) which of them have stood since the frame before.
            landed: (nodes,) which of them have not.
        """
        if has_landed(predicted.placed, self.floor, landed):
            predicted = self._tipped(predicted, standing.nodes, kept)
            self._unheld = None
            kept, landed = np.zeros_like(kept), standing.nodes
            self.state = replace(self.state, turn=predicted.placed.state.turn)  # new footholds do not roll by the tip
        if standing.assumed and kept.any():
            predicted = let_slide(predicted, self._body_before_m, standing.nodes, kept, self._floor, self._settings)
        return predicted, kept, landed

    def _slid(
        self,
        predicted: Prediction,
        frame: Frame,
        sliding: NDArray[np.bool_] | None,
        landed: NDArray[np.bool_],
        kept: NDArray[np.bool_],
    ) -> tuple[Prediction, PoseState]:
        """Return the prediction and the state before it, given which nodes slide, as told or as the watch finds it."""
        slid = self._slides
        before = self.state
        if sliding is None:
            predicted, before = self._watched(predicted, frame, landed, kept)
        else:
            self._slides_since_s = np.where(sliding, frame.t_s, np.inf)
        if (self._slides & ~slid).any():
            variance = np.zeros(before.layout.size)
            variance[before.layout.position] = LOST_M**2
            predicted = predicted.then(predicted.placed, np.eye(len(variance)), variance)
        return predicted, before

    def _correct(self, predicted: Prediction, before: PoseState, frame: Frame, held: Feet) -> None:
        """Correct the state by the rows of all aids, and keep of the frame what the next one needs.

        Args:
            predicted: what is expected of the frame.
            before: the state in the frame before.
            frame: the frame.
            held: the nodes that footholds hold.
        """
        self._has_jumped |= self._jumps(predicted, frame)
        rows = self._rows(predicted, frame, held)
        rows += self._held_rows(predicted.placed, predicted.covariance, frame.step_s)
        if self._is_blind(frame):
            self.state, self.covariance = predicted.corrected_blindly(stacked(rows), self._floor)
        else:
            self.state, self.covariance = predicted.corrected(stacked(rows))
        self._turn_before = before.turn
        self._body_before_m = frame.body_m
        self._samples = frame.samples
        self._last_s = frame.t_s

    def _jumps(self, predicted: Prediction, frame: Frame) -> bool:
        """Return whether all positions of a frame are off alike, while nodes are in sight: their frame has moved.

        Feet that begin to slide move by `motion_m_per_s`, which footholds do not expect.
        """
        positions = frame.positions
        if not positions:
            return False
        in_sight, self._seen_s = frame.t_s - self._seen_s < LOCATED_S, frame.t_s
        rows = position_rows(predicted.placed, positions, frame.t_s, self._settings.position_m)
        slides_m = self._settings.motion_m_per_s * frame.step_s
        return in_sight and common_misfit(rows, predicted.covariance, slides_m) > MOST_SIGMA**2

    def _strays(self, t_s: float, found: Sequence[Slip]) -> bool:
        """Return whether the robot is further from where a foot or a reading held it last than it is long."""
        is_located = t_s - self._located_s < LOCATED_S or t_s < self._rest_seconds
        if is_located or (self._standing & ~self._slides).any():
            self._held_m = self.state.position_m
        way_m = [float(np.linalg.norm(self.state.position_m - self._held_m)), *(slip.distance_m for slip in found)]
        return max(way_m) > self._size_m and not is_located

    def _is_blind(self, frame: Frame) -> bool:
        """Return whether the floor alone tells where the robot is, and so nothing where it heads."""
        is_told = frame.samples is not None or bool(frame.aids) or frame.t_s < self._rest_seconds
        return not is_told and bool(self._standing.any())

    def _contacts_of(self, predicted: Prediction, frame: Frame, standing: Standing | None) -> Standing:
        """Return which nodes stand, as told or by heights."""
        if standing is not None:
            self._contacts.stand_on(standing.nodes)
            return standing
        located = any(isinstance(reading, PositionReading | RangeReading) for reading in frame.aids)
        self._located_s = frame.t_s if located else self._located_s
        is_located, is_lifted = frame.t_s - self._located_s < LOCATED_S, bool(np.isfinite(self._lifted_since_s))
        seen, self._flies = self._seen(predicted, frame), self._is_weightless(predicted, frame)
        standing = self._contacts.observe(
            seen.placed,
            seen.covariance,
            frame.step_s,
            is_located=is_located,
            is_lifted=is_lifted,
            flies=self._flies,
        )
        if standing.nodes.any():
            self._lifted_since_s = np.inf
        return standing

    def _is_weightless(self, predicted: Prediction, frame: Frame) -> bool:
        """Return whether inertial sensors feel that nothing carries the robot: it bounces, or falls."""
        if not self._is_felt(frame) or frame.t_s < self._rest_seconds:
            return False
        gained = predicted.placed.state.velocity_m_per_s - self.state.velocity_m_per_s
        force_m_per_s2 = gained / frame.step_s + GRAVITY_M_PER_S2 * UP
        return float(force_m_per_s2 @ self.floor.normal) < LEAST_CARRIED * GRAVITY_M_PER_S2

    def _is_felt(self, frame: Frame) -> bool:
        """Return whether an inertial sensor tells how the robot moves in a frame."""
        return frame.samples is not None and bool(frame.samples.count.any())

    def _watched_stand(self, frame: Frame, standing: Standing) -> Standing:
        """Return which nodes stand, and whether they can carry the robot, where no positions tell its pose."""
        if not self._standing.any():
            standing = self._contacts.lift()
        if frame.samples is None or frame.positions or frame.t_s < self._rest_seconds:
            return standing
        placed = PlacedShape(self.state, frame.body_m, frame.body_covariance_m2)
        of_state = self.covariance
        return self._stand_watch.observe(
            frame.t_s, frame.step_s, placed, of_state, self._floor, frame.samples, standing, flies=self._flies
        )

    def _watched(
        self, predicted: Prediction, frame: Frame, landed: NDArray[np.bool_], kept: NDArray[np.bool_]
    ) -> tuple[Prediction, PoseState]:
        """Return the prediction, that without footholds where nodes slide, and the state before it."""
        slid = self._slides
        if slid.any():
            rests = at_rest(predicted.placed, predicted.covariance, self._floor)
            self._slides_since_s = np.where(kept & ~rests, self._slides_since_s, np.inf)
        if (slid & ~self._slides).any():  # their new footholds are those of the next watch
            self._unheld = None
            return predicted, self.state
        if frame.samples is None or frame.t_s < self._rest_seconds:
            return predicted, self.state
        if self._unheld is None or frame.t_s - self._unheld.since_s > WATCH_S:
            self._unheld = UnheldPose(self._last_s, self.state, self.covariance, self._turn_before)
        unheld = self._unheld
        free = self._predict(frame, unheld.state, unheld.covariance, unheld.turn_before)
        free = put_down(free, landed, self._floor, self._settings.floor_m)
        feet = self._feet(free, kept & ~self._slides)
        if slips(feet, free, frame.t_s, self._floor, self._settings.slip_sigma):
            slide = slips(feet, free, frame.t_s, self._floor, WITH_IT_SIGMA)
            self._slides_since_s = self._slides_since_s.copy()
            self._slides_since_s[[slip.node for slip in slide]] = unheld.since_s
            self._unheld = None
            return free, unheld.state
        state, covariance = free.corrected(stacked(self._rows(free, frame, None)))
        self._unheld = UnheldPose(unheld.since_s, state, covariance, unheld.state.turn)
        return predicted, self.state

    def _watched_rise(self, frame: Frame) -> None:
        """Take the robot off the floor where inertial sensors say that it has risen from it."""
        placed = PlacedShape(self.state, frame.body_m, frame.body_covariance_m2)
        if frame.samples is None or frame.t_s < self._rest_seconds or not self._standing.any():
            self._rise_watch.forget()
            return
        rise = self._rise_watch.observe(frame.t_s, frame.step_s, placed, self.covariance, frame.samples)
        if rise is None:
            return
        self.state, self.covariance = risen(self.state, self.covariance, rise, self._floor)
        self._lifted_since_s = rise.since_s
        self._standing = self._contacts.lift().nodes
        self._slides_since_s = np.full(len(self._standing), np.inf)
        self._unheld = None

    def without_contradictions(
        self,
        t_s: float,
        body_m: NDArray[np.float64],
        body_covariance_m2: NDArray[np.float64],
        aids: Sequence[AidReading],
    ) -> tuple[AidReading, ...]:
        """Return the readings of a frame without the positions that contradict its shape or the pose before it.

        Args:
            t_s: time of the frame.
            body_m: (nodes, 3) the shape, in body coordinates.
            body_covariance_m2: (3 nodes, 3 nodes) its covariance.
            aids: the readings since the frame before.
        """
        positions = [reading for reading in aids if isinstance(reading, PositionReading)]
        placed = PlacedShape(self.state, body_m - self.centre_m, body_covariance_m2)
        step_s = self._step_s(t_s)
        used = set(map(id, self._position_trust.trusted(t_s, positions, placed, self.covariance, step_s)))
        return tuple(reading for reading in aids if not isinstance(reading, PositionReading) or id(reading) in used)

    @property
    def doubts_positions(self) -> bool:
        """Whether many positions of the last second are left out, or all have jumped together, see `_jumps`."""
        return self._position_trust.is_doubted or self._has_jumped

    @property
    def standing(self) -> Standing:
        """Which nodes stand in the last frame."""
        return Standing(self._standing, self._standing.astype(np.float64))

    @property
    def floor(self) -> Floor:
        """The floor as it is estimated, or told exactly."""
        return self._floor.tilted(self.state.floor_tilt)

    @property
    def contradicted_imus(self) -> NDArray[np.bool_]:
        """(imus,) which inertial sensors contradict their rods, gravity or themselves."""
        return self._trust.contradicted

    @property
    def used_imus(self) -> NDArray[np.bool_]:
        """(imus,) which inertial sensors agree with the attitude of their rods and are not silent."""
        return self._trust.is_used

    @property
    def _slides(self) -> NDArray[np.bool_]:
        """(nodes,) which nodes slide."""
        return np.asarray(np.isfinite(self._slides_since_s))

    def _imu_samples(
        self, t_s: float, aids: Sequence[AidReading]
    ) -> tuple[ImuSamples | None, NDArray[np.float64] | None]:
        """Take on the inertial sensors that are heard for the first time, or again, turned as their rods are.

        Returns:
            The means of the samples that are used, None as long as there has been no sample at all, and (size, size)
            the transition of the errors by which sensors are taken on again; None if none is.
        """
        F = None
        samples = self._imus.mean([reading for reading in aids if isinstance(reading, ImuReading)], self._samples)
        if self._samples is None:
            heard = samples.count > 0
            if not heard.any():
                return None, F
            turn = np.where(heard[:, None, None], self._imu_turns(samples), self.state.imu_turn)
            self.state = replace(self.state, imu_turn=turn)
        self._trust.hear(t_s, samples)
        back = self._trust.back(self._imus, self._body_before_m @ self.state.turn.T, samples)
        if len(back):
            turn = self._imu_turns(samples)
            self.state, self.covariance, F = taken_on_again(self.state, self.covariance, back, turn, self._settings)
            self._unheld = None
        return self._trust.used(samples), F

    def _imu_turns(self, samples: ImuSamples) -> NDArray[np.float64]:
        """Return (imus, 3, 3), the attitudes of sensors in slow motion, by their rods and by gravity."""
        direction = self._imus.rod_direction(self._body_before_m @ self.state.turn.T)
        return self._imus.attitude_at_rest(direction, samples.specific_force_m_per_s2)

    def _predict(
        self, frame: Frame, before: PoseState, covariance: NDArray[np.float64], turn_before: NDArray[np.float64]
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
        turns = np.stack([before.turn @ turn_before.T, motion.state.turn @ before.turn.T])
        turned_before, turned = rotation_vector(turns)
        rolled_m = rolled_on_floor_m(turned_before, self._floor, settings.cap_radius_m)
        state = replace(motion.state, foothold_m=before.foothold_m + np.where(self._standing[:, None], rolled_m, 0.0))
        F = motion.transition
        covariance = F @ covariance @ F.T + motion.noise
        turning = float(np.linalg.norm(turned))
        here = np.arange(at.foothold.start, at.foothold.stop)
        covariance[here, here] += walk_variance_m2(self._standing, turning, frame.step_s, settings)
        return Prediction(PlacedShape(state, frame.body_m, frame.body_covariance_m2), F, covariance, turned)

    def _seen(self, predicted: Prediction, frame: Frame) -> Prediction:
        """Return the prediction corrected by positions alone, by which contacts are told before the floor holds it."""
        positions = frame.positions
        if not positions:
            return predicted
        placed = predicted.placed
        state, covariance = predicted.corrected(position_rows(placed, positions, frame.t_s, self._settings.position_m))
        placed = PlacedShape(state, placed.body_m, placed.body_covariance_m2)
        return Prediction(placed, predicted.transition, covariance, predicted.turned)

    def _tipped(self, predicted: Prediction, stands: NDArray[np.bool_], stayed: NDArray[np.bool_]) -> Prediction:
        """Return the shape tipped onto the nodes that stand, by the shortest turn about those that have stayed."""
        placed, used, normal = predicted.placed, np.flatnonzero(self._trust.is_used), self.floor.normal
        turn, pivot_m = tipping(placed.node_position_m, stands, stayed, normal)
        heading = 0.0
        if self._samples is not None and len(used):
            told = self._imus.direction(placed.state)[used]
            heading = heading_missed(self._imus.rod_m(placed.arm_m)[used] @ turn.T, told, self._floor)
        if abs(heading) > MISSED_RAD:  # the pose before was wrong, and so are its footholds
            stayed = np.zeros_like(stayed)
        turn = rotation(heading * normal) @ turn
        return tipped(predicted, turn, pivot_m, stayed, self._floor, self._settings)

    def _slips(
        self,
        predicted: Prediction,
        feet: Feet,
        t_s: float,
        slid: NDArray[np.bool_],
    ) -> list[Slip]:
        """Return the slips of nodes that stand: those found at once, and the slides that have ended.

        Args:
            predicted: what is expected of the frame.
            feet: the nodes that have stood since the frame before.
            t_s: time of the frame.
            slid: (nodes,) which of them slid in the frame before.
        """
        slides = self._slides
        at_once = slips(feet.among(~slides & ~slid), predicted, t_s, self._floor, self._settings.slip_sigma)
        return at_once + slips(feet.among(~slides & slid), predicted, t_s, self._floor, 0.0)

    def rod_heights(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return (known, 2) ends of rods whose sensors are used, and (known,) the second's height above the first."""
        if self._samples is None:
            return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        used = np.flatnonzero(self._trust.is_used)
        length_m = np.linalg.norm(self._imus.rod_m(self._body_before_m)[used], axis=1)
        return self._imus.ends[used], length_m * (self._imus.direction(self.state)[used] @ self.floor.normal)

    def _rows(self, predicted: Prediction, frame: Frame, held: Feet | None) -> list[Rows]:
        """Return the rows of all aids in one frame; without footholds, if none holds a node."""
        settings, floor, placed = self._settings, self._floor, predicted.placed
        samples, aids = frame.samples, frame.aids
        repeats = max(settings.shape_holds_s / frame.step_s, 1.0)
        below = floor.tilted(placed.state.floor_tilt).clearance_m(placed.node_position_m) < -BELOW_M
        at_height = np.flatnonzero(self._standing | below)
        rows = [height_rows(placed, floor, at_height, settings.floor_m, repeats)]
        if held is not None:
            rows.append(held.rows.lasting(repeats))
        if samples is not None:
            rows.append(self._imus.direction_rows(placed, repeats, np.flatnonzero(self._trust.is_used)))
            rows.append(self._imus.gravity_rows(placed.state, samples, settings))
        positions = frame.positions
        ranges = [reading for reading in aids if isinstance(reading, RangeReading)]
        if positions:
            rows.append(position_rows(placed, positions, frame.t_s, settings.position_m))
        if ranges:
            rows.append(range_rows(placed, ranges, self._number_of_pair, predicted.covariance, settings.range_m))
        if frame.t_s < self._rest_seconds:
            rows.append(rest_rows(placed.state, self.centre_m))
        return rows

    def _held_rows(self, placed: PlacedShape, covariance: NDArray[np.float64], step_s: float) -> list[Rows]:
        """Return the rows of what else holds the structure: nothing, if it stands free."""
        return []

    def _feet(self, predicted: Prediction, nodes: NDArray[np.bool_]) -> Feet:
        return Feet.of(predicted, nodes, self._floor, self._settings)
