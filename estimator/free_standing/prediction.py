"""One frame of a pose filter: what is known of it beside the state, and what is expected before its aids are read."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...models.pose.imu_samples import ImuSamples
from ...models.pose.placed import PlacedShape, Rows
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from ...models.values.aids import PositionReading, RangeReading
from ...models.values.rotations import cross, cross_matrix


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What is known of one frame beside the state."""

    t_s: float
    before_s: float
    """Time of the frame before; nan for the first one."""
    step_s: float
    """Time for which the pose is predicted: that since the frame before, but no more than the pose is known for."""
    body_before_m: NDArray[np.float64]
    """(nodes, 3) the shape in the frame before, relative to c."""
    body_m: NDArray[np.float64]
    """(nodes, 3) the shape, relative to c."""
    body_covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes)"""
    positions: Sequence[PositionReading]
    """Of nodes."""
    ranges: Sequence[RangeReading]
    """To nodes."""
    samples: ImuSamples | None
    """Of the inertial sensors; None without such sensors."""

    @property
    def is_felt(self) -> bool:
        """Whether an inertial sensor tells how the robot moves."""
        return self.samples is not None and bool(self.samples.count.any())

    def placed(self, state: PoseState) -> PlacedShape:
        """Return the shape as a state places it."""
        return PlacedShape(state, self.body_m, self.body_covariance_m2)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A shape placed by the predicted state."""

    placed: PlacedShape
    transition: NDArray[np.float64]
    """(size, size) F, from the errors of the frame before."""
    covariance: NDArray[np.float64]
    """(size, size) P, of the errors of the state."""
    turned: NDArray[np.float64]
    """(3,) rotation vector of the body since the frame before, by which end caps roll away from their footholds."""

    def then(self, placed: PlacedShape, F: NDArray[np.float64], variance: NDArray[np.float64]) -> "Prediction":
        """Return the prediction after a further change, F P F^T + V.

        Args:
            placed: the shape after it.
            F: (size, size) its derivative.
            variance: (size,) that it adds, the diagonal of V.
        """
        covariance = F @ self.covariance @ F.T
        covariance[np.diag_indices(len(variance))] += variance
        return Prediction(placed, F @ self.transition, covariance, self.turned)

    def corrected(self, rows: Rows) -> tuple[PoseState, NDArray[np.float64]]:
        """Return the state and (size, size) its covariance after the correction by rows.

        S = H P H^T + V,   K = P H^T S^-1,   d = K e,   P <- P - K S K^T

        Errors that are considered stay as they are: their rows of K are zero, and their block of P stays (Schmidt).
        """
        considered = self.placed.state.layout.considered
        by_rows = self.covariance @ rows.jacobian.T
        S = rows.jacobian @ by_rows
        S[np.diag_indices(len(S))] += rows.variance
        K = np.linalg.solve(S, by_rows.T).T
        covariance = self.covariance - K @ by_rows.T
        covariance[considered, considered] = self.covariance[considered, considered]
        K[considered] = 0.0
        return self.placed.state.moved(K @ rows.error), 0.5 * (covariance + covariance.T)

    def given(self, rows: Rows) -> "Prediction":
        """Return what is expected where some of the rows of the frame are known."""
        state, covariance = self.corrected(rows)
        return Prediction(self.placed.at(state), self.transition, covariance, self.turned)

    def corrected_blindly(self, rows: Rows, floor: Floor) -> tuple[PoseState, NDArray[np.float64]]:
        """Return the same for rows that say nothing of the heading, see `without_heading`.

        With the direction N of a turn of all about the floor's normal n, P follows N to N' at the corrected state:

            P <- J P J^T,     J = 1 + a n^T,     a = N' - N
        """
        before = self.placed.state
        state, covariance = self.corrected(rows)
        at, n = before.layout, floor.tilted(before.floor_tilt).normal
        moved = heading_direction(state, floor) - heading_direction(before, floor)
        with_turn = covariance[:, at.turn] @ n
        followed = np.outer(moved, with_turn + 0.5 * (n @ with_turn[at.turn]) * moved)
        return state, covariance + followed + followed.T


def without_heading(rows: Rows, state: PoseState, floor: Floor) -> Rows:
    """Return rows that no turn of all about the floor's normal changes without what they seem to say of it.

    Those of floor, footholds and rods are such rows. With the direction N of such a turn in the errors of the state,
    H N = 0. Linearised where the state is wrong by some degrees it is not, so that the heading would seem to become
    known, the more so the longer the structure rests (Huang et al. 2010, observability):

        H <- H - H N n^T
    """
    return without_turn(rows, heading_direction(state, floor), state, floor.tilted(state.floor_tilt).normal)


def without_turn(rows: Rows, N: NDArray[np.float64], state: PoseState, n: NDArray[np.float64]) -> Rows:
    """Return rows that say nothing of one turn of all, H <- H - H N n^T.

    Args:
        rows: that no such turn changes.
        N: (size,) derivative of the state's errors by the turn.
        state: at which the rows are linearised.
        n: (3,) unit vector along the axis of the turn.
    """
    H = rows.jacobian.copy()
    H[:, state.layout.turn] -= np.outer(H @ N, n)
    return Rows(rows.error, H, rows.variance)


def following_heading(
    F: NDArray[np.float64], before: PoseState, after: PoseState, floor: Floor, falls_s: float
) -> NDArray[np.float64]:
    """Return (size, size) the transition F of a time step, by which a turn of all before it is one after it.

    A turn of all about the floor's normal n turns the motion as well, but not gravity, so that with its directions N
    and N' before and after the step of dt

        F N = N' + (0, dt / 2 a, 0, a, 0, ...),     a = g dt n x z

    where the velocity is integrated from specific forces, which are measured in axes that turn; elsewhere a = 0.
    Linearised at each state for itself, F N is another, and rows that tell the motion would tell the heading as well:
    that of a robot that may head anywhere seemed known to some degrees after a tip.

        F <- F - (F N - N' - ...) n^T

    Args:
        F: (size, size) as linearised.
        before: the state before the step.
        after: the state after it.
        floor: the floor as told.
        falls_s: dt where specific forces tell the velocity; 0 elsewhere.
    """
    at, n = before.layout, floor.tilted(before.floor_tilt).normal
    fallen = GRAVITY_M_PER_S2 * falls_s * cross(n, UP)
    miss = F @ heading_direction(before, floor) - heading_direction(after, floor)
    miss[at.velocity] -= fallen
    miss[at.position] -= 0.5 * falls_s * fallen
    F = F.copy()
    F[:, at.turn] -= np.outer(miss, n)
    return F


@lru_cache(maxsize=8)  # a frame asks several times for the state before it, as predicted, and as corrected
def heading_direction(state: PoseState, floor: Floor) -> NDArray[np.float64]:
    """Return (size,) N, the derivative of the state's errors by a turn of all about the floor's normal, as estimated.

    Robot, footholds and sensors turn: N = (n, n x p, n x w, n x v, E (n x c), n for each sensor, 0, ...), with c on the
    floor. The turn is about the origin of the world.
    """
    at, tilted = state.layout, floor.tilted(state.floor_tilt)
    n = tilted.normal
    N = np.zeros(at.size)
    N[at.turn] = n
    foothold_m = state.foothold_m @ floor.axes
    on_floor_m = foothold_m - np.outer(tilted.clearance_m(foothold_m) / (floor.normal @ n), floor.normal)
    vectors = np.vstack([state.position_m, state.rate_rad_per_s, state.velocity_m_per_s, on_floor_m])
    N[at.position], N[at.rate], N[at.velocity], *of_footholds = vectors @ cross_matrix(n).T
    N[at.foothold] = (np.array(of_footholds) @ floor.axes.T).ravel()
    N[at.imu_turn] = np.tile(n, len(state.imu_turn))
    return N
