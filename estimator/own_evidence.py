"""What factors of one's own say of the nodes: rows for the graph, the covariance and the doubt alike.

A factor gives residuals r(x) with their Jacobian and sigma, see `NodeFactor`. Nobody here knows how far its readings
can be trusted, so that each row has Cauchy's kernel by itself, with z = r / sigma,

    E = sum rho(z^2),   rho = c^2 / 2 log(1 + z^2 / c^2),   weight w = 1 / (1 + z^2 / c^2)

A row that nothing else fits loses its weight: 50 sigma away it counts as if its sigma were 21 times as large.

Whether a factor agrees with all else is told by its innovation: its residual at the shape that all other factors of the
frame would give alone, over the standard deviation of both (`FrameEvidence`). It is standard normal where everything is
as it is told.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..factors.keys import NodeRows
from ..factors.noise import robust_loss
from ..factors.tendon import TautCables
from ..models.structure.shape import Reason, Shape
from ..models.values.errors import InputError
from ..models.values.readings import NodeFactor
from ..models.values.tables import SMALLEST_SIGMA
from ..models.values.time_series import low_pass_weight

OWN_KERNEL = "cauchy"
FACTOR_MEMORY_S = 0.5
"""Time constant of the mean of the innovation: a single wrong reading is no contradiction."""
FACTOR_APART = 3.0
"""Mean innovation above which a factor contradicts all else."""
MOST_INNOVATION = 10.0
"""Limit of the innovation of one frame."""


def own_rows(
    factors: Sequence[NodeFactor], t_s: float | NDArray[np.float64], node_position_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the residuals of factors over their sigma, and their Jacobian; both zero where nothing was read.

    Args:
        factors: one at least.
        t_s: (...,) times of frames.
        node_position_m: (..., nodes, 3) their shapes.

    Returns:
        (..., rows) z, and (..., rows, 3 nodes) dz/dx, of one factor after the other.
    """
    told = [factor.rows(np.asarray(t_s, dtype=np.float64), node_position_m) for factor in factors]
    residual = np.concatenate([rows.residual for rows in told], axis=-1)
    jacobian = np.concatenate([rows.jacobian for rows in told], axis=-2)
    sigma = np.maximum(np.concatenate([rows.sigma for rows in told], axis=-1), SMALLEST_SIGMA)
    is_read = np.isfinite(residual) & np.isfinite(sigma) & np.isfinite(jacobian).all(axis=-1)
    per_unit = np.where(is_read, 1 / sigma, 0.0)
    z = np.where(is_read, residual, 0.0) * per_unit
    return z, np.where(is_read[..., None], jacobian, 0.0) * per_unit[..., None]


def own_weight(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., rows) the weights w of the kernel, with which a linearisation takes rows of residuals z."""
    return robust_loss(z * z, OWN_KERNEL)[1]


def own_error(
    factors: Sequence[NodeFactor], t_s: NDArray[np.float64], node_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (...,) the error of all factors in each frame; see `own_rows`."""
    z, _ = own_rows(factors, t_s, node_position_m)
    return np.asarray(np.sum(robust_loss(z * z, OWN_KERNEL)[0], axis=-1))


def own_graph_rows(factors: Sequence[NodeFactor], t_s: float, rows: int) -> NodeRows:
    """Return all factors of one frame as the graph takes them, with their number of rows.

    Their linearisation has the weights of the kernel, as in gtsam's own robust models; their
    error is that of the kernel.
    """

    def residual(position: NDArray[np.float64]) -> NDArray[np.float64]:
        z, _ = own_rows(factors, t_s, position)
        return np.asarray(np.sign(z) * np.sqrt(2 * robust_loss(z * z, OWN_KERNEL)[0]))

    def linearised(position: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        z, by_position = own_rows(factors, t_s, position)
        root = np.sqrt(own_weight(z))
        return root * z, by_position * root[:, None]

    return NodeRows(rows, residual, linearised)


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
