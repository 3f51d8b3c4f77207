"""How well a free-standing structure is followed: its shape, how it is turned, its track, and its contacts."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ..values.rotations import best_rotation, rotation_vector
from .alignment import laid_on_each_frame
from .evaluation import ComparedFrames, ContactScore, PoseScore
from .statistics import of_known

STILL_M_PER_S = 0.02
"""Speed of every node below which the structure is still."""
STILL_S = 0.2
"""Time over which this speed is averaged."""
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
    path_m = float(np.linalg.norm(np.diff(truth.mean(axis=1), axis=0), axis=1).sum())
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
        still_tilt_rms_deg=float(np.sqrt(of_known(np.mean, tilt_deg[still] ** 2))),
        heading_error_deg=float(-angle_deg[-1, 2]),
        path_m=path_m,
        drift_share=float(np.linalg.norm(error_m[-1]) / path_m) if path_m > SHORTEST_PATH_M else np.nan,
        centroid_rmse_m=float(np.sqrt(np.mean(np.sum(error_m**2, axis=1)))),
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


def _still(t_s: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames,) where no node moves faster than `STILL_M_PER_S`, on average over `STILL_S`."""
    if len(t_s) < 3:
        return np.ones(len(t_s), dtype=np.bool_)
    speed = np.linalg.norm(np.diff(x, axis=0), axis=2).max(axis=1) / np.diff(t_s)
    width = max(round(STILL_S / float(np.median(np.diff(t_s)))), 1)
    averaged = uniform_filter1d(np.concatenate([[0.0], speed]), width, mode="nearest")
    return np.asarray(averaged < STILL_M_PER_S)


def _score_contacts(told: NDArray[np.bool_], true: NDArray[np.bool_], still: NDArray[np.bool_]) -> ContactScore:
    def shares(frames: NDArray[np.bool_]) -> tuple[float, float]:
        right = np.sum(told[frames] & true[frames])
        all_told, all_true = np.sum(told[frames]), np.sum(true[frames])
        return float(right / all_told) if all_told else np.nan, float(right / all_true) if all_true else np.nan

    return ContactScore(*shares(np.ones_like(still)), *shares(still), *shares(~still))
