"""How well a free-standing structure is followed: its shape, how it is turned, its track, and its contacts.

A true position with noise walks about where the structure stands: 0.3 mm at every node made a path of 0.41 m out of one
of 0.09 m, and no frame was still. So the noise is measured, and what it can do by itself does not count. Of a truth
without noise everything counts, its vibrations after a tumble too.
"""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ..values.rotations import best_rotation, rotation_vector
from ..values.time_series import median_step_s
from .alignment import laid_on_each_frame
from .evaluation import ComparedFrames, ContactScore, PoseScore
from .statistics import root_mean_square

STILL_M_PER_S = 0.02
"""Speed of every node below which the structure is still."""
STILL_S = 0.2
"""Time over which this speed is averaged."""
NOISE_DIFFERENCE_S = 0.2
"""Time over which the third differences of true positions are averaged, from which their noise is measured."""
QUIET_SHARE = 0.1
"""Share of these times, the quietest, that count as free of motion."""
NOISE_REACH = 8.0
"""Ratio of a distance that noise never makes to the standard deviation of a coordinate's noise. Its length is that of
three coordinates, of a difference of two positions, the largest of thousands."""
LARGEST_NODE = 3.0
"""Ratio of the largest of a structure's noises to the standard deviation of a coordinate's."""
SHORTEST_PATH_M = 0.001
"""Length of the path up to which no share of it is told: the robot stood."""


def score_pose(
    compared: ComparedFrames, rest_position_m: NDArray[np.float64], *, in_body: bool = False
) -> PoseScore | None:
    """Return the score of a free-standing structure; None when no frame has the true positions of all nodes.

    Args:
        compared: the compared frames.
        rest_position_m: (nodes, 3) the rest shape.
        in_body: whether the truth was laid onto each frame: then all but the shape is nan.
    """
    known = np.isfinite(compared.true_m).all(axis=(1, 2))
    if not known.any():
        return None
    x, truth = compared.estimated_m[known], compared.true_m[known]
    turn = best_rotation(_centred(x), _centred(truth))
    angle_deg = np.rad2deg(rotation_vector(turn))
    tilt_deg = np.rad2deg(np.arccos(np.clip(turn[:, 2, 2], -1, 1)))
    error_m = (x - truth).mean(axis=1)
    path_m = _path_m(compared.t_s[known], truth.mean(axis=1))
    end_m = error_m[-_frames_averaged(compared.t_s[known], truth) :].mean(axis=0)
    still = _still(compared.t_s[known], truth)
    contacts = None
    if compared.contacts is not None:
        told, true = (values[known] for values in compared.contacts)
        compared_too = np.isfinite(true).all(axis=1)
        if compared_too.any():
            contacts = _score_contacts(told[compared_too] > 0.5, true[compared_too] > 0.5, still[compared_too])
    x, truth = _centred(x), _centred(truth)
    rest = np.broadcast_to(rest_position_m, x.shape)
    score = PoseScore(
        shape_rmse_m=_rms(laid_on_each_frame(x, truth) - truth),
        held_rmse_m=_rms(laid_on_each_frame(rest, truth) - truth),
        level_rmse_m=_rms(x @ np.swapaxes(_level_rotation(x, truth), 1, 2) - truth),
        tilt_rms_deg=float(np.sqrt(np.mean(tilt_deg**2))),
        still_tilt_rms_deg=root_mean_square(tilt_deg[still]),
        heading_error_deg=float(-angle_deg[-1, 2]),
        path_m=path_m,
        drift_share=float(np.linalg.norm(end_m) / path_m) if path_m > SHORTEST_PATH_M else np.nan,
        centroid_rmse_m=_rms(error_m),
        contacts=contacts,
    )
    if not in_body:
        return score
    return replace(
        score,
        level_rmse_m=np.nan,
        tilt_rms_deg=np.nan,
        still_tilt_rms_deg=np.nan,
        heading_error_deg=np.nan,
        path_m=np.nan,
        drift_share=np.nan,
        centroid_rmse_m=np.nan,
    )


def _centred(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(x - x.mean(axis=1, keepdims=True))


def _rms(error_m: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum(error_m**2, axis=-1))))


def _level_rotation(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (frames, 3, 3) rotations about z that turn centred points x into y best."""
    sine = np.sum(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0], axis=1)
    cosine = np.sum(x[..., 0] * y[..., 0] + x[..., 1] * y[..., 1], axis=1)
    angle = np.arctan2(sine, cosine)
    turn = np.zeros((len(x), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    turn[:, 2, 2] = 1.0
    return turn


def _frames_in(seconds: float, t_s: NDArray[np.float64]) -> int:
    """Return about how many frames, one at least, there are in a time."""
    return max(round(seconds / median_step_s(t_s)), 1)


def _noise_m(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Return the standard deviation of the noise of a coordinate of (frames, ...) positions; zero of a few frames.

    The third difference of white noise has 1 + 9 + 9 + 1 = 20 times its variance; that of a motion is much smaller.
    """
    square_m2 = np.diff(x.reshape(len(x), -1), 3, axis=0) ** 2
    width = _frames_in(NOISE_DIFFERENCE_S, t_s)
    parts = len(square_m2) // width
    if parts == 0:
        return 0.0
    mean_m2 = square_m2[: parts * width].reshape(parts, -1).mean(axis=1)
    return float(np.sqrt(np.quantile(mean_m2, QUIET_SHARE) / 20))


def _path_m(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Return the length of the path of (frames, 3) positions, in steps that are larger than noise can be."""
    least_m = NOISE_REACH * _noise_m(t_s, x)
    path_m, last = 0.0, x[0]
    for here in x[1:]:
        step_m = float(np.linalg.norm(here - last))
        if step_m > least_m:
            path_m, last = path_m + step_m, here
    return path_m


def _still(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames,) where no node moves faster than `STILL_M_PER_S`, on average over `STILL_S`."""
    if len(t_s) < 3:  # too few for a speed
        return np.ones(len(t_s), dtype=np.bool_)
    averaged = uniform_filter1d(_speed_m_per_s(t_s, x), _frames_in(STILL_S, t_s), mode="nearest")
    return np.asarray(averaged < STILL_M_PER_S)


def _frames_averaged(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> int:
    """Return of how many frames the noise of (frames, nodes, 3) positions needs the mean; without noise it is one.

    Two means of n frames that are n dt apart make a speed of sigma sqrt(2 / n) / (n dt) out of noise alone; n is such
    that it is half of `STILL_M_PER_S` at most, within `STILL_S` and half of the frames.
    """
    if len(t_s) < 2:
        return 1
    noise_m_per_s = LARGEST_NODE * np.sqrt(2) * _noise_m(t_s, x) / median_step_s(t_s)
    needed = int(np.ceil((noise_m_per_s / (0.5 * STILL_M_PER_S)) ** (2 / 3)))
    return max(1, min(needed, _frames_in(STILL_S, t_s), len(t_s) // 2))


def _speed_m_per_s(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames,) the speed of the fastest node, from the means of as many frames before and after as it needs."""
    count = _frames_averaged(t_s, x)
    mean_m = sliding_window_view(x, count, axis=0).mean(axis=-1)
    mean_s = sliding_window_view(t_s, count).mean(axis=-1)
    apart_m = np.linalg.norm(mean_m[count:] - mean_m[:-count], axis=2).max(axis=1)
    return np.pad(apart_m / (mean_s[count:] - mean_s[:-count]), (count, count - 1), mode="edge")


def _score_contacts(told: NDArray[np.bool_], true: NDArray[np.bool_], still: NDArray[np.bool_]) -> ContactScore:
    def shares(frames: NDArray[np.bool_]) -> tuple[float, float]:
        right = np.sum(told[frames] & true[frames])
        all_told, all_true = np.sum(told[frames]), np.sum(true[frames])
        return float(right / all_told) if all_told else np.nan, float(right / all_true) if all_true else np.nan

    return ContactScore(*shares(np.ones_like(still)), *shares(still), *shares(~still))
