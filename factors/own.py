"""What factors of one's own say of the nodes: rows for the graph, the covariance and the doubt alike.

A factor gives residuals r(x) with their Jacobian and sigma, see `NodeFactor`. Nobody here knows how far its readings
can be trusted, so that each row has Cauchy's kernel by itself, with z = r / sigma,

    E = sum rho(z^2),   rho = c^2 / 2 log(1 + z^2 / c^2),   weight w = 1 / (1 + z^2 / c^2)

A row that nothing else fits loses its weight: 50 sigma away it counts as if its sigma were 21 times as large.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..models.values.readings import NodeFactor
from ..models.values.tables import SMALLEST_SIGMA
from .keys import NodeRows
from .noise import robust_loss

OWN_KERNEL = "cauchy"


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
    t_s = np.asarray(t_s, dtype=np.float64)
    told = [factor.rows(t_s, node_position_m.copy()) for factor in factors]  # which may write into its argument
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
