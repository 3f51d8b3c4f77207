"""How far values are from what they should be, in standard deviations, and how probable that is."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv

IMPROBABLE = 1e-3
"""Probability of values as far from what they should be, below which they are others."""
DRAWN = 10_000
"""Number of samples from which it is computed what is probable."""


def squared_distance(e: NDArray[np.float64], S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) e^T S^-1 e of (..., n) errors e with (..., n, n) covariances S, after Mahalanobis.

    It is distributed as chi^2 of n degrees where the errors are as S tells.
    """
    return np.asarray(np.sum(e * np.linalg.solve(S, e[..., None])[..., 0], axis=-1))


def chi_squared_quantile(probability: ArrayLike, degrees: ArrayLike) -> NDArray[np.float64]:
    """Return chi2_degrees(probability), below which the sum of `degrees` squared standard normal variables lies.

    The same as `scipy.stats.chi2.ppf`, without the import of that module, which takes a second.
    """
    return np.asarray(2 * gammaincinv(np.asarray(degrees) / 2, probability))


def are_improbable(apart: NDArray[np.float64], faulty: int) -> bool:
    """Return whether (n,) values, so many standard deviations from what they should be, are others.

    Their sum of squares without the largest ones has a probability below `IMPROBABLE`.

    Args:
        apart: (n,)
        faulty: how many of them may be wrong.
    """
    kept = len(apart) - faulty
    return kept > 0 and bool(np.sort(apart**2)[:kept].sum() > _largest_by_chance(len(apart), kept))


@cache
def _largest_by_chance(count: int, kept: int) -> float:
    """Return what the sum of the smallest squares of standard normal variables exceeds in `IMPROBABLE` cases."""
    drawn = np.random.default_rng(0).standard_normal((DRAWN, count))
    return float(np.quantile(np.sort(drawn**2, axis=1)[:, :kept].sum(axis=1), 1 - IMPROBABLE))
