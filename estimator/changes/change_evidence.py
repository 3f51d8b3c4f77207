"""The evidence of one frame for a change of one quantity that is otherwise taken as known.

A change theta moves the residuals s of a frame, over their sigmas, by theta d, and the estimate, whose Jacobian is A,
takes up what it can. With H = A^T A and what is left of d, the most probable change and its evidence are

    I = d^T d - d^T A H^-1 A^T d,    b = d^T s - d^T A H^-1 A^T s,    theta = -b sigma^2 / (1 + sigma^2 I)
    log p(change) / p(none) = -1/2 log(1 + sigma^2 I) + 1/2 b^2 sigma^2 / (1 + sigma^2 I)

for a change that is normally distributed with sigma beforehand (Rao's score with a prior). An estimate that knows
nothing of the change is off by H^-1 A^T d theta.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..linear_frame import LinearFrame


@dataclass(frozen=True, slots=True, eq=False)
class PossibleChanges:
    """How each change of 1 m, or of 1 in log resistance, moves the residuals of a frame."""

    length_error_m: NDArray[np.float64]
    """(members, changes) of the lengths, rods first, see `LinearFrame.length_error_m`."""
    force_n: NDArray[np.float64]
    """(rows, changes) of the balance of forces."""
    sigma: NDArray[np.float64]
    """(changes,) standard deviation beforehand."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeEvidence:
    """What one frame says of each change."""

    log_ratio: NDArray[np.float64]
    """(changes,) log of the evidence for the change over that for none."""
    explained: NDArray[np.float64]
    """(changes,) by how much the error of the frame is less with the change."""
    shift_m: NDArray[np.float64]
    """(changes, free) rms of what the free coordinates are off by, if it changed and that is not known; with signs."""


def change_evidence(frame: LinearFrame, changes: PossibleChanges) -> ChangeEvidence:
    """Return the evidence of a frame for each of several changes, linearised at the estimate."""
    error, by_shape, by_change = frame.weighted_with(changes.length_error_m)
    forces = frame.force_jacobian * frame.force_weight_per_n[:, None]
    forces_by_change = changes.force_n * frame.force_weight_per_n[:, None]
    information, gradient = frame.with_forces()
    crossed = by_shape.T @ by_change + forces.T @ forces_by_change
    taken_up = np.linalg.solve(information, crossed)
    left = np.sum(by_change**2, axis=0) + np.sum(forces_by_change**2, axis=0) - np.sum(crossed * taken_up, axis=0)
    slope = error @ by_change + (frame.force_n / frame.force_sigma_n) @ forces_by_change - gradient @ taken_up
    variance = changes.sigma**2 / (1 + changes.sigma**2 * np.maximum(left, 0.0))
    explained = 0.5 * slope**2 * variance
    log_ratio = 0.5 * np.log(variance / changes.sigma**2) + explained
    mean_square = (slope * variance) ** 2 + variance
    signed = -np.sign(slope) * np.sqrt(mean_square)
    return ChangeEvidence(log_ratio, explained, signed[:, None] * taken_up.T)
