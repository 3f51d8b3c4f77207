"""Live shapes at the time of their frame: the sensors show the robot as it was a little earlier."""

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..models.structure.shape import Shape
from ..models.values.stamps import ROUNDING_S

VELOCITY_HOLDS_S = 0.2
"""Time after which a velocity says nothing of the position: the time in which a hand changes its push."""

ERROR_LASTS_S = 0.04
"""Time in which the error of a shape changes by its sigma: a slower motion is not told from a change of the error."""

HALF = 0.4
"""Shortest half of the motion, as a share of the lag: frames are not exactly half a lag apart."""

STILL_M2_PER_S2 = 1e-30
"""Square of a speed that is none, by which nothing is divided."""


class LagCompensation:
    """Moves each live shape on by the lag of its lengths, at the velocity that it has had for that time.

    The lag tau is that of the sensor model on recordings, `TendonLengths.lag_s`. In batch a later frame shows the
    shape; live it is

        x(t) = x + u,   C(t) = C + tau / T_v u u^T,   u = tau w v,   w = |v|^2 / (|v|^2 + (sigma / T)^2)

    for each node, with v the velocity that both halves of the last tau have in common, sigma the rms of the node's
    standard deviations along the axes, T `ERROR_LASTS_S` and T_v `VELOCITY_HOLDS_S`. A jump between two frames is in
    one half only, and moves nothing.
    """

    def __init__(self) -> None:
        self._before: deque[Shape] = deque()

    def now(self, shape: Shape) -> Shape:
        """Return a shape as it is at t_s; shapes are given in order of time, as their lengths show them."""
        lag_s = shape.lengths.lag_s
        if lag_s == 0:
            return shape
        if not np.isfinite(shape.lengths.sigma_m).any():
            self._before.clear()  # without lengths a shape is predicted, and does not lag
            return shape
        velocity = self._velocity(shape, lag_s)
        self._before.append(shape)
        speed2 = (velocity**2).sum(axis=1, keepdims=True)
        of_errors2 = (shape.node_sigma_m[:, None] / ERROR_LASTS_S) ** 2 / 3
        moved_m = lag_s * velocity * speed2 / np.maximum(speed2 + of_errors2, STILL_M2_PER_S2)
        return replace(
            shape,
            node_position_m=shape.node_position_m + moved_m,
            covariance_m2=shape.covariance_m2 + lag_s / VELOCITY_HOLDS_S * np.outer(moved_m, moved_m),
        )

    def _velocity(self, shape: Shape, lag_s: float) -> NDArray[np.float64]:
        """Return (nodes, 3) of each node its newest velocity, as far as it had that before, too.

        It is zero where the shapes before are missing.
        """
        unknown = np.zeros_like(shape.node_position_m)
        middle = self._latest_until(shape.t_s - HALF * lag_s)
        first = self._latest_until(middle.t_s - HALF * lag_s) if middle else None
        if middle is None or first is None:
            return unknown
        while self._before[0] is not first:
            self._before.popleft()
        if shape.t_s - first.t_s > VELOCITY_HOLDS_S + ROUNDING_S:
            return unknown
        newest = (shape.node_position_m - middle.node_position_m) / (shape.t_s - middle.t_s)
        earlier = (middle.node_position_m - first.node_position_m) / (middle.t_s - first.t_s)
        share = (newest * earlier).sum(axis=1) / np.maximum((newest**2).sum(axis=1), STILL_M2_PER_S2)
        return np.asarray(newest * np.clip(share, 0, 1)[:, None])

    def _latest_until(self, t_s: float) -> Shape | None:
        """Return the latest shape that is not later than t_s; None where there is none."""
        return next((shape for shape in reversed(self._before) if shape.t_s <= t_s), None)
