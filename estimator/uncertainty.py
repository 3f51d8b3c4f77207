"""Covariances of all frames at once, from the Gaussian at the optimum."""

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_matrix


def information_matrix(linear: gtsam.GaussianFactorGraph) -> coo_matrix:
    """Return the sparse information matrix A^T A of a linearised graph, variables sorted by key."""
    rows, columns, values = linear.sparseJacobian_()
    jacobian = coo_matrix((values, (rows.astype(np.int64) - 1, columns.astype(np.int64) - 1))).tocsc()
    variables = jacobian.shape[1] - 1  # the last column is the right-hand side
    jacobian = jacobian[:, :variables]
    return (jacobian.T @ jacobian).tocoo()


def block_marginals(information: coo_matrix, size: int) -> NDArray[np.float64]:
    """Return the (blocks, size, size) diagonal blocks of the inverse of a block-tridiagonal information matrix.

    With information blocks D_k on and U_k right of the diagonal, forward S_k = D_k - U_{k-1}^T S_{k-1}^-1 U_{k-1},
    backward P_k = S_k^-1 + G_k P_{k+1} G_k^T, G_k = S_k^-1 U_k (Rauch-Tung-Striebel in information form).

    Args:
        information: square sparse matrix; entries outside the block tridiagonal must be zero.
        size: of a block; the last block may be smaller, and is padded with an identity in the result.
    """
    count = -(-information.shape[0] // size)
    diagonal, upper = np.zeros((count, size, size)), np.zeros((count, size, size))
    row_block, row = np.divmod(information.row, size)
    column_block, column = np.divmod(information.col, size)
    same, right = row_block == column_block, row_block + 1 == column_block
    diagonal[row_block[same], row[same], column[same]] = information.data[same]
    upper[row_block[right], row[right], column[right]] = information.data[right]
    for k in range(information.shape[0] - (count - 1) * size, size):
        diagonal[-1, k, k] = 1.0
    factors, gains = [], []
    schur = diagonal[0]
    for k in range(count):
        factor = cho_factor(schur, lower=True, check_finite=False)
        gain = cho_solve(factor, upper[k], check_finite=False)
        factors.append(factor)
        gains.append(gain)
        if k + 1 < count:
            schur = diagonal[k + 1] - upper[k].T @ gain
    marginals = np.empty_like(diagonal)
    identity = np.eye(size)
    for k in reversed(range(count)):
        marginals[k] = cho_solve(factors[k], identity, check_finite=False)
        if k + 1 < count:
            marginals[k] += gains[k] @ marginals[k + 1] @ gains[k].T
    return 0.5 * (marginals + marginals.swapaxes(-1, -2))
