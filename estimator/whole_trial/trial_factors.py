"""The factors that each frame of a trial has of its own, linearised many frames at a time.

They are the factors of `GraphBuilder.add_frame`, with the same noise models and robust kernels, as stacked arrays. Of
one frame, with x the coordinates of its nodes and z the residuals over their sigmas, a group of the balance of forces
or one length each,

    E = sum rho(|z|^2) + sum ((x - x_0) / sigma)^2 / 2
    H = A^T A + diag(1 / sigma^2)
    g = A^T b + (x - x_0) / sigma^2

where the rows of A and b are dz/dx and z, each times the root of its kernel's weight, and x_0 is the rest shape, or the
position of an anchor. Where sensors share the part u of their errors, b of the lengths is over own sigmas, those times
the root of 1 - u^2, and with v = u / sqrt(1 - u^2), by the inverse of 1 + v v^T,

    E -= (v^T b)^2 / (2 (1 + v^T v)),   H -= A^T v v^T A / (1 + v^T v),   g -= A^T v v^T b / (1 + v^T v)
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...factors.body_frame import BODY_FRAME_M
from ...factors.equilibrium import cauchy_error, weighted_balance
from ...factors.noise import WeightedLengths, robust_loss, rounded_sigma_m, stacked_shared
from ...factors.own import own_error, own_rows, own_weight
from ...models.structure.lengths import length_and_jacobian, member_length_m
from ..graph import GraphBuilder
from .parts import Frames
from .trial_balance import TrialBalance


class TrialFactors:
    """The frames' own factors: rods, lengths, anchors, shape prior, body frame, balance of forces, one's own."""

    def __init__(
        self, builder: GraphBuilder, measured: Sequence[WeightedLengths], balance: TrialBalance | None
    ) -> None:
        """Take the lengths of some frames, and the balance of forces in them; None without mechanics."""
        structure, noise = builder.structure, builder.noise
        self.count = len(measured)
        self._balance = balance
        self._robust = noise.robust
        self._own = measured[0].lengths.factors if measured else ()
        self._t_s = np.array([one.lengths.t_s for one in measured])
        self._rods = len(structure.rods)
        self._members = np.concatenate([structure.rods, structure.tendons])
        sigma_m = np.array([one.sigma_m for one in measured])
        used = np.isfinite(sigma_m)
        rods = np.broadcast_to(structure.rod_length_m, (self.count, self._rods))
        length_m = np.where(used, [one.lengths.length_m for one in measured], 0.0)
        self._length_m = np.concatenate([rods, length_m], axis=1)
        per_m = np.where(used, 1 / rounded_sigma_m(np.where(used, sigma_m, 1.0)), 0.0)
        self._per_m = np.concatenate([np.full_like(rods, 1 / noise.rod_m), per_m], axis=1)
        shared = stacked_shared(measured)
        self._shared: NDArray[np.float64] | None = None  # (frames, tendons) v / sqrt(1 + v^T v)
        if shared is not None:
            shared = np.where(structure.is_free_tendon, shared, 0.0)
            own = np.sqrt(1 - shared**2)
            self._per_m[:, self._rods :] /= own
            self._shared = shared / own / np.sqrt(1 + np.sum((shared / own) ** 2, axis=1, keepdims=True))
        self._x_0 = structure.with_anchors_placed(builder.rest.node_position_m).ravel()
        self._per_m2 = np.full(3 * structure.node_count, noise.shape_prior_m**-2)
        self._per_m2[structure.anchored_coordinates] = noise.anchor_m**-2
        self._fixed = builder.fixed_motions / BODY_FRAME_M
        self._fixed_at = self._fixed @ builder.rest.node_position_m.ravel()

    def error(self, node_position_m: NDArray[np.float64], frames: Frames) -> NDArray[np.float64]:
        """Return (frames,) half the sum of squares, and of the kernels' losses, of some frames.

        Args:
            node_position_m: (frames, nodes, 3) the shapes of these frames.
            frames: their numbers.
        """
        x = node_position_m.reshape(len(node_position_m), -1)
        z = (member_length_m(node_position_m, self._members) - self._length_m[frames]) * self._per_m[frames]
        error = 0.5 * np.sum(z[:, : self._rods] ** 2, axis=1)
        if self._shared is not None:
            error -= 0.5 * np.sum(self._shared[frames] * z[:, self._rods :], axis=1) ** 2
        error += np.sum(robust_loss(z[:, self._rods :] ** 2, self._robust)[0], axis=1)
        error += 0.5 * (x - self._x_0) ** 2 @ self._per_m2
        error += 0.5 * np.sum((x @ self._fixed.T - self._fixed_at) ** 2, axis=1)
        if self._own:
            error += own_error(self._own, self._t_s[frames], node_position_m)
        if self._balance:
            statics = self._balance.statics_of(frames)
            error += cauchy_error(statics.residual_n(node_position_m) / self._balance.sigma_n[frames], statics)
        return np.asarray(error)

    def linear(
        self, node_position_m: NDArray[np.float64], frames: Frames
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (frames, 3 nodes, 3 nodes) the information H of some frames, and (frames, 3 nodes) the gradient g.

        Args:
            node_position_m: see `error`.
            frames: see `error`.
        """
        x = node_position_m.reshape(len(node_position_m), -1)
        rows, z = self._weighted_rows(node_position_m, frames)
        information = np.swapaxes(rows, 1, 2) @ rows
        gradient = (z[:, None] @ rows)[:, 0] + (x - self._x_0) * self._per_m2
        diagonal = np.arange(x.shape[1])
        information[:, diagonal, diagonal] += self._per_m2
        if self._shared is not None:
            tendons = slice(self._rods, len(self._members))
            along = (self._shared[frames][:, None] @ rows[:, tendons])[:, 0]
            information -= along[:, :, None] * along[:, None, :]
            gradient -= along * np.sum(self._shared[frames] * z[:, tendons], axis=1, keepdims=True)
        if len(self._fixed):
            information += self._fixed.T @ self._fixed
            gradient += (x @ self._fixed.T - self._fixed_at) @ self._fixed
        if self._own:
            z, rows = own_rows(self._own, self._t_s[frames], node_position_m)
            weighted = np.swapaxes(rows * own_weight(z)[..., None], 1, 2)
            information += weighted @ rows
            gradient += (weighted @ z[..., None])[..., 0]
        return information, gradient

    def _weighted_rows(
        self, node_position_m: NDArray[np.float64], frames: Frames
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (frames, rows, 3 nodes) A and (frames, rows) b of members, and then of the balance of forces."""
        length_m, by_length = length_and_jacobian(node_position_m, self._members)
        z = (length_m - self._length_m[frames]) * self._per_m[frames]
        by_length *= self._per_m[frames][:, :, None]
        weight = np.sqrt(robust_loss(z[:, self._rods :] ** 2, self._robust)[1])
        z[:, self._rods :] *= weight
        by_length[:, self._rods :] *= weight[:, :, None]
        if not self._balance:
            return by_length, z
        statics, sigma_n = self._balance.statics_of(frames), self._balance.sigma_n[frames]
        force, by_force = weighted_balance(statics, sigma_n, node_position_m)
        return np.concatenate([by_length, by_force], axis=1), np.concatenate([z, force], axis=1)
