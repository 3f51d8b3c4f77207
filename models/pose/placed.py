"""A shape placed in the world by a pose, and the rows in which aids say what the state is wrong by."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..structure.shape import node_blocks, pair_blocks
from ..values.rotations import cross_matrix
from .pose_state import PoseState


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """A shape in the world, as a state places it."""

    state: PoseState
    body_m: NDArray[np.float64]
    """(nodes, 3) body coordinates relative to c, see `PoseState`."""
    body_covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes) covariance of the shape in body axes."""

    def at(self, state: PoseState) -> "PlacedShape":
        """Return the same shape as another state places it."""
        return PlacedShape(state, self.body_m, self.body_covariance_m2)

    @cached_property
    def arm_m(self) -> NDArray[np.float64]:
        """(nodes, 3) from p to each node, in world axes."""
        return np.asarray(self.body_m @ self.state.turn.T)

    @cached_property
    def node_position_m(self) -> NDArray[np.float64]:
        """(nodes, 3) in the world."""
        return np.asarray(self.state.position_m + self.arm_m)

    @cached_property
    def shape_covariance_m2(self) -> NDArray[np.float64]:
        """(3 nodes, 3 nodes) covariance of the shape, in world axes."""
        size, turn = len(self.body_covariance_m2), self.state.turn
        by_columns = (self.body_covariance_m2.reshape(-1, 3) @ turn.T).reshape(-1, 3, size)
        return np.asarray(turn @ by_columns).reshape(size, size)

    @cached_property
    def covariance_m2(self) -> NDArray[np.float64]:
        """(nodes, nodes, 3, 3) covariance of the shape, in world axes, for each pair of nodes."""
        return pair_blocks(self.shape_covariance_m2)

    @cached_property
    def node_covariance_m2(self) -> NDArray[np.float64]:
        """(nodes, 3, 3) covariance of the shape at each node, in world axes."""
        return np.asarray(self.state.turn @ node_blocks(self.body_covariance_m2) @ self.state.turn.T)

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """(nodes, 3, size) derivatives of the nodes' positions by the errors of the state."""
        at = self.state.layout
        jacobian = np.zeros((len(self.body_m), 3, at.size))
        jacobian[:, :, at.turn] = -cross_matrix(self.arm_m)
        jacobian[:, :, at.position] = np.eye(3)
        return jacobian

    def total_covariance_m2(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3 nodes, 3 nodes), the covariance of all coordinates in the world, by pose and shape.

        Args:
            covariance: (size, size) of the errors of the state.
        """
        count = len(self.body_m)
        at = self.state.layout.pose
        by_pose = self.jacobian[:, :, at].reshape(3 * count, -1)
        return np.asarray(by_pose @ covariance[at, at] @ by_pose.T + self.shape_covariance_m2)

    def height_covariance_m2(self, normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, nodes), the covariance of the shape along a (3,) unit vector of the world."""
        count, n = len(self.body_m), self.state.turn.T @ normal
        return np.asarray(n @ (self.body_covariance_m2.reshape(-1, 3) @ n).reshape(count, 3, count))


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What some measurement says of the errors d of a state: error = jacobian d + noise."""

    error: NDArray[np.float64]
    """(rows,) measured minus predicted."""
    jacobian: NDArray[np.float64]
    """(rows, size) derivative of the predicted by d."""
    variance: NDArray[np.float64]
    """(rows,) of the noise."""

    def lasting(self, repeats: float) -> "Rows":
        """Return the rows of an error that lasts for some frames, so that each of them counts for less."""
        return Rows(self.error, self.jacobian, repeats * self.variance)


def put_blocks(
    matrix: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64], blocks: NDArray[np.float64]
) -> None:
    """Set matrix[rows[k], columns[k]] = blocks[k] for each of some blocks.

    Args:
        matrix: of any shape that holds them.
        rows: (blocks, m)
        columns: (blocks, n)
        blocks: (blocks, m, n)
    """
    matrix[rows[:, :, None], columns[:, None, :]] = blocks


def stacked(rows: Sequence[Rows]) -> Rows:
    """Return all rows as one."""
    return Rows(
        np.concatenate([part.error for part in rows]),
        np.concatenate([part.jacobian for part in rows]),
        np.concatenate([part.variance for part in rows]),
    )
