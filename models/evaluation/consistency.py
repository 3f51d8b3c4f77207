"""Consistency of errors with the estimated covariances: NEES, NIS and coverage."""

import numpy as np
from numpy.typing import NDArray

from ..structure.reconstruction import Reconstruction
from ..values.chi_squared import chi_squared_quantile, squared_distance
from ..values.time_series import correlation_samples, mean_over_frames
from .evaluation import ComparedFrames, Consistency
from .statistics import of_known

REDUNDANT = 0.5
"""Least ratio of the sigma of the innovation to the sigma of the length with which a length is in the NIS. Below it the
shape follows the length so closely that the innovation is no test."""


def consistency(estimate: Reconstruction, compared: ComparedFrames) -> Consistency:
    """Return NEES, NIS and coverage of an estimate, and the bands in which they lie when it is consistent."""
    tendons = estimate.structure.free_tendons
    innovation_m = (estimate.length_m - estimate.predicted_m)[:, tendons]
    innovation_sigma_m = estimate.innovation_sigma_m[:, tendons]
    innovation = innovation_m / np.maximum(innovation_sigma_m, 1e-9)
    sigma_m = estimate.sigma_m[:, tendons]
    checked = np.isfinite(sigma_m) & (innovation_sigma_m >= REDUNDANT * sigma_m)
    nis = np.where(checked, innovation**2, np.nan)
    count = np.array([independent_count(column) for column in compared.nees.T])
    return Consistency(
        nees=mean_over_frames(compared.nees),
        nees_band=np.array([mean_band(3, n) for n in count]),
        independent_frames=count,
        coverage_50=coverage(compared.nees, 0.50),
        coverage_68=coverage(compared.nees, 0.68),
        coverage_95=coverage(compared.nees, 0.95),
        median_sigma_m=of_known(np.median, compared.node_sigma_m),
        nis=of_known(np.mean, nis),
        nis_band=mean_band(1, sum(independent_count(column) for column in nis.T)),
    )


def normalised_error_squared(error_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) NEES e^T P^-1 e of (..., 3) errors e with (..., 3, 3) covariances P; nan where either is unknown.

    It is inf where P has an eigenvalue that is not positive.
    """
    known = np.isfinite(error_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-2, -1))
    e = error_m[known]
    covariance = covariance_m2[known]
    singular = np.linalg.eigvalsh(covariance)[:, 0] <= 0
    nees = np.full(known.shape, np.nan)
    regular = np.where(singular[:, None, None], np.eye(3), covariance)
    nees[known] = np.where(singular, np.inf, squared_distance(e, regular))
    return nees


def coverage(nees: NDArray[np.float64], probability: float) -> float:
    """Return the share of errors within the ellipsoid of a probability, e^T P^-1 e <= chi2_3; nan without errors."""
    return of_known(lambda known: np.mean(known <= chi_squared_quantile(probability, 3)), nees)


def mean_band(degrees: int, count: float) -> tuple[float, float]:
    """Return the interval that contains 95 % of the means of `count` independent chi-square values; nan for none."""
    low, high = chi_squared_quantile([0.025, 0.975], degrees * count) / count if count > 0 else (np.nan, np.nan)
    return float(low), float(high)


def independent_count(series: NDArray[np.float64]) -> float:
    """Return the effective number of independent values in a series: n / (1 + 2 sum rho_k).

    rho is the autocorrelation, summed up to its first value that is not positive (a similar bound is in Geyer,
    Statistical Science 7, 1992). The number is 0 for an empty series and 1 for a constant one.
    """
    series = series[np.isfinite(series)]
    if len(series) == 0 or np.ptp(series) == 0:
        return float(min(len(series), 1))
    return max(len(series) / correlation_samples(series - series.mean()), 1.0)
