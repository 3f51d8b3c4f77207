"""Rods that share free nodes are joined: the force along one shows at the others.

With J = d(rod lengths)/dx of all joined rods, they take any force J^T q, and the residual at their nodes is what is
left of f:

    r = f - J^T q = (I - J^+ J) f,    q = (J^T)^+ f

that is, f along the motions that the joined rods allow. A rigid body of n nodes leaves 6 of 3 n components.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..structure.lengths import length_jacobian, member_length_m
from ..structure.structure import Structure

JOINED_RCOND = 1e-2
"""Share of the largest singular value of J below which joined rods take no force: such as across a flat frame, whose
rods resist a push only when it has bent."""

TAKEN_ENTIRELY = 1e-9
"""Components of a force that rods cannot take, below which they take all of it: zero but for rounding."""


class JoinedRods:
    """The rods that share free nodes, and the part of forces at these nodes that they cannot take.

    All positions may have leading axes.
    """

    def __init__(self, structure: Structure) -> None:
        rods = structure.rods
        is_free = ~np.isin(np.arange(structure.node_count), structure.anchors)
        shared = is_free & (np.bincount(rods.ravel(), minlength=structure.node_count) > 1)
        self.is_joined = shared[rods].any(axis=1)
        """(rods,)"""
        self.rods = rods[self.is_joined]
        """(joined rods, 2) node pairs."""
        self.nodes = np.flatnonzero(is_free & np.isin(np.arange(structure.node_count), self.rods))
        """(joined nodes,) the free nodes of joined rods."""
        self.coordinates = (3 * self.nodes[:, None] + np.arange(3)).ravel()
        """(3 joined nodes,) the indices of their coordinates among all (3 nodes,)."""
        self._node_count = structure.node_count

    @cached_property
    def rows_per_node(self) -> NDArray[np.float64]:
        """(joined nodes,) the components of a force that the rods cannot take, of 3 at each node; in general shape.

        It is 0 at a node that rods alone hold.
        """
        x = np.random.default_rng(0).normal(size=(self._node_count, 3))
        rows = np.diag(self.allowed(x)).reshape(len(self.nodes), 3).sum(axis=1)
        return np.where(rows > TAKEN_ENTIRELY, rows, 0.0)

    def allowed(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3 joined nodes, 3 joined nodes), the projector I - J^+ J onto the motions that rods allow."""
        jacobian, inverse = self._jacobian(node_position_m)
        return np.asarray(np.eye(len(self.coordinates)) - inverse @ jacobian)

    def by_position(
        self, node_position_m: NDArray[np.float64], force_n: NDArray[np.float64], by_position: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (..., 3 joined nodes, 3 nodes), the derivative of the residual by all coordinates.

        With the residual r = A f, A = I - J^+ J, and the forces q along the rods:

            dr = A df - J^+ dJ r - A dJ^T q

        Args:
            node_position_m: (..., nodes, 3)
            force_n: (..., 3 joined nodes) f.
            by_position: (..., 3 joined nodes, 3 nodes) df/dx.
        """
        x, count = node_position_m, self._node_count
        jacobian, inverse = self._jacobian(x)
        allowed = np.eye(len(self.coordinates)) - inverse @ jacobian
        a, b = self.rods.T
        along = x[..., b, :] - x[..., a, :]
        length_m = member_length_m(x, self.rods)[..., None]
        w = along / length_m
        turn = (np.eye(3) - w[..., :, None] * w[..., None, :]) / length_m[..., None]  # dw/dx_b
        along_n = np.swapaxes(inverse, -1, -2) @ force_n[..., None]
        stiffness = np.zeros((*x.shape[:-2], count, count, 3, 3))
        for one, other, pull in ((a, a, along_n), (b, b, along_n), (a, b, -along_n), (b, a, -along_n)):
            for rod in range(len(self.rods)):
                stiffness[..., one[rod], other[rod], :, :] += (pull[..., None] * turn)[..., rod, :, :]
        stiffness = np.swapaxes(stiffness, -3, -2).reshape(*x.shape[:-2], 3 * count, 3 * count)
        residual = np.zeros_like(x)
        residual[..., self.nodes, :] = (allowed @ force_n[..., None]).reshape(*x.shape[:-2], -1, 3)
        change = (turn @ (residual[..., b, :] - residual[..., a, :])[..., None])[..., 0]
        by_turn = np.zeros((*x.shape[:-2], len(self.rods), count, 3))
        row = np.arange(len(self.rods))
        by_turn[..., row, b, :] = change
        by_turn[..., row, a, :] = -change
        by_turn = by_turn.reshape(*by_turn.shape[:-2], -1)
        return np.asarray(allowed @ (by_position - stiffness[..., self.coordinates, :]) - inverse @ by_turn)

    def _jacobian(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., joined rods, 3 joined nodes) J, and its pseudoinverse J^+."""
        jacobian = length_jacobian(x, self.rods, self.coordinates)
        return jacobian, np.asarray(np.linalg.pinv(jacobian, rcond=JOINED_RCOND), dtype=np.float64)
