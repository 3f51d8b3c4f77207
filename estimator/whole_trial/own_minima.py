"""The local minima of frames' own factors: the search of `FrameSearch`, in many frames at once.

Several explanations of one frame count as so many frames.
"""

import numpy as np
from numpy.typing import NDArray

from ..graph import ERROR_TOLERANCE, MAX_FRAME_ITERATIONS
from .trial_chain import MAX_DAMPING, MIN_DAMPING
from .trial_factors import TrialFactors


def own_minima(
    factors: TrialFactors, node_position_m: NDArray[np.float64], frames: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (searches, nodes, 3) local minima of frames' own factors, and (searches,) their errors.

    Args:
        factors: of the frames.
        node_position_m: (searches, nodes, 3) shapes from which Levenberg and Marquardt's method searches.
        frames: (searches,) the number of each one's frame; None where there is one search in each frame.
    """
    count, shape = len(node_position_m), node_position_m.shape[1:]
    x = node_position_m.reshape(count, -1).copy()
    moving = np.arange(count)
    frames = moving if frames is None else frames
    error = factors.error(node_position_m, frames)
    damping = np.zeros(count)
    identity = np.eye(x.shape[1])
    for _ in range(MAX_FRAME_ITERATIONS):
        if not len(moving):
            break
        information, gradient = factors.linear(x[moving].reshape(-1, *shape), frames[moving])
        damped = information + damping[moving, None, None] * identity
        candidate = x[moving] - np.linalg.solve(damped, gradient[..., None])[..., 0]
        decrease = error[moving] - factors.error(candidate.reshape(-1, *shape), frames[moving])
        better = decrease >= 0
        x[moving[better]] = candidate[better]
        error[moving[better]] -= decrease[better]
        less = np.where(damping[moving] > MIN_DAMPING, damping[moving] / 10, 0.0)
        damping[moving] = np.where(better, less, np.maximum(10 * damping[moving], MIN_DAMPING))
        done = np.where(better, decrease <= ERROR_TOLERANCE, damping[moving] > MAX_DAMPING)
        moving = moving[~done]
    return x.reshape(node_position_m.shape), error
