"""Consistency of errors with the estimated covariances: NEES, NIS and coverage."""

import numpy as np
from numpy.typing import NDArray

from ..structure.reconstruction import Reconstruction
from ..structure.shape import Status
from ..values.chi_squared import chi_squared_quantile, squared_distance
from ..values.time_series import autocorrelation_of, mean_over_frames
from .evaluation import ComparedFrames, Consistency
from .statistics import of_known, share_of_cases

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
    innovation = np.where(checked, innovation, np.nan)
    frames = np.isin(estimate.t_s, compared.t_s)
    is_ok = np.array([status == Status.OK for status in estimate.status])[frames]
    outside = compared.nees > chi_squared_quantile(0.999, 3)
    covariance_m2 = estimate.node_covariance_m2[frames]
    error = whitened(compared.node_error_m, covariance_m2[:, estimate.structure.free_nodes])
    count = np.array([independent_count(of_node) for of_node in np.moveaxis(error, 1, 0)])
    return Consistency(
        nees=mean_over_frames(compared.nees),
        nees_band=np.array([mean_band(3, n) for n in count]),
        independent_frames=count,
        coverage_50=coverage(compared.nees, 0.50),
        coverage_68=coverage(compared.nees, 0.68),
        coverage_95=coverage(compared.nees, 0.95),
        ok_outside_999=share_of_cases((is_ok[:, None] & outside)[~np.isnan(compared.nees)]),
        median_sigma_m=of_known(np.median, compared.node_sigma_m),
        nis=of_known(np.mean, innovation**2),
        nis_band=mean_band(1, sum(independent_count(of_tendon[:, None]) for of_tendon in innovation.T)),
    )


def normalised_error_squared(error_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) NEES e^T P^-1 e of (..., 3) errors e with (..., 3, 3) covariances P; nan where either is unknown.

    It is inf where P has an eigenvalue that is not positive.
    """
    known = _known(error_m, covariance_m2)
    e = error_m[known]
    covariance = covariance_m2[known]
    singular = np.linalg.eigvalsh(covariance)[:, 0] <= 0
    nees = np.full(known.shape, np.nan)
    regular = np.where(singular[:, None, None], np.eye(3), covariance)
    nees[known] = np.where(singular, np.inf, squared_distance(e, regular))
    return nees


def whitened(error_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3) P^(-1/2) e, of errors e with covariances P, whose covariance is the identity if that of e is P.

    The square of their length is the NEES. The root is the symmetric one, so that directions stay what they are from
    frame to frame. They are nan where error or covariance is unknown, and where P has an eigenvalue that is not
    positive.

    Args:
        error_m: (..., 3)
        covariance_m2: (..., 3, 3)
    """
    known = _known(error_m, covariance_m2)
    variance_m2, axes = np.linalg.eigh(covariance_m2[known])
    variance_m2[variance_m2[:, 0] <= 0] = np.nan
    along = np.einsum("nji,nj->ni", axes, error_m[known]) / np.sqrt(variance_m2)
    error = np.full(error_m.shape, np.nan)
    error[known] = np.einsum("nij,nj->ni", axes, along)
    return error


def _known(error_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(error_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-2, -1)))


def coverage(nees: NDArray[np.float64], probability: float) -> float:
    """Return the share of errors within the ellipsoid of a probability, e^T P^-1 e <= chi2_3; nan without errors."""
    return of_known(lambda known: np.mean(known <= chi_squared_quantile(probability, 3)), nees)


def mean_band(degrees: int, count: float) -> tuple[float, float]:
    """Return the interval that contains 95 % of the means of `count` independent chi-square values; nan for none."""
    low, high = chi_squared_quantile([0.025, 0.975], degrees * count) / count if count > 0 else (np.nan, np.nan)
    return float(low), float(high)


def independent_count(error: NDArray[np.float64]) -> float:
    """Return the effective number of independent values among the squared lengths of errors over time.

    Of n normal errors with the autocorrelation r_k in each of three directions, which is 1 / 2 where a lasting error
    makes half of their variance, the mean squared length is as uncertain as that of

        N = n / (1 + 2 sum (1 - k / n) r_k^2)

    independent ones, since squares have the square of the autocorrelation. It is that of the errors, about zero: that
    of their squares, about their own mean, does not see an error that lasts for the whole series. They are summed up to
    the first r_k that is not positive (a similar bound is in Geyer, Statistical Science 7, 1992).

    Args:
        error: (values, directions) errors, each divided by its standard deviation; rows with a nan are left out.

    Returns:
        0 of no errors, and 1 of those that never change.
    """
    error = error[np.isfinite(error).all(axis=-1)]
    if len(error) == 0:
        return 0.0
    return max(len(error) / float(np.mean([_correlated_squares(along) for along in error.T])), 1.0)


def _correlated_squares(error: NDArray[np.float64]) -> float:
    """Return 1 + 2 sum (1 - k / n) r_k^2 of (n,) errors, up to the first r_k that is not positive."""
    with_share = autocorrelation_of(error)  # (1 - k / n) r_k
    not_positive = np.flatnonzero(with_share <= 0)
    end = int(not_positive[0]) if len(not_positive) else len(error)
    share = 1 - np.arange(1, end) / len(error)
    return float(1 + 2 * (with_share[1:end] ** 2 / share).sum())
