"""One frame of a pose filter: what is known of it beside the state, and what is expected before its aids are read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.pose.imu_samples import ImuSamples
from ...models.pose.placed import PlacedShape, Rows
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import Floor
from ...models.values.aids import AidReading, PositionReading, RangeReading
from ...models.values.rotations import cross


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
    aids: Sequence[AidReading]
    samples: ImuSamples | None
    """Of the inertial sensors; None without such sensors."""

    @property
    def positions(self) -> list[PositionReading]:
        """Those of the aids that are positions of nodes."""
        return [reading for reading in self.aids if isinstance(reading, PositionReading)]

    @property
    def ranges(self) -> list[RangeReading]:
        """Those of the aids that are ranges to nodes."""
        return [reading for reading in self.aids if isinstance(reading, RangeReading)]


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

        Errors of own frames of positions are considered and stay as they are: their rows of K are zero, and their block
        of P stays (Schmidt).
        """
        considered = self.placed.state.layout.own_frame
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
        placed = PlacedShape(state, self.placed.body_m, self.placed.body_covariance_m2)
        return Prediction(placed, self.transition, covariance, self.turned)

    def corrected_blindly(self, rows: Rows, floor: Floor) -> tuple[PoseState, NDArray[np.float64]]:
        """Return the same for rows that no turn of all about the floor's normal changes: those of floor and footholds.

        With the direction N of such a turn in the errors of the state, H N = 0. Linearised where the state is wrong by
        some degrees it is not, so that the heading would seem to become known, the more so the longer the structure
        rests. H loses what it says of N, and P follows N to the corrected state (Huang et al. 2010, observability):

            H <- H - H N n^T,     P <- J P J^T,     J = 1 + (N' - N) n^T
        """
        before = self.placed.state
        H = rows.jacobian.copy()
        turn = before.layout.turn
        N = heading_direction(before, floor)
        H[:, turn] -= np.outer(H @ N, floor.normal)
        state, covariance = self.corrected(Rows(rows.error, H, rows.variance))
        J = np.eye(len(covariance))
        J[:, turn] += np.outer(heading_direction(state, floor) - N, floor.normal)
        return state, J @ covariance @ J.T


def heading_direction(state: PoseState, floor: Floor) -> NDArray[np.float64]:
    """Return (size,) N, the derivative of the state's errors by a turn of robot and footholds about the normal.

    N = (n, n x p, n x w, n x v, E (n x c), ...): the turn is about the origin of the world.
    """
    at, n = state.layout, floor.normal
    N = np.zeros(at.size)
    N[at.turn] = n
    for part, vector in (
        (at.position, state.position_m),
        (at.rate, state.rate_rad_per_s),
        (at.velocity, state.velocity_m_per_s),
    ):
        N[part] = cross(n, vector)
    N[at.foothold] = (cross(n, state.foothold_m @ floor.axes) @ floor.axes.T).ravel()
    return N
