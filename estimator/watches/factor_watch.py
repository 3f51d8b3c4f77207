"""Whether each factor of one's own agrees with all else.

That is told by its innovation: its residual at the shape that all other factors of the frame would give alone, over the
standard deviation of both (`FrameEvidence`). It is standard normal where everything is as it is told.
"""

import numpy as np

from ...factors.tendon import TautCables
from ...models.structure.shape import Reason, Shape
from ...models.values.errors import InputError
from ...models.values.readings import NodeFactor
from ...models.values.time_series import low_pass_weight

FACTOR_MEMORY_S = 0.5
"""Time constant of the mean of the innovation: a single wrong reading is no contradiction."""
FACTOR_APART = 3.0
"""Mean innovation above which a factor contradicts all else."""
MOST_INNOVATION = 10.0
"""Limit of the innovation of one frame."""


class FactorWatch:
    """Follows whether each factor agrees with all else, and counts the frames in which it is not read, or disagrees."""

    def __init__(self) -> None:
        self._factors: tuple[NodeFactor, ...] = ()
        self._rows: list[slice] = []
        self._mean = np.zeros(0)
        self._last_s = np.nan
        self._unread = np.zeros(0, dtype=np.int64)
        self._apart = np.zeros(0, dtype=np.int64)

    def observe(self, shape: Shape) -> Shape:
        """Return the shape of one more frame, in doubt if some factor contradicts all else.

        Raises:
            InputError: when the frame has factors, and the estimator has not used them.
        """
        if not shape.lengths.factors:
            return shape
        innovation = shape.factor_innovation
        if innovation is None and all(isinstance(factor, TautCables) for factor in shape.lengths.factors):
            return shape  # methods of lengths alone know nothing of cables
        if innovation is None:
            raise InputError("the frames have factors: expected a method that uses them, as batch, live and frame do")
        if not self._factors:
            self._begin(shape)
        step_s = shape.t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._last_s = shape.t_s
        is_read = np.isfinite(innovation)
        limited = np.clip(np.where(is_read, innovation, 0.0), -MOST_INNOVATION, MOST_INNOVATION)
        moved = self._mean + low_pass_weight(step_s, FACTOR_MEMORY_S) * (limited - self._mean)
        self._mean = np.where(np.isnan(self._mean), np.where(is_read, limited, np.nan), moved)
        self._unread += [not is_read[rows].any() for rows in self._rows]
        apart = [bool((np.abs(self._mean[rows]) > FACTOR_APART).any()) for rows in self._rows]
        self._apart += apart
        return shape.in_doubt(Reason.FACTOR) if any(apart) else shape

    def counts(self) -> dict[str, int]:
        """Return the number of frames without a reading, and of those in which it contradicts all else, of each."""
        counts: dict[str, int] = {}
        for factor, unread, apart in zip(self._factors, self._unread, self._apart, strict=True):
            counts[f"{factor}: frames without a reading"] = int(unread)
            counts[f"{factor}: frames in which it contradicts all else"] = int(apart)
        return counts

    def _begin(self, shape: Shape) -> None:
        """Find which rows are those of each factor; the mean of each begins with its first reading."""
        self._factors, t_s = shape.lengths.factors, np.array(shape.t_s)
        sizes = [factor.rows(t_s, shape.node_position_m).residual.shape[-1] for factor in self._factors]
        ends = np.cumsum(sizes)
        self._rows = [slice(int(end) - size, int(end)) for size, end in zip(sizes, ends, strict=True)]
        self._mean = np.full(int(ends[-1]), np.nan)
        self._unread, self._apart = np.zeros((2, len(sizes)), dtype=np.int64)
