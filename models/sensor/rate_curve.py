"""The rate curve: strain as a function of dR/R and its differences from its running means. The network corrects it.

    strain = w s(y') + p(y', y' - m_1', y' - m_2', ...) + s(y) - s(y')

s is the inverse of the static gauge curve, y = dR/R, m_i its running mean over `memory_s`, and p a cubic polynomial. A
prime means that a quantity is clipped to the range in which it was fitted, because a cubic diverges outside of it; s
continues straight there. The covariance of the coefficients gives a sigma of strain, which is small where there are
recordings and large between and beyond them.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from .gauge import StaticGauge

DEGREE = 3
"""Degree of the polynomial p."""


@dataclass(frozen=True, slots=True, eq=False)
class RateCurve:
    """A fitted rate curve."""

    gauge: StaticGauge
    """The static gauge curve, whose inverse is s."""
    memory_s: NDArray[np.float64]
    """(memories,) time constants of the running means."""
    scale: NDArray[np.float64]
    """(1 + memories,) divisors of the inputs y, y - m_1, y - m_2, ..."""
    range: NDArray[np.float64]
    """(2, 1 + memories) least and largest value of each input in the fit."""
    coefficients: NDArray[np.float64]
    """(terms + 1,) coefficients of the products of scaled inputs, in the order of `product_indices`; the last one is
    w."""
    factor: NDArray[np.float64]
    """(terms + 1, terms + 1) factor F of the covariance F F' of the coefficients. The covariance allows for residuals
    that are correlated over seconds."""

    def estimate(
        self, change: NDArray[np.float64], means: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return strain from (...) dR/R and its (..., memories) running means, and its sigma due to the coefficients.

        In the sigma, only y is clipped to its range in the fit, not its differences from its means. `Extrapolation`
        adds the uncertainty outside of this range.
        """
        inputs = rate_inputs(change, means)
        clipped = np.minimum(np.maximum(inputs, self.range[0]), self.range[1])
        inputs[..., 0] = clipped[..., 0]
        of_strain, of_sigma = products(np.stack([clipped, inputs]) / self.scale)
        on_gauge, beyond = self.gauge.stretched_strain(np.stack([clipped[..., 0], change]))
        strain = of_strain @ self.coefficients[:-1] + self.coefficients[-1] * on_gauge + (beyond - on_gauge)
        spread = of_sigma @ self.factor[:-1] + on_gauge[..., None] * self.factor[-1]
        return strain, np.sqrt((spread**2).sum(axis=-1))


def rate_inputs(change: NDArray[np.float64], means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 1 + memories): dR/R, and the differences from its running means."""
    return np.concatenate([change[..., None], change[..., None] - means], axis=-1)


@cache
def product_indices(inputs: int) -> NDArray[np.int64]:
    """Return (terms, DEGREE) the factors of each product of up to `DEGREE` inputs: 0 is the factor 1, k is input k."""
    return np.array(list(combinations_with_replacement(range(1 + inputs), DEGREE)))


def products(inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., terms): all products of up to `DEGREE` of the (..., inputs), the first of which is 1."""
    factors = np.concatenate([np.ones((*inputs.shape[:-1], 1)), inputs], axis=-1)
    first, second, third = product_indices(inputs.shape[-1]).T
    return np.asarray(factors[..., first] * factors[..., second] * factors[..., third])


def curve_terms(inputs: NDArray[np.float64], scale: NDArray[np.float64], gauge: StaticGauge) -> NDArray[np.float64]:
    """Return (..., terms + 1): the products of the scaled inputs, and the strain s of the static gauge curve."""
    return np.concatenate([products(inputs / scale), gauge.stretched_strain(inputs[..., 0])[..., None]], axis=-1)
