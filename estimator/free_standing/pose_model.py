"""What is expected of the pose in one more frame, and what the aids of the frame say of it.

These are the equations of `PoseFilter`, without its state: a copy beside it that no footholds hold, see
`watches.slide_watch`, follows the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...factors.ground import height_rows, rolled_on_floor_m
from ...factors.imu import ImuArray
from ...factors.position import position_rows
from ...factors.range import range_rows
from ...models.pose.placed import PlacedShape, Rows, stacked
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import Robot
from ...models.structure.rest_shape import RestShape
from ...models.values.aids import RangeReading
from ...models.values.rotations import rotation_vector
from .footholds import Feet, walk_variance_m2
from .pose_motion import PoseMotion
from .pose_start import rest_rows
from .prediction import Frame, Prediction, following_heading, without_heading

BELOW_M = 0.001
"""Depth below the floor from which a node that does not stand is lifted to it."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """An estimate of the pose in one frame."""

    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size) of its errors."""
    turn_before: NDArray[np.float64]
    """(3, 3) the turn of the body one frame earlier."""


class PoseModel:
    """The motion from frame to frame, and the rows of all aids."""

    def __init__(self, rest: RestShape, robot: Robot, settings: PoseSettings, motion: PoseSettings) -> None:
        """Make the model of a robot, with settings of its motion, which may be others than `settings`."""
        self.settings = settings
        self.floor = robot.floor
        """As told."""
        self.rest_until_s = robot.rest_until_s
        """Time until which the robot rests, on the clock of the frames."""
        self.imus = ImuArray(robot.imus, rest.structure.rods)
        self.centre_m: NDArray[np.float64] = rest.node_position_m.mean(axis=0)
        """(3,) c, the origin of body coordinates."""
        self._motion = PoseMotion(self.imus, motion)
        beacons = {beacon: number for number, beacon in enumerate(robot.beacons)}
        self.numbers_of_pair = {pair: (number, beacons[pair[:2]]) for number, pair in enumerate(robot.range_pairs)}
        """The number of each pair of beacon and node in the state, and that of its beacon."""

    def predicted(self, frame: Frame, before: Pose, stands: NDArray[np.bool_]) -> Prediction:
        """Return what is expected of a frame.

        Args:
            frame: the frame.
            before: the pose in the frame before.
            stands: (nodes,) which nodes stood there.
        """
        settings, state = self.settings, before.state
        at = state.layout
        motion = self._motion.after(state, frame.step_s, frame.samples, (frame.body_before_m, frame.body_m))
        turns = np.stack([state.turn @ before.turn_before.T, motion.state.turn @ state.turn.T])
        turned_before, turned = rotation_vector(turns)
        rolled_m = rolled_on_floor_m(turned_before, self.floor)
        moved = replace(motion.state, foothold_m=state.foothold_m + np.where(stands[:, None], rolled_m, 0.0))
        falls_s = frame.step_s if frame.is_felt else 0.0
        F = following_heading(motion.transition, state, moved, self.floor, falls_s)
        covariance = F @ before.covariance @ F.T + motion.noise
        turning = float(np.linalg.norm(turned))
        here = np.arange(at.foothold.start, at.foothold.stop)
        covariance[here, here] += walk_variance_m2(stands, turning, frame.step_s, settings)
        return Prediction(frame.placed(moved), F, covariance, turned)

    def seen(self, predicted: Prediction, frame: Frame) -> Prediction:
        """Return the prediction corrected by positions alone, by which contacts are told before the floor holds it."""
        if not frame.positions:
            return predicted
        return predicted.given(self._position_rows(predicted.placed, frame))

    def rows(
        self,
        predicted: Prediction,
        frame: Frame,
        stands: NDArray[np.bool_],
        used_imus: NDArray[np.bool_],
        held: Feet | None,
    ) -> list[Rows]:
        """Return the rows of all aids in one frame.

        Args:
            predicted: what is expected of the frame.
            frame: the frame.
            stands: (nodes,) which nodes stand.
            used_imus: (imus,) which inertial sensors are used.
            held: the nodes that footholds hold; None if none is held.
        """
        settings, floor, placed = self.settings, self.floor, predicted.placed
        repeats = max(settings.shape_holds_s / frame.step_s, 1.0)
        at_floor = stands | self._are_below(placed) if stands.any() else stands
        rows = [height_rows(placed, floor, np.flatnonzero(at_floor), settings.floor_m, repeats)]
        if held is not None:
            rows.append(held.rows.lasting(repeats))
        if frame.samples is not None:
            rows.append(self.imus.direction_rows(placed, repeats, np.flatnonzero(used_imus)))
        if self._is_blind(frame):
            rows = [without_heading(stacked(rows), placed.state, floor)]
        if frame.samples is not None:
            rows.append(self.imus.gravity_rows(placed.state, frame.samples, settings))
        if frame.positions:
            rows.append(self._position_rows(placed, frame))
        if frame.ranges:
            rows.append(self._range_rows(predicted, frame)[0])
        if frame.t_s < self.rest_until_s:
            rows.append(rest_rows(placed.state, self.centre_m))
            if frame.samples is not None:
                rows.append(self.imus.rest_rows(placed.state, frame.samples))
        return rows

    def corrected(
        self, predicted: Prediction, frame: Frame, rows: Sequence[Rows]
    ) -> tuple[PoseState, NDArray[np.float64]]:
        """Return the state and (size, size) its covariance after the correction by the rows of a frame."""
        if self._is_blind(frame):
            return predicted.corrected_blindly(stacked(rows), self.floor)
        return predicted.corrected(stacked(rows))

    def above_floor(
        self, state: PoseState, covariance: NDArray[np.float64], predicted: Prediction, frame: Frame
    ) -> PoseState:
        """Return the likeliest state in which no node is below the floor, of a robot that does not stand.

        That a node is not below the floor says less than that it stands there: the covariance of the state stays. With
        the height as that of a node which stands, a robot that came down 23 mm too low stopped in the air, and rose
        from then on with the velocity by which it had been lifted out of the floor.
        """
        placed = frame.placed(state)
        if not self._are_below(placed).any():
            return state
        lowest = np.array([np.argmin(self.floor.tilted(state.floor_tilt).clearance_m(placed.node_position_m))])
        expected = replace(predicted, placed=placed, covariance=covariance)
        return expected.corrected(height_rows(placed, self.floor, lowest, self.settings.floor_m, 1.0))[0]

    def _are_below(self, placed: PlacedShape) -> NDArray[np.bool_]:
        """Return (nodes,) which nodes are below the floor."""
        clearance_m = self.floor.tilted(placed.state.floor_tilt).clearance_m(placed.node_position_m)
        return np.asarray(clearance_m < -BELOW_M)

    def feet(self, predicted: Prediction, nodes: NDArray[np.bool_]) -> Feet:
        """Return (nodes,) some nodes that have stood since the frame before, with what their footholds say."""
        return Feet.of(predicted, nodes, self.floor, self.settings)

    def outlying_ranges(self, predicted: Prediction, frame: Frame) -> tuple[int, ...]:
        """Return the recordings of the ranges of which `rows` has none, because they are outliers."""
        return tuple(reading.pair[0] for reading in self._range_rows(predicted, frame)[1])

    def _is_blind(self, frame: Frame) -> bool:
        """Return whether nothing in a frame tells where the robot heads, but for gravity on a slope."""
        return not (frame.positions or frame.ranges or frame.t_s < self.rest_until_s)

    def _range_rows(self, predicted: Prediction, frame: Frame) -> tuple[Rows, list[RangeReading]]:
        placed, sigma_m = predicted.placed, self.settings.range_m
        rows, outliers = range_rows(placed, frame.ranges, self.numbers_of_pair, predicted.covariance, sigma_m)
        if frame.t_s < self.rest_until_s:  # all of an error that lasts is the offset then
            rows.jacobian[:, placed.state.layout.beacon_error] = 0.0
        return rows, outliers

    def _position_rows(self, placed: PlacedShape, frame: Frame) -> Rows:
        return position_rows(placed, frame.positions, frame.t_s, self.settings.position_m)
