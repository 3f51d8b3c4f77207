"""Other shapes of frames that the shape found hardly explains: a structure that collapses has several of them.

They may be on the same side of det J as the first one, where `OtherBranch` finds none. The error of a frame's own
factors at their minimum is about half the chi^2 of as many degrees of freedom as there are free coordinates. Where it
is beyond that of 95 %, the search starts anew, far away to both sides along each of the motions that change the lengths
least.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from ...models.structure.rigidity import free_length_jacobian
from ...models.structure.structure import Structure
from .own_minima import own_minima
from .trial_factors import TrialFactors

LIKELY = 0.95
"""Share of frames whose error is less than that of an unlikely one, by chance."""
SOFT_MOTIONS = 4
"""Number of motions along which the search starts."""
FAR_SHARE = 2 / 3
"""Distance at which it starts, over all nodes, in lengths of a rod."""
APART_SHARE = 1 / 15
"""Distance of one node at least between two shapes that are not the same, in lengths of a rod."""


def is_unlikely(structure: Structure, error: NDArray[np.float64] | float) -> NDArray[np.bool_]:
    """Return (...,) whether shapes hardly explain their frames, by (...,) errors of the frames' own factors."""
    return np.asarray(error > gammaincinv(0.5 * len(structure.free_coordinates), LIKELY))


def far_minima(
    structure: Structure, factors: TrialFactors, frames: NDArray[np.int64], node_position_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (frames, nodes, 3) the most probable other minima of some frames, and (frames,) their errors.

    The error is inf where all searches end at the same minimum.

    Args:
        structure: with as many free members as free coordinates.
        factors: of all frames.
        frames: the numbers of these frames.
        node_position_m: (frames, nodes, 3) the minima that are known.
    """
    if not len(frames):
        return node_position_m, np.zeros(0)
    motion = np.linalg.svd(free_length_jacobian(structure, node_position_m))[2][:, -SOFT_MOTIONS:]
    rod_m = float(structure.rod_length_m.mean())
    away_m = np.zeros((len(frames), 2 * motion.shape[1], *node_position_m.shape[1:]))
    both = np.concatenate([motion, -motion], axis=1)
    away_m[:, :, structure.free_nodes] = FAR_SHARE * rod_m * both.reshape(*both.shape[:2], -1, 3)
    start_m = node_position_m[:, None] + away_m
    found_m, error = own_minima(
        factors, start_m.reshape(-1, *node_position_m.shape[1:]), np.repeat(frames, start_m.shape[1])
    )
    found_m, error = found_m.reshape(start_m.shape), error.reshape(start_m.shape[:2])
    apart_m = np.linalg.norm(found_m - node_position_m[:, None], axis=-1).max(axis=-1)
    error = np.where(apart_m > APART_SHARE * rod_m, error, np.inf)
    best = np.arange(len(frames)), np.argmin(error, axis=1)
    return found_m[best], error[best]
