"""The second shapes of a trial: the search of `OtherBranch`, in many frames at once."""

import numpy as np
from numpy.typing import NDArray

from ...models.estimation import BranchSettings
from ...models.structure.rigidity import branch
from ...models.structure.shape import OtherShape
from ...models.structure.structure import Structure
from ..branches import across
from ..graph import ERROR_TOLERANCE, MAX_FRAME_ITERATIONS
from .trial_chain import MAX_DAMPING, MIN_DAMPING
from .trial_factors import TrialFactors


def frames_to_search(t_s: NDArray[np.float64], look_every_s: float) -> list[int]:
    """Return the numbers of the frames in which a second shape is searched for."""
    found: list[int] = []
    for k, time_s in enumerate(t_s.tolist()):
        if not found or time_s - t_s[found[-1]] >= look_every_s:
            found.append(k)
    return found


def second_shapes(
    structure: Structure, settings: BranchSettings, factors: TrialFactors, node_position_m: NDArray[np.float64]
) -> list[OtherShape | None]:
    """Return the other minimum of each frame's own factors, or None when there is none or it is much less probable.

    Args:
        structure: with as many free members as free coordinates.
        settings: of the search.
        factors: of the frames.
        node_position_m: (frames, nodes, 3) their shapes.
    """
    first_m, first_error = own_minima(factors, node_position_m)
    second_m, second_error = own_minima(factors, across(structure, first_m))
    log_ratio = second_error - first_error
    is_other = branch(structure, second_m) * branch(structure, node_position_m) <= 0
    probable = is_other & (log_ratio < settings.log_ratio)
    return [
        OtherShape(position_m, float(ratio)) if is_probable else None
        for position_m, ratio, is_probable in zip(second_m, log_ratio, probable, strict=True)
    ]


def own_minima(
    factors: TrialFactors, node_position_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (frames, nodes, 3) the local minima of the frames' own factors, and (frames,) their errors.

    Args:
        factors: of the frames.
        node_position_m: (frames, nodes, 3) shapes from which Levenberg and Marquardt's method searches.
    """
    x = node_position_m.reshape(factors.count, -1).copy()
    shape = node_position_m.shape[1:]
    moving = np.arange(factors.count)
    error = factors.error(node_position_m, moving)
    damping = np.zeros(factors.count)
    identity = np.eye(x.shape[1])
    for _ in range(MAX_FRAME_ITERATIONS):
        if not len(moving):
            break
        information, gradient = factors.linear(x[moving].reshape(-1, *shape), moving)
        damped = information + damping[moving, None, None] * identity
        candidate = x[moving] - np.linalg.solve(damped, gradient[..., None])[..., 0]
        decrease = error[moving] - factors.error(candidate.reshape(-1, *shape), moving)
        better = decrease >= 0
        x[moving[better]] = candidate[better]
        error[moving[better]] -= decrease[better]
        less = np.where(damping[moving] > MIN_DAMPING, damping[moving] / 10, 0.0)
        damping[moving] = np.where(better, less, np.maximum(10 * damping[moving], MIN_DAMPING))
        done = np.where(better, decrease <= ERROR_TOLERANCE, damping[moving] > MAX_DAMPING)
        moving = moving[~done]
    return x.reshape(node_position_m.shape), error
