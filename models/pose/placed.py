"""A shape placed in the world by a pose, and the rows in which aids say what the state is wrong by."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..structure.shape import node_blocks
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

    @cached_property
    def arm_m(self) -> NDArray[np.float64]:
        """(nodes, 3) from p to each node, in world axes."""
        return np.asarray(self.body_m @ self.state.turn.T)

    @cached_property
    def node_position_m(self) -> NDArray[np.float64]:
        """(nodes, 3) in the world."""
        return np.asarray(self.state.position_m + self.arm_m)

    @cached_property
    def covariance_m2(self) -> NDArray[np.float64]:
        """(nodes, nodes, 3, 3) covariance of the shape, in world axes, for each pair of nodes."""
        count = len(self.body_m)
        blocks = self.body_covariance_m2.reshape(count, 3, count, 3).swapaxes(1, 2)
        return np.asarray(self.state.turn @ blocks @ self.state.turn.T)

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
        of_shape = self.covariance_m2.swapaxes(1, 2).reshape(3 * count, 3 * count)
        return np.asarray(by_pose @ covariance[at, at] @ by_pose.T + of_shape)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What some measurement says of the errors d of a state: error = jacobian d + noise."""

    error: NDArray[np.float64]
    """(rows,) measured minus predicted."""
    jacobian: NDArray[np.float64]
    """(rows, size) derivative of the predicted by d."""
    variance: NDArray[np.float64]
    """(rows,) of the noise."""


def stacked(rows: Sequence[Rows]) -> Rows:
    """Return all rows as one."""
    return Rows(
        np.concatenate([part.error for part in rows]),
        np.concatenate([part.jacobian for part in rows]),
        np.concatenate([part.variance for part in rows]),
    )
