"""A frame's own factors, linearised at a shape: what lengths, rods, forces and the shape prior say of a small step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..factors.body_frame import BODY_FRAME_M
from ..factors.equilibrium import squared_norms
from ..factors.noise import WeightedLengths
from ..models.structure.lengths import member_length_m
from ..models.structure.rigidity import free_length_jacobian
from .graph import GraphBuilder


@dataclass(frozen=True, slots=True, eq=False)
class LinearFrame:
    """Residuals of one frame's factors at a shape, and their derivatives by the free coordinates.

    Members are the rods and then the free tendons.
    """

    length_error_m: NDArray[np.float64]
    """(members,) length at the shape minus the known or measured one; 0 for a tendon that is left out."""
    length_jacobian: NDArray[np.float64]
    """(members, free)"""
    weight_per_m: NDArray[np.float64]
    """(members,) one over sigma; 0 for a tendon that is left out."""
    shared_m2: NDArray[np.float64] | None
    """(free tendons, free tendons) covariance of the errors of the measured lengths, where they are correlated."""
    force_n: NDArray[np.float64]
    """(rows,) residuals of `Statics`; no rows without mechanics."""
    force_jacobian: NDArray[np.float64]
    """(rows, free)"""
    force_weight_per_n: NDArray[np.float64]
    """(rows,) sqrt of the information of each row: one over sigma, less at nodes that are loaded (Cauchy's kernel)."""
    force_sigma_n: NDArray[np.float64]
    """(rows,) standard deviation of the balance of forces at a node without load."""
    from_prior_m: NDArray[np.float64]
    """(free,) coordinates minus those of the rest shape, about which the shape prior is."""
    prior_m: float
    """Standard deviation of the shape prior."""
    fixed_motions: NDArray[np.float64]
    """(motions, free) rigid motions that are fixed; no rows with three anchors."""

    def without_forces(self, share: float = 1.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (free, free) the information of lengths and shape prior, and (free,) the gradient of their error.

        Args:
            share: of the lengths' information that counts.
        """
        error, lengths = self.weighted_lengths
        information = share * (lengths.T @ lengths) + np.eye(len(self.from_prior_m)) / self.prior_m**2
        gradient = share * (lengths.T @ error) + self.from_prior_m / self.prior_m**2
        if len(self.fixed_motions):
            information += self.fixed_motions.T @ self.fixed_motions / BODY_FRAME_M**2
            gradient += self.fixed_motions.T @ (self.fixed_motions @ self.from_prior_m) / BODY_FRAME_M**2
        return information, gradient

    def with_forces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (free, free) the information of all factors, and (free,) the gradient, zero at their minimum."""
        information, gradient = self.without_forces()
        forces = self.force_jacobian * self.force_weight_per_n[:, None]
        pull = self.force_jacobian.T @ (self.force_weight_per_n / self.force_sigma_n * self.force_n)
        return information + forces.T @ forces, gradient + pull

    @property
    def weighted_lengths(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (members,) errors and (members, free) Jacobian of the lengths over their sigma."""
        error = self.length_error_m * self.weight_per_m
        jacobian = self.length_jacobian * self.weight_per_m[:, None]
        if self.shared_m2 is None:
            return error, jacobian
        tendons = slice(len(error) - len(self.shared_m2), None)
        weight = self.weight_per_m[tendons]
        correlation = self.shared_m2 * weight[:, None] * weight
        np.fill_diagonal(correlation, 1.0)
        rows = np.column_stack([error[tendons], jacobian[tendons]])
        whitened = np.linalg.solve(np.linalg.cholesky(correlation), rows)
        error[tendons] = whitened[:, 0]
        jacobian[tendons] = whitened[:, 1:]
        return error, jacobian


def linearised(builder: GraphBuilder, node_position_m: NDArray[np.float64], measured: WeightedLengths) -> LinearFrame:
    """Return the factors of a frame, linearised at (nodes, 3) positions."""
    structure = builder.structure
    free = structure.free_coordinates
    tendons = structure.free_tendons
    sigma_m = measured.sigma_m[tendons]
    usable = np.isfinite(sigma_m)
    length_m = member_length_m(node_position_m, structure.free_members)
    known_m = np.concatenate([structure.rod_length_m, measured.lengths.length_m[tendons]])
    used = np.concatenate([np.ones(len(structure.rods), dtype=np.bool_), usable])
    weight = np.concatenate([np.full(len(structure.rods), 1 / builder.noise.rod_m), 1 / sigma_m])
    if builder.statics:
        force_n, by_position = builder.statics.residual_and_jacobian(node_position_m)
        by_position = by_position[:, free]
        force_weight = 1 / (1 + squared_norms(force_n / builder.force_sigma_n, builder.statics)) / builder.force_sigma_n
    else:
        force_n = force_weight = np.zeros(0)
        by_position = np.zeros((0, len(free)))
    drift = measured.lengths.drift
    shared_m2 = None
    if drift is not None and drift.covariance_m2 is not None:
        shared_m2 = measured.scale**2 * drift.covariance_m2[np.ix_(tendons, tendons)]
    return LinearFrame(
        length_error_m=np.where(used, length_m - known_m, 0.0),
        length_jacobian=free_length_jacobian(structure, node_position_m),
        weight_per_m=weight,
        shared_m2=shared_m2,
        force_n=force_n,
        force_jacobian=by_position,
        force_weight_per_n=force_weight,
        force_sigma_n=builder.force_sigma_n,
        from_prior_m=(node_position_m - builder.rest.node_position_m).ravel()[free],
        prior_m=builder.noise.shape_prior_m,
        fixed_motions=builder.fixed_motions[:, free],
    )
