"""Strain as a curve of dR/R and of how far that is from its running means: what the network corrects.

    strain = w s(y') + p(y', y' - m_1', y' - m_2', ...) + s(y) - s(y')

s is the inverse of the static gauge curve, y = dR/R, m_i its running mean over `memory_s`, p a cubic, and a dash means
held within the range that it was fitted in: a cubic runs away outside, while s goes on straight. What is not known of
the coefficients is a sigma of strain, small where recordings reach and large between and beyond them.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from .gauge import StaticGauge

DEGREE = 3


@dataclass(frozen=True, slots=True, eq=False)
class RateCurve:
    """The curve, fitted."""

    gauge: StaticGauge
    """s is its inverse."""
    memory_s: NDArray[np.float64]
    """(memories,) time constants of the running means."""
    scale: NDArray[np.float64]
    """(1 + memories,) of the inputs y, y - m_1, y - m_2, ..."""
    range: NDArray[np.float64]
    """(2, 1 + memories) least and largest of these in the fit."""
    coefficients: NDArray[np.float64]
    """(terms + 1,) of the scaled inputs' products, in the order of `product_indices`; the last one is w."""
    factor: NDArray[np.float64]
    """(terms + 1, terms + 1) F of their covariance F F'; residuals last for seconds, and count as many fewer."""

    def strain(self, change: NDArray[np.float64], means: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return strain from (...) dR/R and its (..., memories) running means."""
        inputs = rate_inputs(change, means)
        terms = curve_terms(np.clip(inputs, *self.range), self.scale, self.gauge)
        beyond = self.gauge.stretched_strain(change) - terms[..., -1]
        return np.asarray(terms @ self.coefficients + beyond)

    def sigma(self, change: NDArray[np.float64], means: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain sigma that the coefficients leave; of y alone beyond its range see `Extrapolation`."""
        inputs = rate_inputs(change, means)
        inputs[..., 0] = np.clip(inputs[..., 0], *self.range[:, 0])
        return np.asarray(np.linalg.norm(curve_terms(inputs, self.scale, self.gauge) @ self.factor, axis=-1))


def rate_inputs(change: NDArray[np.float64], means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 1 + memories): dR/R, and its distances from its running means."""
    return np.concatenate([change[..., None], change[..., None] - means], axis=-1)


@cache
def product_indices(inputs: int) -> NDArray[np.int64]:
    """Return (terms, DEGREE) which of 1 and the inputs to multiply, for all products of up to `DEGREE` of them."""
    return np.array(list(combinations_with_replacement(range(1 + inputs), DEGREE)))


def products(inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., terms): all products of up to `DEGREE` of the (..., inputs), 1 among them."""
    factors = np.concatenate([np.ones((*inputs.shape[:-1], 1)), inputs], axis=-1)
    first, second, third = (factors[..., index] for index in product_indices(inputs.shape[-1]).T)
    return np.asarray(first * second * third)


def curve_terms(inputs: NDArray[np.float64], scale: NDArray[np.float64], gauge: StaticGauge) -> NDArray[np.float64]:
    """Return (..., terms + 1): the products, and the static curve's strain."""
    return np.concatenate([products(inputs / scale), gauge.stretched_strain(inputs[..., 0])[..., None]], axis=-1)
