"""The second shapes of a trial: the search of `OtherBranch`, in many frames at once."""

import numpy as np
from numpy.typing import NDArray

from ...models.estimation import BranchSettings
from ...models.structure.rigidity import branch
from ...models.structure.shape import OtherShape
from ...models.structure.structure import Structure
from ..branches import across
from .far_minima import far_minima, is_unlikely
from .own_minima import own_minima
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
    is_other = branch(structure, second_m) * branch(structure, node_position_m) <= 0
    second_error = np.where(is_other, second_error, np.inf)
    unlikely = np.flatnonzero(is_unlikely(structure, first_error))
    far_m, far_error = far_minima(structure, factors, unlikely, first_m[unlikely])
    better = far_error < second_error[unlikely]
    second_m[unlikely[better]], second_error[unlikely[better]] = far_m[better], far_error[better]
    return [
        OtherShape(position_m, float(ratio)) if ratio < settings.log_ratio else None
        for position_m, ratio in zip(second_m, second_error - first_error, strict=True)
    ]
