"""The pose of a free-standing structure: an error-state Kalman filter.

The shape is estimated in body coordinates, where lengths and forces need no base. The filter places it in the world:
between frames the body moves on, ever more slowly, or as inertial sensors say; in each frame the rows of all
aids (floor, footholds, rods with sensors, gravity, ranges, positions) correct the state, see `Prediction.corrected`.

Errors of the own frames of positions, of beacons, and of rates in proportion to them are considered and not estimated,
after Schmidt: their rows of K are zero, and their block of P stays. Readings of a robot that rests have the same errors
again and again, by which the filter would take a frame for exact. A shape that lags while the robot tips looks like
rates of another scale: estimated, one of 0 came out as -0.017 after one tip, and the robot lay tilted by 3 degrees.

Batch runs the same filter, and then `pose_smoother` over its steps.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.pose.imu_samples import ImuPreintegration, ImuSamples
from ...models.pose.placed import PlacedShape, Rows, stacked
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.pose.position_trust import PositionTrust
from ...models.pose.robot import Robot
from ...models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.aids import READING_HOLDS_S, AidReading, ImuReading, PositionReading, RangeReading
from ...models.values.rotations import rotation, rotation_vector
from ...models.values.slip import Slip
from .contacts import ContactsByHeight, Standing
from .footholds import Feet, let_slide, put_down
from .imu_trust import ImuTrust, is_still, taken_on_again
from .pose_model import Pose, PoseModel
from .pose_smoother import PoseStep
from .pose_start import covariance_at_rest, state_at_rest
from .prediction import Frame, Prediction
from .tipping import MISSED_RAD, TIPS_RAD_PER_S, has_landed, heading_missed, misplaced, tipped, tipping
from .watches.heading_search import HeadingSearch, headed, is_lost
from .watches.held_watch import HeldWatch
from .watches.jump_watch import JumpWatch
from .watches.lone_sensor_watch import LoneSensorWatch
from .watches.measured_attitude import are_parallel
from .watches.place_watch import PlaceWatch
from .watches.range_trust import RangeTrust
from .watches.rise_watch import RiseWatch, risen
from .watches.shake_watch import ShakeWatch, shaken
from .watches.slide_watch import SlideWatch
from .watches.stand_watch import StandWatch

FIRST_STEP_S = 0.02
"""Time before the first frame for which its readings count."""
LEAST_CARRIED = 0.25
"""Share of the weight below which the floor is taken to carry nothing: friction and height hold no node then."""


class PoseFilter:
    """Follows the pose, frame by frame."""

    forgotten_s = 60.0
    """Time without frames after which the pose is lost; of a longer one, the covariance would not be exact any more."""

    def __init__(
        self, rest: RestShape, robot: Robot, settings: PoseSettings, motion: PoseSettings | None = None
    ) -> None:
        """Begin at rest; `motion` has other settings of the motion than `settings` where it is given."""
        self._settings = settings
        self._model = PoseModel(rest, robot, settings, motion or settings)
        self.centre_m = self._model.centre_m
        """(3,) c, the origin of body coordinates."""
        self._imus = self._model.imus
        self._floor = robot.floor
        self._rest = rest
        self._rods_of_imus = rest.structure.rods[[imu.rod for imu in robot.imus]].reshape(-1, 2)
        self._rest_until_s = robot.rest_until_s
        self.state = state_at_rest(rest.node_position_m, robot)
        self.covariance = covariance_at_rest(self.state, robot.floor, settings)
        self._standing = robot.floor.carries_at_rest(rest.node_position_m)
        self._contacts = ContactsByHeight(robot.floor, self._standing, settings)
        self._preintegration = ImuPreintegration(self._imus.count)
        self._samples: ImuSamples | None = None
        self._turn_before = self.state.turn
        self._body_before_m = rest.node_position_m - self.centre_m
        self._last_s = np.nan
        self._read_s = np.full(len(rest.node_position_m), -np.inf)
        self.trust = ImuTrust(self._imus.count, robot.rest_until_s, settings)
        """Which inertial sensors are used."""
        self._position_trust = PositionTrust(rest, robot.rest_until_s, settings.position_m)
        self._range_trust = RangeTrust(self._model.numbers_of_pair, robot.rest_until_s, settings)
        self._heading_search = HeadingSearch(self._model.numbers_of_pair, settings)
        self._jump_watch = JumpWatch(settings)
        self.knows_attitude = True
        """Whether the robot is turned as told, so that inertial sensors which are heard again may be turned with it."""
        self._flies = False
        self._moved = False
        self._lifted_since_s = np.inf
        self._slide_watch = SlideWatch(self._model, len(self._standing))
        self._rise_watch = RiseWatch(self._imus, robot.floor, settings)
        self._shake_watch = ShakeWatch(settings.shape_lag_s)
        self._stand_watch = StandWatch()
        self._lone_sensor_watch = LoneSensorWatch(self._imus, settings.floor_m)
        self.lost_robot = False
        """Whether the inertial sensors have lost the robot in a tip, see `LoneSensorWatch`, and are not back yet."""
        self._held_watch = HeldWatch()
        self._doubted_turn: NDArray[np.float64] | None = None
        self._misled_rad = 0.0
        size_m = 2 * float(np.linalg.norm(rest.node_position_m - self.centre_m, axis=1).max())
        self._place_watch = PlaceWatch(self.state.position_m, size_m, robot.rest_until_s)

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
        left_out = self._range_trust.left_out(frame, predicted)
        frame = replace(frame, ranges=[reading for reading in frame.ranges if reading not in left_out])
        self._jump_watch.observe(predicted, frame)
        by_heights = standing is None
        standing = self._contacts_of(predicted, frame, standing)
        predicted, stayed, landed = self._put_on_feet(predicted, frame, standing, by_heights=by_heights)
        predicted, frame = self._headed(predicted, frame)
        if frame.samples is not None:
            self.trust.observe(self._imus, predicted.placed, frame.samples, frame.t_s, frame.step_s)
        predicted, found = self._corrected_on_feet(predicted, frame, sliding, landed, stayed)
        self._read_s[[reading.node for reading in frame.positions]] = t_s
        self._watch_lone_sensor(frame)
        if by_heights:
            self._watched_rise(frame)
            standing = self._watched_stand(frame, standing)
        else:
            self._rise_watch.forget()
        is_held = bool((self._standing & ~self._slide_watch.slides).any())
        strays = self._place_watch.strays(t_s, self.state.position_m, found, is_held=is_held)
        if strays and self._standing.any():  # friction stops a slide: the sensors that tell it are wrong
            self.trust.give_up()
        return PoseStep(
            transition=predicted.transition,
            predicted=predicted.placed.state,
            predicted_covariance=predicted.covariance,
            state=self.state,
            covariance=self.covariance,
            shaken_m2=self._shake_watch.shaken_m2,
            standing=standing,
            slips=tuple(found),
            slides_since_s=self._slide_watch.since_s,
            lifted_since_s=self._lifted_since_s,
            contradicted_imus=self.trust.contradicted,
            imus_told_wrongly=self.trust.told_wrongly,
            spun_about=self._spun_about(t_s),
            strays=strays,
            outlying_ranges=self._model.outlying_ranges(predicted, frame)
            + tuple(reading.pair[0] for reading in left_out),
            doubts_ranges=self._range_trust.in_doubt,
        )

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
        body_m = body_m - self.centre_m
        positions = [reading for reading in aids if isinstance(reading, PositionReading)]
        ranges = [reading for reading in aids if isinstance(reading, RangeReading)]
        before_s, before_m = self._last_s, self._body_before_m
        self._shake_watch.observe(samples, step_s)
        covariance_m2 = shaken(body_covariance_m2, self._shake_watch.shaken_m2)
        frame = Frame(t_s, before_s, step_s, before_m, body_m, covariance_m2, positions, ranges, samples)
        predicted = self._model.predicted(frame, self._pose, self._standing)
        while frame.samples is not None and self.trust.outvotes(self._imus, predicted):
            frame = replace(frame, samples=self.trust.used(frame.samples))
            predicted = self._model.predicted(frame, self._pose, self._standing)
        if taken_on is not None:
            predicted = replace(predicted, transition=predicted.transition @ taken_on)
        return frame, predicted

    def _step_s(self, t_s: float) -> float:
        """Return the time since the frame before, for which the pose is predicted."""
        return min(t_s - self._last_s, self.forgotten_s) if np.isfinite(self._last_s) else FIRST_STEP_S

    def _put_on_feet(
        self, predicted: Prediction, frame: Frame, standing: Standing, *, by_heights: bool
    ) -> tuple[Prediction, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the prediction with the robot on the nodes that stand, and (nodes,) which have stayed and landed.

        Args:
            predicted: what is expected of the frame.
            frame: the frame.
            standing: which nodes stand.
            by_heights: whether heights tell it.
        """
        stood, self._standing = self._standing, standing.nodes
        stayed, landed = standing.nodes & stood, standing.nodes & ~stood
        if not frame.is_felt or (stood.any() and not by_heights):  # else the robot turns as the sensors say
            before = predicted.placed.state.turn
            predicted, stayed, landed = self._landed(predicted, standing, stayed, landed)
            if frame.is_felt and not by_heights:  # the sensors have told another face
                self._misled_rad = max(self._misled_rad, _angle(predicted.placed.state.turn, before))
        if self._misled_rad and standing.nodes.any():
            predicted = misplaced(predicted, self._misled_rad, self.floor)
            self._slide_watch.restart()
            stayed, landed, self._misled_rad = np.zeros_like(stayed), standing.nodes, 0.0
        return predicted, stayed, landed

    def _headed(self, predicted: Prediction, frame: Frame) -> tuple[Prediction, Frame]:
        """Return prediction and frame; while a robot that stands has lost its heading, a search takes the ranges."""
        if not frame.ranges:
            return predicted, frame
        floor = self._floor.tilted(predicted.placed.state.floor_tilt)
        if not self._standing.any() or self._is_seen(frame.t_s) or not is_lost(predicted, floor):
            self._heading_search.restart()
            return predicted, frame
        found = self._heading_search.observe(predicted, frame, self._standing, floor)
        if found is not None:
            self._range_trust.trust_again()
            predicted = headed(predicted, found, self._floor)
        return predicted, replace(frame, ranges=[])

    def _corrected_on_feet(
        self,
        predicted: Prediction,
        frame: Frame,
        sliding: NDArray[np.bool_] | None,
        landed: NDArray[np.bool_],
        stayed: NDArray[np.bool_],
    ) -> tuple[Prediction, list[Slip]]:
        """Correct the state, held by the footholds of nodes that neither slide nor slip.

        Args:
            predicted: what is expected of the frame.
            frame: the frame.
            sliding: (nodes,) which nodes slide; None to tell it from inertial sensors.
            landed: (nodes,) which nodes have begun to stand.
            stayed: (nodes,) which nodes have stood since the frame before.

        Returns:
            The prediction with new footholds, and the slips.
        """
        watch, before = self._slide_watch, self.state
        if sliding is None:
            pose, used = self._pose, self.trust.is_used
            predicted, before = watch.observe(predicted, frame, pose, stayed, landed, used)
        else:
            predicted = watch.told(predicted, frame, self._pose, sliding)
        feet = self._model.feet(predicted, stayed)
        stop = watch.stop_rows(predicted.placed.state)
        if stop:  # how far it slid is told by where it has stopped
            stopped = predicted.given(stacked(stop))
            found = watch.slips(stopped, self._model.feet(stopped, stayed), frame.t_s)
        else:
            found = watch.slips(predicted, feet, frame.t_s)
        slipped = np.isin(np.arange(len(stayed)), [slip.node for slip in found])
        predicted = put_down(predicted, landed | slipped, self._floor, self._settings.floor_m)
        self._correct(predicted, before, frame, feet.among(~slipped & ~watch.slides), stop)
        return predicted, found

    def _landed(
        self, predicted: Prediction, standing: Standing, stayed: NDArray[np.bool_], landed: NDArray[np.bool_]
    ) -> tuple[Prediction, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the prediction tipped onto nodes that have landed, or with feet that slide by least friction.

        After a tip all nodes that stand have landed.

        Args:
            predicted: what is expected of the frame.
            standing: which nodes stand.
            stayed: (nodes,) which of them have stood since the frame before.
            landed: (nodes,) which of them have not.
        """
        if has_landed(predicted.placed, self.floor, landed):
            predicted = self._tipped(predicted, standing.nodes, stayed)
            self._slide_watch.restart()
            stayed, landed = np.zeros_like(stayed), standing.nodes
            self.state = replace(self.state, turn=predicted.placed.state.turn)  # new footholds do not roll by the tip
        if standing.assumed and stayed.any():
            predicted = let_slide(predicted, self._body_before_m, standing.nodes, stayed, self._floor, self._settings)
        return predicted, stayed, landed

    def _correct(
        self, predicted: Prediction, before: PoseState, frame: Frame, held: Feet, stop: Sequence[Rows]
    ) -> None:
        """Correct the state by the rows of all aids, and keep of the frame what the next one needs.

        Args:
            predicted: what is expected of the frame.
            before: the state in the frame before.
            frame: the frame.
            held: the nodes that footholds hold.
            stop: see `SlideWatch.stop_rows`.
        """
        rows = self._model.rows(predicted, frame, self._standing, self.trust.is_used, held)
        rows += [*stop, *self._held_rows(predicted, frame)]
        self.state, self.covariance = self._model.corrected(predicted, frame, rows)
        if not self._standing.any():
            self.state = self._model.above_floor(self.state, self.covariance, predicted, frame)
        self._jump_watch.keep(frame.placed(self.state), frame)
        self._turn_before = before.turn
        self._body_before_m = frame.body_m
        self._samples = frame.samples
        self._last_s = frame.t_s

    def _held_rows(self, predicted: Prediction, frame: Frame) -> list[Rows]:
        """Return the rows of what else holds the robot: a hand that keeps it still in the air, as its sensors feel."""
        if self._standing.any():
            self._held_watch.lift()
            return []
        if frame.samples is None or not frame.is_felt:
            self._held_watch.move()
            return []
        state, normal = predicted.placed.state, self.floor.normal
        self._held_watch.observe(frame.step_s, self.state, state, predicted.covariance, frame.samples, normal)
        return self._held_watch.rows(state, frame.step_s)

    def _contacts_of(self, predicted: Prediction, frame: Frame, standing: Standing | None) -> Standing:
        """Return which nodes stand, as told or by heights."""
        self._place_watch.observe(frame)
        if standing is None:
            standing = self._contacts_by_heights(predicted, frame)
        else:
            self._contacts.stand_on(standing.nodes)
        if standing.nodes.any():
            self._lifted_since_s = np.inf
        return standing

    def _contacts_by_heights(self, predicted: Prediction, frame: Frame) -> Standing:
        """Return which nodes stand by their heights."""
        seen, self._flies = self._model.seen(predicted, frame), self._may_fly(predicted, frame)
        return self._contacts.observe(
            seen.placed,
            seen.covariance,
            frame.step_s,
            is_located=self._place_watch.is_located(frame.t_s),
            is_lifted=bool(np.isfinite(self._lifted_since_s)),
            has_come_down=self._held_watch.has_come_down,
            flies=self._flies,
        )

    def _may_fly(self, predicted: Prediction, frame: Frame) -> bool:
        """Return whether the robot bounces, or falls: inertial sensors feel that nothing carries it.

        Where it moved, and then their samples are missing, nothing tells whether it still stands.
        """
        if frame.samples is None or frame.t_s < self._rest_until_s:
            return False
        if not frame.is_felt:
            return self._moved and bool((frame.samples.are_missing & self.trust.is_used).any())
        self._moved = not is_still(frame.samples)
        gained = predicted.placed.state.velocity_m_per_s - self.state.velocity_m_per_s
        force_m_per_s2 = gained / frame.step_s + GRAVITY_M_PER_S2 * UP
        return float(force_m_per_s2 @ self.floor.normal) < LEAST_CARRIED * GRAVITY_M_PER_S2

    def _watched_stand(self, frame: Frame, standing: Standing) -> Standing:
        """Return which nodes stand, and whether they can carry the robot, where positions do not tell its attitude.

        Those of two nodes do, or of more; that of one does not.
        """
        if not self._standing.any():
            standing = self._contacts.lift()
        if frame.samples is None or self._is_seen(frame.t_s) or frame.t_s < self._rest_until_s:
            return standing
        placed, of_state = frame.placed(self.state), self.covariance
        standing = self._stand_watch.observe(
            frame.t_s, frame.step_s, placed, of_state, self._floor, frame.samples, standing, flies=self._flies
        )
        self._remember_doubted(is_doubted=standing.contradicted and bool(standing.others))
        return standing

    def _is_seen(self, t_s: float) -> bool:
        """Return whether the positions of two nodes or more were read in the last moments."""
        return int(np.sum(t_s - self._read_s < READING_HOLDS_S)) > 1

    def _leave_one_turn(self) -> bool:
        """Return whether the inertial sensors in use, all on parallel rods, do not tell the turn about these."""
        return are_parallel(self._rods_of_imus[self.trust.is_used], self._rest)

    def _feet_tell_one_turn(self, t_s: float) -> bool:
        """Return whether the nodes that stand have to tell a turn, as neither inertial sensors nor positions do."""
        return bool(self._standing.any()) and not self._is_seen(t_s) and self._leave_one_turn()

    def _spun_about(self, t_s: float) -> NDArray[np.float64] | None:
        """Return `PoseStep.spun_about`."""
        tips = np.linalg.norm(self.state.rate_rad_per_s) > TIPS_RAD_PER_S
        if not tips or not self._feet_tell_one_turn(t_s):
            return None
        return np.asarray(self._imus.direction(self.state)[self.trust.is_used][0])

    def _watch_lone_sensor(self, frame: Frame) -> None:
        """Lose sensors that do not tell the turn about their rods where they have lost a robot that stands."""
        if frame.samples is None or not self._feet_tell_one_turn(frame.t_s):
            return
        placed, used = frame.placed(self.state), self.trust.is_used
        if self._lone_sensor_watch.observe(placed, self.floor, self._standing, frame.samples, used, frame.step_s):
            self.trust.lose()
            self.lost_robot = True

    def _remember_doubted(self, *, is_doubted: bool) -> None:
        """Keep the turn at which the robot cannot stand; when it can again, the way to there was wrong by the rest."""
        if is_doubted and self._doubted_turn is None:
            self._doubted_turn = self.state.turn
        elif not is_doubted and self._doubted_turn is not None:
            self._misled_rad = _angle(self.state.turn, self._doubted_turn)
            self._doubted_turn = None

    def _watched_rise(self, frame: Frame) -> None:
        """Take the robot off the floor where inertial sensors say that it has risen from it."""
        at_rest = frame.t_s < self._rest_until_s
        if frame.samples is None or at_rest or np.isfinite(self._lifted_since_s):
            self._rise_watch.forget(np.inf if at_rest else 0.0)
            return
        placed, of_state, in_the_air = frame.placed(self.state), self.covariance, not self._standing.any()
        flies = in_the_air and self._flies
        is_above = in_the_air and not self._flies
        rise = self._rise_watch.observe(
            frame.t_s, frame.step_s, placed, of_state, frame.samples, flies=flies, is_above=is_above
        )
        if in_the_air:
            self._rise_watch.forget()
        if rise is None:
            return
        self.state, self.covariance = risen(self.state, self.covariance, rise, self._floor)
        self._lifted_since_s = rise.since_s
        self._standing = self._contacts.lift().nodes
        self._slide_watch.lift()

    def without_contradictions(self, shape: Shape) -> Shape:
        """Return the newest shape, in body coordinates, without the positions that contradict it or the pose before it.

        It is in doubt where many do, and tells the nodes of those that are left out.
        """
        aids = shape.lengths.aids
        positions = [reading for reading in aids if isinstance(reading, PositionReading)]
        covariance_m2 = shaken(shape.covariance_m2, self._shake_watch.shaken_m2)
        placed = PlacedShape(self.state, shape.node_position_m - self.centre_m, covariance_m2)
        step_s = self._step_s(shape.t_s)
        trusted = self._position_trust.trusted(shape.t_s, positions, placed, self.covariance, step_s)
        used = set(trusted)  # readings are equal only to themselves
        if self.doubts_positions:
            shape = shape.in_doubt(Reason.POSITIONS)
        if len(used) == len(positions):
            return shape
        others = tuple(each for each in aids if not isinstance(each, PositionReading) or each in used)
        left_out = tuple(each.node for each in positions if each not in used)
        return replace(shape, lengths=replace(shape.lengths, aids=others), contradicted_positions=left_out)

    @property
    def doubts_positions(self) -> bool:
        """Whether many positions of the last second are left out, or their frame has moved."""
        return self._position_trust.is_doubted or self._jump_watch.has_jumped

    @property
    def standing(self) -> Standing:
        """Which nodes stand in the last frame."""
        return Standing(self._standing, self._standing.astype(np.float64))

    @property
    def _pose(self) -> Pose:
        """The pose in the last frame."""
        return Pose(self.state, self.covariance, self._turn_before)

    @property
    def floor(self) -> Floor:
        """The floor as it is estimated, or told exactly."""
        return self._floor.tilted(self.state.floor_tilt)

    def _imu_samples(
        self, t_s: float, aids: Sequence[AidReading]
    ) -> tuple[ImuSamples | None, NDArray[np.float64] | None]:
        """Take on the inertial sensors that are heard for the first time, or again, turned as their rods are.

        Returns:
            The means of the samples that are used, None as long as there has been no sample at all, and (size, size)
            the transition of the errors by which sensors are taken on again; None if none is.
        """
        samples = self._preintegration.mean(t_s, [reading for reading in aids if isinstance(reading, ImuReading)])
        if self._samples is None:
            heard = samples.count > 0
            if not heard.any():
                return None, None
            turn = np.where(heard[:, None, None], self._imu_turns(samples), self.state.imu_turn)
            self.state = replace(self.state, imu_turn=turn)
            self.trust.start(self._imus, self._body_before_m @ self.state.turn.T)
        self.trust.hear(t_s, samples)
        back = np.zeros(0, dtype=np.int64)
        if self.knows_attitude:
            back = self.trust.back(self._imus, self._body_before_m @ self.state.turn.T, samples)
        if not len(back):
            return self.trust.used(samples), None
        self.lost_robot = False
        turn = self._imu_turns(samples)
        self.state, self.covariance, F = taken_on_again(self.state, self.covariance, back, turn, self._settings)
        self._slide_watch.restart()
        return self.trust.used(samples), F

    def _imu_turns(self, samples: ImuSamples) -> NDArray[np.float64]:
        """Return (imus, 3, 3), the attitudes of sensors in slow motion, by their rods and by gravity."""
        direction = self._imus.rod_direction(self._body_before_m @ self.state.turn.T)
        return self._imus.attitude_at_rest(direction, samples.specific_force_m_per_s2)

    def _tipped(self, predicted: Prediction, stands: NDArray[np.bool_], stayed: NDArray[np.bool_]) -> Prediction:
        """Return the shape tipped onto the nodes that stand, by the shortest turn about those that have stayed."""
        placed, used, normal = predicted.placed, np.flatnonzero(self.trust.is_used), self.floor.normal
        turn, pivot_m = tipping(placed.node_position_m, stands, stayed, normal)
        heading = 0.0
        if self._samples is not None and len(used):
            told = self._imus.direction(placed.state)[used]
            heading = heading_missed(self._imus.rod_m(placed.arm_m)[used] @ turn.T, told, self._floor)
        if abs(heading) > MISSED_RAD:  # the pose before was wrong, and so are its footholds
            stayed = np.zeros_like(stayed)
        turn = rotation(heading * normal) @ turn
        return tipped(predicted, turn, pivot_m, stands, stayed, self._floor, self._settings)

    def rod_heights(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return (known, 2) ends of rods with sensors, and (known,) the second's height above the first.

        A sensor that is lost tells it, too, where it moves slowly on a level floor: gravity is told in its own axes.
        """
        if self._samples is None:
            return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        used, normal = self.trust.is_used, self.floor.normal
        along = np.where(used, self._imus.direction(self.state) @ normal, self._imus.inclination(self._samples))
        is_level = self._floor.tilt_count == 0 and np.array_equal(normal, UP)
        known = used | (self.trust.tells_gravity(self._samples) & is_level)
        length_m = np.linalg.norm(self._imus.rod_m(self._body_before_m), axis=1)
        return self._imus.ends[known], (length_m * along)[known]


def _angle(turn: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the angle between two (3, 3) turns, in rad."""
    return float(np.linalg.norm(rotation_vector(turn @ other.T)))
