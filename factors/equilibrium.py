"""Static equilibrium: the forces at each node balance, except for a load, which is zero at most nodes most of the time.

The rows of the residual r of `Statics` form groups g: the three rows of a node, and the one row of a floating rod. With
q_g = |r_g|^2 / sigma^2 the error is Cauchy's for each group: 1/2 sum_g log(1 + q_g). So a node that is pressed loses
weight without its neighbours; a robust noise model of gtsam would give one weight to the whole factor.
"""

import numpy as np
from numpy.typing import NDArray

from ..models.balance.statics import Statics
from .keys import NodeRows


def equilibrium_rows(statics: Statics, sigma_n: NDArray[np.float64]) -> NodeRows:
    """Return the balance of forces in one frame, with (rows,) the sigma of each row, which is one in each group.

    Its linearisation has the weight 1 / (1 + q_g), as in gtsam's own robust models; its error is that of the kernel.
    """

    def residual(position: NDArray[np.float64]) -> NDArray[np.float64]:
        r = statics.residual_n(position) / sigma_n
        q = squared_norms(r, statics)
        # log(1 + q) / q, whose limit at 0 is 1
        return np.asarray(r * np.sqrt(np.log1p(q) / np.maximum(q, 1e-12)))

    return NodeRows(len(statics.group), residual, lambda position: weighted_balance(statics, sigma_n, position))


def weighted_balance(
    statics: Statics, sigma_n: NDArray[np.float64], node_position_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (..., rows) r and (..., rows, 3 nodes) its derivatives over sigma, times the root of Cauchy's weight."""
    r, jacobian = statics.residual_and_jacobian(node_position_m)
    weight = np.sqrt(cauchy_weight(r / sigma_n, statics)) / sigma_n
    jacobian *= weight[..., None]
    return r * weight, jacobian


def cauchy_error(r: NDArray[np.float64], statics: Statics) -> NDArray[np.float64]:
    """Return (...,) 1/2 sum_g log(1 + q_g) of (..., rows) residuals over their sigmas."""
    q = np.add.reduceat(r * r, statics.group_start, axis=-1)
    return np.asarray(0.5 * np.sum(np.log1p(q), axis=-1))


def cauchy_weight(r: NDArray[np.float64], statics: Statics) -> NDArray[np.float64]:
    """Return (..., rows) 1 / (1 + q_g) of (..., rows) residuals over their sigmas."""
    return 1 / (1 + squared_norms(r, statics))


def squared_norms(r: NDArray[np.float64], statics: Statics) -> NDArray[np.float64]:
    """Return (..., rows), the squared norm of each row's group."""
    return np.asarray(np.add.reduceat(r * r, statics.group_start, axis=-1)[..., statics.group])
