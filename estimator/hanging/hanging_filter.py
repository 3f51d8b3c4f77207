"""The pose of a structure that hangs: the filter of a free-standing one in the air, with rows of anchors and of torque.

Anchors are where they are told. How the structure is turned is told by inertial sensors, and by the torque of the
weight, which balances that of hands about each axis of the suspension. Errors of this balance last, so that it is used
as far as the structure is known less exactly, and never makes it known better than the balance is. A weak hand is not
seen by the balance of forces: where inertial sensors tell another turn than the torque, they are right.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...factors.anchor import anchor_rows
from ...factors.torque import torque_rows
from ...models.pose.placed import PlacedShape, Rows
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import HangingRobot
from ...models.settings import Settings
from ...models.structure.floor import GRAVITY_M_PER_S2, UP
from ...models.structure.lengths import LEAST_M
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Shape
from ...models.structure.suspension import Suspension
from ...models.values.aids import AidReading
from ...models.values.rotations import cross_matrix
from ..free_standing.contacts import nothing_stands
from ..free_standing.pose_filter import PoseFilter
from ..free_standing.pose_smoother import PoseStep
from ..free_standing.prediction import Frame, Prediction, heading_direction, without_turn
from .hands import HandTorque, Hanging, Swing

CONTRADICTION = 3.0
"""Studentised torque about the suspension above which the pose is wrong."""
FAST_RAD = 0.1
"""Swing by measured rates, above which inertial sensors on parallel rods do not tell how a body on a ball has spun."""
HAND_TURNS_RAD_PER_S = 5.0
"""Standard deviation of the rate at which a hand turns a structure about its anchors."""
ANY_SPIN_RAD_PER_S = 7.0
"""Rate at which a rod may spin about itself against the body, white: by a radian in a second. The torque of the weight
tells the turn about the rod of a single inertial sensor."""
ANY_MOTION_M_PER_S = 5.0
"""Standard deviation of the velocity of the centroid, which anchors and the turn tell: it tells no turn."""
ANY_FORCE_M_PER_S2 = 1000.0
"""Noise of the specific force in the motion of the centroid, for the same reason."""


class HangingFilter(PoseFilter):
    """Follows the pose of a structure that hangs, frame by frame."""

    forgotten_s = 1.0
    """Time in which hands may turn it in any way."""

    def __init__(self, rest: RestShape, robot: HangingRobot, settings: Settings) -> None:
        unknown = replace(
            settings.pose,
            motion_m_per_s=ANY_MOTION_M_PER_S,
            turn_rad_per_s=HAND_TURNS_RAD_PER_S,
            spin_rad_per_s=ANY_SPIN_RAD_PER_S,
            force_m_per_s2=ANY_FORCE_M_PER_S2,
        )
        super().__init__(rest, robot, settings.pose, unknown)
        self._anchor_m = robot.anchor_m
        self._suspension = Suspension.of(rest.structure, rest.node_mass_kg)
        self._nothing_stands = nothing_stands(rest.structure.node_count)
        self._standing = self._nothing_stands.nodes
        self._weight_n = rest.node_mass_kg * GRAVITY_M_PER_S2
        lever_m = self._suspension.lever_m(rest.node_position_m)
        by_shift = self._suspension.axes @ cross_matrix(UP)
        self._untold_m = -np.linalg.pinv(by_shift) @ self._suspension.torque_m(lever_m)
        squared_m2 = np.mean(np.sum((rest.node_position_m - self._suspension.pivot_m) ** 2, axis=1))
        frequency = np.sqrt(GRAVITY_M_PER_S2 * np.linalg.norm(lever_m) / squared_m2)
        self._swing = Swing(float(frequency), settings.pose.swing_s)
        self._hands: HandTorque | None = None
        self.is_contradicted = False
        """Whether torques contradicted the pose in the last frame, or it may have spun unseen: it may be wrong."""
        self._has_spun = False

    def hanging(self, node_position_m: NDArray[np.float64]) -> Hanging:
        """Return how a shape of (nodes, 3) body coordinates hangs without hands."""
        lever_m = self._suspension.lever_m(node_position_m) + self._untold_m
        turn = self._suspension.turn_down(lever_m)
        arm_m = node_position_m - self._suspension.pivot_m
        return Hanging(turn.T @ UP, self._suspension.axes @ turn, lever_m, arm_m, self._weight_n)

    def hang(self, shape: Shape, hands: HandTorque | None, aids: Sequence[AidReading]) -> PoseStep:
        """Return the state in one more frame.

        Args:
            shape: in body coordinates.
            hands: the torque of hands; None where forces are unknown, so that the torque of the weight says nothing.
            aids: the readings since the frame before.
        """
        self._hands = hands
        nothing = self._nothing_stands
        return self.step(shape.t_s, shape.node_position_m, shape.covariance_m2, aids, nothing, nothing.nodes)

    def _held_rows(self, predicted: Prediction, frame: Frame) -> list[Rows]:
        """Return the rows of what holds the structure: its anchors, and the balance of torques."""
        placed, covariance, structure = predicted.placed, predicted.covariance, self._rest.structure
        rows = [anchor_rows(placed, structure.anchors, structure.anchor_position_m, self._anchor_m)]
        self.is_contradicted = False
        if self._hands is not None:
            torque = self._torque_rows(placed, self._hands, frame.step_s)
            against = contradicted(torque, covariance)
            in_full = against & (not self.trust.is_used.any())  # what sensors tell, a hand unseen does not change
            rows.append(limited(torque, covariance, in_full))
            self._has_spun |= self._swing.seen_rad > FAST_RAD and self._spins_unseen()
            self.is_contradicted = self._has_spun or (bool(against.any()) and not self._turn_is_measured())
        return [self._without_heading(each, placed.state) for each in rows] if self._suspension.is_ball else rows

    def _without_heading(self, rows: Rows, state: PoseState) -> Rows:
        """Return rows that say nothing of a turn about the vertical through the one anchor, see `without_turn`."""
        N = heading_direction(state, self._floor).copy()
        N[state.layout.position] -= np.cross(UP, self._suspension.pivot_m)
        return without_turn(rows, N, state, UP)

    def _spins_unseen(self) -> bool:
        """Return whether the inertial sensors in use, all on parallel rods, do not tell how a body on a ball spins."""
        return self._suspension.is_ball and self._leave_one_turn()

    def _turn_is_measured(self) -> bool:
        """Return whether the inertial sensors in use tell all of how the structure is turned but its heading."""
        return bool(self.trust.is_used.any()) and not self._spins_unseen()

    def _measured_rad_per_s(self) -> float:
        """Return the largest rate that trusted inertial sensors have measured in the frame before; 0 without any."""
        if self._samples is None:
            return 0.0
        rate = np.linalg.norm(self._samples.rate_rad_per_s - self.state.rate_bias_rad_per_s, axis=1)
        return float(np.max(rate, where=self.trust.is_used, initial=0.0))

    def _torque_rows(self, placed: PlacedShape, hands: HandTorque, step_s: float) -> Rows:
        turn, settings = placed.state.turn, self._settings
        lever_m = self._suspension.lever_m(placed.body_m + self.centre_m) + self._untold_m
        length_m = max(float(np.linalg.norm(lever_m)), LEAST_M)
        swing_rad = self._swing.observe(turn @ hands.lever_m / length_m, step_s, self._measured_rad_per_s())
        share = self._suspension.mass_share
        centre_m2 = np.einsum("n,nmij,m->ij", share, placed.covariance_m2, share)
        of_lever = cross_matrix(UP) @ centre_m2 @ cross_matrix(UP).T
        of_hands = turn @ hands.covariance_m2 @ turn.T
        of_swing = (settings.hang_rad**2 + swing_rad**2) * length_m**2 * np.eye(3)
        return torque_rows(placed, self._suspension, lever_m, hands.lever_m, of_lever + of_hands + of_swing)


def limited(rows: Rows, covariance: NDArray[np.float64], in_full: NDArray[np.bool_]) -> Rows:
    """Return rows that leave what they measure as uncertain as they are, if it was more, and else say nothing.

    Args:
        rows: whose errors last from frame to frame.
        covariance: (size, size) of the errors of the state, before these rows.
        in_full: (rows,) which of them count in full: the state is less certain than its covariance tells.
    """
    known = np.einsum("ri,ij,rj->r", rows.jacobian, covariance, rows.jacobian)
    tells = in_full | (known > 1.001 * rows.variance)
    known_before = np.divide(rows.variance, known, out=np.zeros_like(known), where=tells & ~in_full)
    return Rows(rows.error[tells], rows.jacobian[tells], (rows.variance / (1 - known_before))[tells])


def contradicted(rows: Rows, covariance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (rows,) whether their errors are larger than `CONTRADICTION` standard deviations."""
    known = np.einsum("ri,ij,rj->r", rows.jacobian, covariance, rows.jacobian)
    return np.asarray(rows.error**2 > CONTRADICTION**2 * (known + rows.variance))
