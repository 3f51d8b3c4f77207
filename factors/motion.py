"""Motion prior: nodes move at constant velocity, disturbed by white noise of acceleration.

    x_t - (1 + r) x_{t-1} + r x_{t-2} = w,   r = dt_t / dt_{t-1},   sigma_w = q sqrt(dt_t) (dt_t + dt_{t-1}) / 2

which for equal steps is x_t - 2 x_{t-1} + x_{t-2} with sigma q dt^1.5 per axis.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..models.values.stamps import SHORTEST_STEP_S
from .noise import isotropic

STEP_DECIMALS = 6
"""Decimals of a time step in seconds, to which steps are rounded so that factors can be reused."""


def still_factors(
    nodes: Sequence[int], before: Sequence[int], now: Sequence[int], step_s: float, motion_m_per_s15: float
) -> list[gtsam.NonlinearFactor]:
    """Return x_t - x_{t-1} = w for the second frame: the nodes start from rest, so that there is no velocity yet."""
    model = isotropic(3, motion_m_per_s15 * step_s**1.5)
    return [gtsam.BetweenFactorPoint3(before[n], now[n], np.zeros(3), model) for n in nodes]


def constant_velocity_factors(
    nodes: Sequence[int],
    frames: tuple[Sequence[int], Sequence[int], Sequence[int]],
    steps_s: tuple[float, float],
    motion_m_per_s15: float,
) -> list[gtsam.NonlinearFactor]:
    """Return one factor for each of the nodes.

    Args:
        nodes: to which the motion prior applies.
        frames: keys of all nodes in three successive frames, the oldest frame first.
        steps_s: the two time steps between the three frames.
        motion_m_per_s15: q, the square root of the power density of the acceleration.
    """
    before_s, now_s = _rounded(np.array(steps_s)).tolist()
    template, origin = _second_difference(before_s, now_s, motion_m_per_s15)
    oldest, before, now = frames
    # rekeying shares the inner factor, so each node gets a copy of its own
    return [
        gtsam.LinearContainerFactor(gtsam.JacobianFactor(template), origin).rekey([oldest[n], before[n], now[n]])
        for n in nodes
    ]


def motion_rows(
    t_s: NDArray[np.float64], motion_m_per_s15: float, at_rest_sigma_m: float | None
) -> NDArray[np.float64]:
    """Return (frames, 3) the coefficients of x_{t-2}, x_{t-1} and x_t in w_t / sigma_w, for all frames of a trial.

    Args:
        t_s: (frames,) their times.
        motion_m_per_s15: see `constant_velocity_factors`.
        at_rest_sigma_m: standard deviation of the first frame about the rest shape, where a structure is at rest at the
            start; the second frame is then as the first, see `still_factors`. None where it is not: zeros.
    """
    rows = np.zeros((len(t_s), 3))
    step_s = np.diff(t_s)
    if at_rest_sigma_m is not None:
        rows[:1, 2] = 1 / at_rest_sigma_m
        rows[1:2] = np.outer(1 / (motion_m_per_s15 * step_s[:1] ** 1.5), [0.0, -1.0, 1.0])
    before_s, now_s = _rounded(step_s[:-1]), _rounded(step_s[1:])
    ratio = now_s / before_s
    sigma_m = _sigma_m(before_s, now_s, motion_m_per_s15)
    rows[2:] = np.stack([ratio, -(1 + ratio), np.ones_like(ratio)], axis=1) / sigma_m[:, None]
    return rows


def _rounded(step_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(np.round(step_s, STEP_DECIMALS), SHORTEST_STEP_S)


def _sigma_m(before_s: Any, now_s: Any, motion_m_per_s15: float) -> Any:
    """Return sigma_w for two successive time steps, or for many."""
    return motion_m_per_s15 * np.sqrt(now_s) * 0.5 * (now_s + before_s)


@lru_cache(maxsize=1024)
def _second_difference(
    before_s: float, now_s: float, motion_m_per_s15: float
) -> tuple[gtsam.JacobianFactor, gtsam.Values]:
    """Return the linear factor on keys 0, 1, 2 and its linearisation point, the origin."""
    ratio = now_s / before_s
    model = isotropic(3, _sigma_m(before_s, now_s, motion_m_per_s15))
    identity = np.eye(3)
    origin = gtsam.Values()
    for key in range(3):
        origin.insertPoint3(key, np.zeros(3))
    factor = gtsam.JacobianFactor(0, ratio * identity, 1, -(1 + ratio) * identity, 2, identity, np.zeros(3), model)
    return factor, origin
