"""The baselines of the network: a static monotone curve, and a polynomial of resistance and filtered rates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from ..sensor.lstm import running_means
from ..sensor.rate_curve import products, rate_inputs
from .rate_curve_fit import rate_samples, ridge
from .recordings import Recording
from .strain_estimators import EstimatedStrain

LEAST_SIGMA = 1e-6
"""Smallest standard deviation of a baseline's strain: far below that of any rig."""
FILTERS_S = np.array([0.3, 2.0, 10.0])
"""Time constants of the filters: that of the sensor's lag, and two of its relaxation over seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class StaticEstimator:
    """strain = s(dR/R) without memory, where s is monotone and fitted by isotonic regression."""

    change: NDArray[np.float64]
    """(knots,) dR/R at the knots of s."""
    strain: NDArray[np.float64]
    """(knots,) strain at the knots of s."""
    sigma: float
    """Standard deviation of the error in training."""

    @classmethod
    def fit(cls, recordings: Sequence[Recording], unified: bool) -> "StaticEstimator":
        """Return the estimator fitted to recordings on the common curve; unified includes bent samples."""
        inputs, strain = rate_samples(recordings, np.empty(0), unified)
        change = inputs[:, 0]
        order = np.argsort(change, kind="stable")
        fitted = isotonic_regression(strain[order]).x
        knots = np.unique(np.linspace(0, len(order) - 1, 400).astype(np.int64))
        curve_change, first = np.unique(change[order][knots], return_index=True)
        curve_strain = fitted[knots][first]
        return cls(curve_change, curve_strain, _spread(strain - np.interp(change, curve_change, curve_strain)))

    def estimate(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> EstimatedStrain:
        """Return strain and sigma, see `StrainEstimator`."""
        return _with_constant_sigma(np.interp(change, self.change, self.strain), self.sigma)


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialEstimator:
    """Strain as a cubic polynomial of dR/R and its differences from three running means, which are filtered rates."""

    scale: NDArray[np.float64]
    """(4,) divisors of the four inputs."""
    coefficients: NDArray[np.float64]
    """(35,) coefficients of all products of up to three inputs."""
    sigma: float
    """Standard deviation of the error in training."""

    @classmethod
    def fit(cls, recordings: Sequence[Recording], unified: bool) -> "PolynomialEstimator":
        """Return the estimator fitted to recordings on the common curve; unified includes bent samples."""
        inputs, strain = rate_samples(recordings, FILTERS_S, unified)
        scale: NDArray[np.float64] = np.maximum(inputs.std(axis=0), 1e-9)
        terms = products(inputs / scale)
        coefficients, _ = ridge(terms, strain)
        return cls(scale, coefficients, _spread(strain - terms @ coefficients))

    def estimate(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> EstimatedStrain:
        """Return strain and sigma, see `StrainEstimator`."""
        inputs = rate_inputs(change, running_means(change, step_s, FILTERS_S))
        return _with_constant_sigma(products(inputs / self.scale) @ self.coefficients, self.sigma)


def _spread(error: NDArray[np.float64]) -> float:
    """Return the standard deviation of errors in training; a curve through all of few samples has none of its own."""
    return max(float(np.std(error)), LEAST_SIGMA)


def _with_constant_sigma(strain: NDArray[np.float64], sigma: float) -> EstimatedStrain:
    sigmas = np.full(strain.shape, sigma)
    spread = np.zeros(strain.shape)
    beyond = np.zeros(strain.shape, dtype=np.bool_)
    return EstimatedStrain(strain, sigmas, sigmas, spread, beyond)
