"""Alignment of the truth with the estimate: in time by interpolation, in space by the best rigid motion."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..values.rotations import best_rotation

MAX_HOLE = 3.0
"""Longest time step of the truth, in units of its median time step, within which it is interpolated."""


def interpolated_within(
    t_s: NDArray[np.float64], truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (frames, nodes, 3) true positions at the times of the frames, by linear interpolation.

    They are nan before the first and after the last time of the truth, in its gaps, and next to a nan.

    Args:
        t_s: (frames,) times of the frames.
        truth_s: (times,) times of the truth.
        truth_position_m: (times, nodes, 3) true positions, or other vectors.
    """
    after = np.clip(np.searchsorted(truth_s, t_s), 1, len(truth_s) - 1)
    step_s = truth_s[after] - truth_s[after - 1]
    share = (t_s - truth_s[after - 1]) / step_s
    outside = (share < 0) | (share > 1) | (step_s > MAX_HOLE * np.median(np.diff(truth_s)))
    share = np.where(outside & (share != 0) & (share != 1), np.nan, share)[:, None, None]
    before_m = truth_position_m[after - 1]
    after_m = truth_position_m[after]
    between = (1 - share) * before_m + share * after_m
    return np.asarray(np.where(share == 0, before_m, np.where(share == 1, after_m, between)))


def rigid_alignment(points_m: NDArray[np.float64], onto_m: NDArray[np.float64]) -> tuple[Rotation, NDArray[np.float64]]:
    """Return the rotation R and translation t that minimise the sum of |R p + t - q|^2 (Umeyama 1991, without scale).

    Args:
        points_m: (points, 3) p; rows with a nan are left out.
        onto_m: (points, 3) q.
    """
    known = np.isfinite(points_m).all(axis=1)
    points_m = points_m[known]
    onto_m = onto_m[known]
    rotation, _ = Rotation.align_vectors(onto_m - onto_m.mean(axis=0), points_m - points_m.mean(axis=0))
    return rotation, onto_m.mean(axis=0) - rotation.apply(points_m.mean(axis=0))


def laid_on_each_frame(points_m: NDArray[np.float64], onto_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames, points, 3) points, those of each frame by the rigid motion that brings them nearest to others.

    Args:
        points_m: (frames, points, 3) the points; a frame with a nan is nan then.
        onto_m: (frames, points, 3) the others.
    """
    laid_m = np.full_like(points_m, np.nan)
    known = np.isfinite(points_m).all(axis=(1, 2))
    x, y = points_m[known], onto_m[known]
    x_middle, y_middle = x.mean(axis=1, keepdims=True), y.mean(axis=1, keepdims=True)
    turn = best_rotation(x - x_middle, y - y_middle)
    laid_m[known] = (x - x_middle) @ np.swapaxes(turn, 1, 2) + y_middle
    return laid_m
