"""Scores of an estimator on strips: errors, coverage and their correlation time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.time_series import autocorrelation_of, median_step_s
from .strips import StripRun

IRREGULAR = "irregular motion"
"""Name of the group of recordings that do not have one constant speed."""
LONGEST_LAG_S = 60.0
"""Largest lag of the autocorrelation of an error."""


@dataclass(frozen=True, slots=True)
class StripScore:
    """Errors of strain over some recordings."""

    samples: int
    """Number of samples."""
    rmse: float
    """Root mean square error of strain."""
    r2: float
    """Share of the variance of strain that the estimate explains."""
    coverage_68: float
    """Share of the errors within one sigma."""
    coverage_95: float
    """Share of the errors within 1.96 sigma."""
    median_sigma: float
    """Median of the sigma of strain, without which coverage is not meaningful."""
    correlation_s: float
    """Time after which the autocorrelation of the error has fallen to 1/e."""
    beyond: float
    """Share of the samples that are flagged as outside the range of the training."""

    @classmethod
    def of(cls, runs: Sequence[StripRun]) -> "StripScore":
        """Return the score over all samples of some runs."""
        error = np.concatenate([run.error for run in runs])
        strain = np.concatenate([run.strain for run in runs])
        sigma = np.concatenate([run.sigma for run in runs])
        beyond = np.concatenate([run.beyond for run in runs])
        z = np.abs(error / sigma)
        return cls(
            samples=len(error),
            rmse=float(np.sqrt(np.mean(error**2))),
            r2=float(1 - np.mean(error**2) / max(np.var(strain), 1e-12)),
            coverage_68=float(np.mean(z < 1)),
            coverage_95=float(np.mean(z < 1.96)),
            median_sigma=float(np.median(sigma)),
            correlation_s=float(np.mean([correlation_time_s(run) for run in runs])),
            beyond=float(np.mean(beyond)),
        )


def by_speed(runs: Sequence[StripRun]) -> dict[str, list[StripRun]]:
    """Return the runs in groups of one speed each, in order of speed; irregular motion is last."""
    groups: dict[str, list[StripRun]] = {}
    for run in sorted(runs, key=lambda run: (np.isnan(run.speed_per_s), float(f"{run.speed_per_s:.2g}"), run.name)):
        label = IRREGULAR if np.isnan(run.speed_per_s) else f"speed {run.speed_per_s:.2g} /s"
        groups.setdefault(label, []).append(run)
    return groups


def error_autocorrelation(run: StripRun) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (lags,) lags in seconds, and (lags,) the autocorrelation of a run's error at these lags.

    Of a run of one sample only the lag 0 is known.
    """
    if len(run.t_s) < 2:
        return np.zeros(1), np.ones(1)
    step_s = median_step_s(run.t_s)
    even_s = np.arange(run.t_s[0], run.t_s[-1], step_s)
    correlation = autocorrelation_of(np.interp(even_s, run.t_s, run.error))
    lag_s = np.arange(0.0, len(correlation)) * step_s
    return lag_s[lag_s <= LONGEST_LAG_S], correlation[lag_s <= LONGEST_LAG_S]


def correlation_time_s(run: StripRun) -> float:
    """Return the lag at which the error's autocorrelation first falls below 1/e."""
    lag_s, correlation = error_autocorrelation(run)
    below = np.flatnonzero(correlation < np.exp(-1))
    return float(lag_s[below[0]] if len(below) else lag_s[-1])
