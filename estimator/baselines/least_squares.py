"""The paper's method, for comparison: nonlinear least squares, frame by frame."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...factors.noise import tendon_sigma_m
from ...models.settings import Settings
from ...models.structure.lengths import length_jacobian, member_length_m
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Shape, Status
from ...models.structure.structure import Structure
from ...models.values.readings import TendonLengths
from ..graph import status_of


class LeastSquares:
    """The paper's method: eqs. (5)-(7) solved in each frame, starting from the solution of the frame before.

    There is no prior, and no memory except the start. The covariance is (J^T W J)^-1, with a sigma of one rod's length
    along the directions that lengths do not determine, and that of the rest shape, from which lengths are tared. Nodes
    move along arcs, whose radius is about a rod's length L: one that may be d off along its arc may be d^2 / L off
    across it, which no Jacobian shows.
    """

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._structure = structure
        self._noise = settings.noise
        self._position = rest.node_position_m
        self._rest_covariance_m2 = rest.covariance_m2

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape of one more frame."""
        from scipy.optimize import least_squares  # imported for this method alone

        structure = self._structure
        sigma_m = tendon_sigma_m(lengths, self._noise)
        usable = np.flatnonzero(np.isfinite(sigma_m))
        members = np.concatenate([structure.rods, structure.tendons[usable]])
        target_m = np.concatenate([structure.rod_length_m, lengths.length_m[usable]])
        weight = 1 / np.concatenate([np.full(len(structure.rods), self._noise.rod_m), sigma_m[usable]])

        def residual(x: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray((member_length_m(structure.position_m(x), members) - target_m) * weight)

        def jacobian(x: NDArray[np.float64]) -> NDArray[np.float64]:
            return length_jacobian(structure.position_m(x), members, structure.free_coordinates) * weight[:, None]

        solution = least_squares(residual, self._position[structure.free_nodes].ravel(), jacobian)
        self._position = structure.position_m(solution.x)
        status = status_of(lengths, structure) if solution.success else Status.NOT_CONVERGED
        return Shape(
            t_s=lengths.t_s,
            node_position_m=self._position,
            covariance_m2=self._covariance(solution.jac),
            status=status,
            lengths=lengths,
        )

    def _covariance(self, jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (3 nodes, 3 nodes) covariance from the Jacobian of the weighted residuals."""
        free = self._structure.free_coordinates
        covariance = np.diag(np.full(3 * self._structure.node_count, self._noise.anchor_m**2))
        information, motion = np.linalg.eigh(jacobian.T @ jacobian)
        radius_m = self._structure.rod_length_m.max()
        along_m2 = (motion / np.maximum(information, radius_m**-2)) @ motion.T
        across_m = np.diag(along_m2).reshape(-1, 3).sum(axis=1) / radius_m
        covariance[np.ix_(free, free)] = along_m2 + np.diag(np.repeat(across_m**2, 3))
        return covariance + self._rest_covariance_m2
