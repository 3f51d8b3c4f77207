"""Whether errors are as large as the covariances say: NEES, NIS, coverage."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ..structure.structure import Structure
from ..values.correlation import correlation_samples
from .estimate import Estimate
from .evaluation import ComparedFrames, Consistency
from .statistics import mean_over_frames, of_known

REDUNDANT = 0.1
"""A length whose innovation has less than this share of its own sigma was taken by the shape as it came: no check."""


def consistency(structure: Structure, estimate: Estimate, compared: ComparedFrames) -> Consistency:
    """Return whether errors and innovations are as large as the covariances say."""
    tendons = structure.free_tendons
    predicted_m = structure.tendon_length_m(estimate.node_position_m)
    innovation = ((estimate.length_m - predicted_m) / np.maximum(estimate.innovation_sigma_m, 1e-9))[:, tendons]
    sigma_m = estimate.sigma_m[:, tendons]
    checked = np.isfinite(sigma_m) & (estimate.innovation_sigma_m[:, tendons] > REDUNDANT * sigma_m)
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
    """Return (...,) NEES e^T P^-1 e of (..., 3) errors; nan where either is unknown."""
    known = np.isfinite(error_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-2, -1))
    e = error_m[known]
    covariance = covariance_m2[known]
    sure = np.linalg.eigvalsh(covariance)[:, 0] <= 0  # claims to know some direction exactly
    solved = np.linalg.solve(np.where(sure[:, None, None], np.eye(3), covariance), e[..., None])[..., 0]
    nees = np.full(known.shape, np.nan)
    nees[known] = np.where(sure, np.inf, np.einsum("ni,ni->n", e, solved))
    return nees


def coverage(nees: NDArray[np.float64], probability: float) -> float:
    """Return the share of errors within the ellipsoid of some probability, e^T P^-1 e <= chi2_3; nan of none."""
    return of_known(lambda known: np.mean(known <= chi2.ppf(probability, 3)), nees)


def mean_band(degrees: int, count: float) -> tuple[float, float]:
    """Return where 95 % of the means of so many independent chi-square values lie; nan of none."""
    low, high = chi2.ppf([0.025, 0.975], degrees * count) / count if count > 0 else (np.nan, np.nan)
    return float(low), float(high)


def independent_count(series: NDArray[np.float64]) -> float:
    """Return how many independent values are worth as much for a mean as this series: n / (1 + 2 sum rho_k).

    rho is the autocorrelation, summed up to where it first is not positive (Geyer, Statistical Science 7, 1992, cuts
    likewise); 0 of an empty series, 1 of a constant one.
    """
    series = series[np.isfinite(series)]
    if len(series) == 0 or np.ptp(series) == 0:
        return float(min(len(series), 1))
    return max(len(series) / correlation_samples(series - series.mean()), 1.0)
