"""Alignment of the truth with the estimate: in time by interpolation, in space by the best rigid motion."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..values.rotations import best_rotation
from ..values.time_series import median_step_s

ON_A_LINE = 1e-3
"""Ratio of two widths of a set of points, below which they lie on one line."""
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
    outside = (share < 0) | (share > 1) | (step_s > MAX_HOLE * median_step_s(truth_s))
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


def best_motions(
    points_m: NDArray[np.float64], onto_m: NDArray[np.float64], known: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the rigid motions R (p - a) + b that bring points p nearest to others, one in each frame.

    They are (frames, 1, 3) a, the mean of the points, (frames, 3, 3) R, and (frames, 1, 3) b, the mean of the others.

    Args:
        points_m: (frames, points, 3) p.
        onto_m: (frames, points, 3) the others.
        known: (frames, points, 1) which of them count; the rest may be nan.
    """
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    x, y = np.where(known, points_m, 0.0), np.where(known, onto_m, 0.0)
    a, b = x.sum(axis=1, keepdims=True) / count, y.sum(axis=1, keepdims=True) / count
    return a, best_rotation(np.where(known, x - a, 0.0), np.where(known, y - b, 0.0)), b


def laid_on_each_frame(points_m: NDArray[np.float64], onto_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames, points, 3) points, those of each frame by the rigid motion that brings them nearest to others.

    Args:
        points_m: (frames, points, 3) the points; those that are nan stay so, and so do all of a frame in which less
            than three are known, or only points on one line.
        onto_m: (frames, points, 3) the others.
    """
    known = np.asarray(np.isfinite(points_m).all(axis=2, keepdims=True))
    a, turn, b = best_motions(points_m, onto_m, known)
    x = np.where(known, points_m - a, 0.0)
    laid_m = x @ np.swapaxes(turn, 1, 2) + b
    spread = np.linalg.svd(x, compute_uv=False)
    on_a_line = spread[:, 1:2, None] <= ON_A_LINE * spread[:, :1, None]
    return np.where(known & ~on_a_line, laid_m, np.nan)
