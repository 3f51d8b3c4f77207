"""A frame's own factors, linearised at a shape: what lengths, rods, forces and the shape prior say of a small step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..factors.body_frame import BODY_FRAME_M
from ..factors.equilibrium import cauchy_weight
from ..factors.noise import WeightedLengths, independent_rows, robust_loss, stacked_shared
from ..factors.own import own_rows, own_weight
from ..models.balance.statics import Statics
from ..models.structure.lengths import length_and_jacobian
from ..models.values.readings import NodeFactor
from .graph import GraphBuilder


@dataclass(frozen=True, slots=True, eq=False)
class FrameData:
    """What the factors of a frame are made of; leading axes, the same in all, are frames."""

    length_m: NDArray[np.float64]
    """(..., tendons) measured lengths; of those that are left out, any number or nan."""
    sigma_m: NDArray[np.float64]
    """(..., tendons) their standard deviations in the graph; inf for a tendon that is left out."""
    drift_m2: NDArray[np.float64] | None
    """(..., tendons, tendons) covariance of the errors of the lengths by drift, where it was estimated."""
    shared: NDArray[np.float64] | None
    """(..., tendons) the part of the errors that all sensors share, over sigma_m; None where errors are independent."""
    statics: Statics | None
    """The balance of forces; None without mechanics."""
    force_sigma_n: NDArray[np.float64]
    """(..., rows) its standard deviation at a node without load."""
    t_s: NDArray[np.float64]
    """(...,) time of each frame."""
    factors: tuple[NodeFactor, ...]
    """What else says something of the nodes."""

    @classmethod
    def of(cls, builder: GraphBuilder, measured: WeightedLengths) -> "FrameData":
        """Return those of one frame, near the shape that the builder has approached."""
        length_m, sigma_m = measured.lengths.length_m, measured.sigma_m
        return cls(
            length_m=length_m,
            sigma_m=sigma_m,
            drift_m2=_drift_m2(measured),
            shared=measured.shared,
            statics=builder.statics,
            force_sigma_n=builder.force_sigma_n,
            t_s=np.array(measured.lengths.t_s),
            factors=measured.lengths.factors,
        )

    @classmethod
    def stacked(
        cls, measured: Sequence[WeightedLengths], statics: Statics | None, force_sigma_n: NDArray[np.float64]
    ) -> "FrameData":
        """Return those of several frames.

        Args:
            measured: the lengths of each.
            statics: the balance of forces in these frames; None without mechanics.
            force_sigma_n: (frames, rows) its standard deviation at a node without load.
        """
        drift = [_drift_m2(one) for one in measured]
        drift_m2 = None
        if any(one is not None for one in drift):
            none = np.zeros((measured[0].sigma_m.size,) * 2)
            drift_m2 = np.array([none if one is None else one for one in drift])
        return cls(
            length_m=np.array([one.lengths.length_m for one in measured]),
            sigma_m=np.array([one.sigma_m for one in measured]),
            drift_m2=drift_m2,
            shared=stacked_shared(measured),
            statics=statics,
            force_sigma_n=force_sigma_n,
            t_s=np.array([one.lengths.t_s for one in measured]),
            factors=measured[0].lengths.factors,
        )


def _drift_m2(measured: WeightedLengths) -> NDArray[np.float64] | None:
    """Return (tendons, tendons) the covariance of the lengths' errors by drift; None where it is not estimated."""
    drift = measured.lengths.drift
    if drift is None or drift.covariance_m2 is None:
        return None
    return np.asarray(measured.scale**2 * drift.covariance_m2)


@dataclass(frozen=True, slots=True, eq=False)
class LinearFrame:
    """Residuals of one frame's factors at a shape, and their derivatives by the free coordinates.

    Members are the rods and then the free tendons. Leading axes are frames; what has none is the same in all frames.
    """

    length_error_m: NDArray[np.float64]
    """(..., members) length at the shape minus the known or measured one; 0 for a tendon that is left out."""
    length_jacobian: NDArray[np.float64]
    """(..., members, free)"""
    weight_per_m: NDArray[np.float64]
    """(..., members) one over sigma, less where a robust kernel weighs less; 0 for a tendon that is left out."""
    drift_m2: NDArray[np.float64] | None
    """(..., free tendons, free tendons) covariance of their errors by drift, as in `FrameData`."""
    shared: NDArray[np.float64] | None
    """(..., free tendons) the part of these errors that all sensors share, over sigma, as in `FrameData`."""
    force_n: NDArray[np.float64]
    """(..., rows) residuals of `Statics`; no rows without mechanics."""
    force_jacobian: NDArray[np.float64]
    """(..., rows, free)"""
    force_weight_per_n: NDArray[np.float64]
    """(..., rows) sqrt of the information of each row: one over sigma, less at loaded nodes (Cauchy's kernel)."""
    force_sigma_n: NDArray[np.float64]
    """(..., rows) standard deviation of the balance of forces at a node without load."""
    from_prior_m: NDArray[np.float64]
    """(..., free) coordinates minus those of the rest shape, about which the shape prior is."""
    prior_m: float
    """Standard deviation of the shape prior."""
    fixed_motions: NDArray[np.float64]
    """(motions, free) rigid motions that are fixed; no rows with three anchors."""
    own_error: NDArray[np.float64]
    """(..., rows) residuals of factors of one's own over sigma; 0 where nothing is read, no rows without factors."""
    own_jacobian: NDArray[np.float64]
    """(..., rows, free)"""
    own_weight: NDArray[np.float64]
    """(..., rows) weights of their kernel."""

    def without_forces(
        self, share: float | NDArray[np.float64] = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., free, free) the information of all but forces, and (..., free) their error's gradient.

        Args:
            share: (...,) of the lengths' information that counts.
        """
        error, lengths = self.weighted_lengths
        share = np.asarray(share)[..., None]
        information = share[..., None] * (np.swapaxes(lengths, -1, -2) @ lengths)
        information += np.eye(self.from_prior_m.shape[-1]) / self.prior_m**2
        gradient = share * _product(np.swapaxes(lengths, -1, -2), error) + self.from_prior_m / self.prior_m**2
        if len(self.fixed_motions):
            moved = _product(self.fixed_motions, self.from_prior_m)
            information += self.fixed_motions.T @ self.fixed_motions / BODY_FRAME_M**2
            gradient += _product(self.fixed_motions.T, moved) / BODY_FRAME_M**2
        if self.own_error.shape[-1]:
            own_information, own_gradient = self.own
            information += own_information
            gradient += own_gradient
        return information, gradient

    def with_forces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., free, free) the information of all factors, and (..., free) their error's gradient."""
        information, gradient = self.without_forces()
        forces = self.force_jacobian * self.force_weight_per_n[..., None]
        pull = _product(np.swapaxes(self.force_jacobian, -1, -2), self.force_pull)
        return information + np.swapaxes(forces, -1, -2) @ forces, gradient + pull

    @property
    def force_pull(self) -> NDArray[np.float64]:
        """(..., rows) derivative of the error by the residuals of the balance, with Cauchy's kernel."""
        return np.asarray(self.force_weight_per_n / self.force_sigma_n * self.force_n)

    @property
    def own(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., free, free) the information of factors of one's own, and (..., free) their error's gradient."""
        weighted = np.swapaxes(self.own_jacobian * self.own_weight[..., None], -1, -2)
        return weighted @ self.own_jacobian, _product(weighted, self.own_error)

    @property
    def weighted_lengths(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (..., members) errors and (..., members, free) Jacobian of the lengths over their sigma."""
        error = self.length_error_m * self.weight_per_m
        jacobian = self.length_jacobian * self.weight_per_m[..., None]
        correlated = self.shared if self.drift_m2 is None else self.drift_m2
        if correlated is None:
            return error, jacobian
        tendons = slice(error.shape[-1] - correlated.shape[-1], None)
        rows = np.concatenate([error[..., tendons, None], jacobian[..., tendons, :]], axis=-1)
        rows = self._independent(rows, self.weight_per_m[..., tendons])
        error[..., tendons] = rows[..., 0]
        jacobian[..., tendons, :] = rows[..., 1:]
        return error, jacobian

    def weighted_with(
        self, by_other: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return `weighted_lengths`, and (..., members, n) the errors' derivatives by n other quantities likewise."""
        by_both = np.concatenate([self.length_jacobian, by_other], axis=-1)
        error, by_both = replace(self, length_jacobian=by_both).weighted_lengths
        size = self.length_jacobian.shape[-1]
        return error, by_both[..., :size], by_both[..., size:]

    def _independent(self, rows: NDArray[np.float64], weight_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., free tendons, n) rows of lengths over their sigma as rows whose errors are independent, too."""
        if self.drift_m2 is None:
            assert self.shared is not None, "rows that are independent already"
            return independent_rows(rows, self.shared)
        correlation = self.drift_m2 * weight_per_m[..., :, None] * weight_per_m[..., None, :]
        if self.shared is not None:
            correlation += self.shared[..., :, None] * self.shared[..., None, :]
        each = np.arange(correlation.shape[-1])
        correlation[..., each, each] = 1.0
        return np.linalg.solve(np.linalg.cholesky(correlation), rows)


def _product(matrix: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., rows), a (..., rows, n) matrix times a (..., n) vector."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def linearised(builder: GraphBuilder, node_position_m: NDArray[np.float64], measured: WeightedLengths) -> LinearFrame:
    """Return the factors of a frame, linearised at (nodes, 3) positions."""
    return linearised_frames(builder, node_position_m, FrameData.of(builder, measured))


def linearised_frames(builder: GraphBuilder, node_position_m: NDArray[np.float64], data: FrameData) -> LinearFrame:
    """Return the factors of frames, linearised at (..., nodes, 3) positions."""
    structure = builder.structure
    free = structure.free_coordinates
    tendons = structure.free_tendons
    lead = node_position_m.shape[:-2]
    rods = (*lead, len(structure.rods))
    sigma_m = data.sigma_m[..., tendons]
    length_m, by_length = length_and_jacobian(node_position_m, structure.free_members, free)
    known_m = np.concatenate([np.broadcast_to(structure.rod_length_m, rods), data.length_m[..., tendons]], axis=-1)
    used = np.concatenate([np.ones(rods, dtype=np.bool_), np.isfinite(sigma_m)], axis=-1)
    length_error_m = np.where(used, length_m - known_m, 0.0)
    of_tendons = length_error_m[..., len(structure.rods) :] / sigma_m
    weight_per_m = np.sqrt(robust_loss(of_tendons**2, builder.noise.robust)[1]) / sigma_m
    if data.statics:
        force_n, by_position = data.statics.residual_and_jacobian(node_position_m)
        by_position = by_position[..., free]
        force_weight = cauchy_weight(force_n / data.force_sigma_n, data.statics) / data.force_sigma_n
    else:
        force_n = force_weight = np.zeros((*lead, 0))
        by_position = np.zeros((*lead, 0, len(free)))
    own_error, by_own = np.zeros((*lead, 0)), np.zeros((*lead, 0, len(free)))
    if data.factors:
        own_error, by_own = own_rows(data.factors, data.t_s, node_position_m)
        by_own = by_own[..., free]
    from_rest_m = node_position_m - builder.rest.node_position_m
    return LinearFrame(
        length_error_m=length_error_m,
        length_jacobian=by_length,
        weight_per_m=np.concatenate([np.full(rods, 1 / builder.noise.rod_m), weight_per_m], axis=-1),
        drift_m2=None if data.drift_m2 is None else data.drift_m2[..., tendons[:, None], tendons],
        shared=None if data.shared is None else data.shared[..., tendons],
        force_n=force_n,
        force_jacobian=by_position,
        force_weight_per_n=force_weight,
        force_sigma_n=data.force_sigma_n,
        from_prior_m=from_rest_m.reshape(*lead, -1)[..., free],
        prior_m=builder.noise.shape_prior_m,
        fixed_motions=builder.fixed_motions[:, free],
        own_error=own_error,
        own_jacobian=by_own,
        own_weight=own_weight(own_error),
    )
