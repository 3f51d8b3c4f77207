"""The fit of the polynomial of eq. (9) to the recordings in which strips bend."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..sensor.bending import LEAST_BENT, BendingCurve, LagFree
from ..values.errors import InputError
from ..values.time_series import correlation_samples
from .recordings import Recording


@dataclass(frozen=True, slots=True, eq=False)
class BendingFit:
    """The polynomial of eq. (9) with x = strain, fitted to recordings."""

    coefficients: NDArray[np.float64]
    """(6,) coefficients of dR/R as a polynomial of strain, highest power first."""
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the coefficients. It allows for residuals that are correlated over seconds."""
    r2: float
    """Share of the variance of dR/R that the fit explains on the fitted recordings."""
    held_out_r2: float
    """Share of the variance of dR/R that the fit explains on the recordings held out; nan when there are none."""
    residual_sigma: float
    """Standard deviation of dR/R about the curve."""
    lowest_strain: float
    """The lowest strain in the fitted recordings."""

    def curve(self) -> BendingCurve:
        """Return the curve in the form that converts between dR/R and strain."""
        return BendingCurve("strain", self.coefficients)


def fit_bending(recordings: Sequence[Recording], held_out: Sequence[Recording]) -> BendingFit | None:
    """Return the polynomial of degree five through the bent samples, corrected for lag.

    It is None when no recording bends, none bends as far as `LEAST_BENT`, or their samples do not determine it. The
    covariance is sigma^2 (X'X)^-1 times the correlation time of the residuals in samples, see `correlation_samples`.

    Raises:
        InputError: when the resistance of no recording that bends changes.
    """
    bent = _bent_samples(recordings)
    if not bent or min(strain.min() for strain, _ in bent) > LEAST_BENT:
        return None
    x = np.concatenate([strain for strain, _ in bent])
    y = np.concatenate([change for _, change in bent])
    if not np.ptp(y) > 0:
        names = ", ".join(r.name for r in recordings if _bends_mostly(r))
        raise InputError(f"recordings that bend: expected a resistance that changes with strain, got one in {names}")
    basis = np.vander(x, 6)
    if np.linalg.matrix_rank(basis) < 6:  # too few samples, or too few strains
        return None
    coefficients = np.linalg.lstsq(basis, y, rcond=None)[0]
    residual = y - basis @ coefficients
    sigma = float(residual.std())
    correlated = [correlation_samples(change - np.polyval(coefficients, strain)) for strain, change in bent]
    covariance = sigma**2 * np.linalg.inv(basis.T @ basis) * float(np.mean(correlated))
    tested = _bent_samples(held_out)
    held_out_r2 = float("nan")
    if tested:
        test_x = np.concatenate([strain for strain, _ in tested])
        test_y = np.concatenate([change for _, change in tested])
        held_out_r2 = _explained_share(test_y, test_y - np.polyval(coefficients, test_x))
    return BendingFit(
        coefficients=coefficients,
        covariance=covariance,
        r2=_explained_share(y, residual),
        held_out_r2=held_out_r2,
        residual_sigma=sigma,
        lowest_strain=float(x.min()),
    )


def _explained_share(values: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the share of the variance of values that a fit with these residuals explains; nan where none varies."""
    variance = float(np.var(values))
    return 1 - float(np.var(residual)) / variance if variance > 0 else float("nan")


def _bends_mostly(recording: Recording) -> bool:
    return recording.stretched_share < 0.5


def _bent_samples(recordings: Sequence[Recording]) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the samples of `_lag_free_bending` of the recordings that bend, and have any."""
    samples = (_lag_free_bending(recording) for recording in recordings if _bends_mostly(recording))
    return [(strain, change) for strain, change in samples if len(strain)]


def _lag_free_bending(recording: Recording) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (samples,) strain and (samples,) lag-free dR/R of the bent samples after settling."""
    change = LagFree(1).run(recording.change[:, None], recording.step_s[:, None])[0][:, 0]
    chosen = recording.settled & (recording.strain < 0) & (recording.t_s > recording.scored_from_s)
    return recording.strain[chosen], change[chosen]
