"""Eq. (9) fitted anew, to the recordings in which strips bend."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..sensor.bending import BendingCurve, LagFree
from ..values.correlation import correlation_samples
from .recordings import Recording


@dataclass(frozen=True, slots=True, eq=False)
class BendingFit:
    """Eq. (9) fitted anew, with x = strain."""

    coefficients: NDArray[np.float64]
    """(6,) highest power first, of dR/R."""
    covariance: NDArray[np.float64]
    """(6, 6) of these; residuals last for seconds, and count as many fewer."""
    r2: float
    """Share of the variance of dR/R explained, on the recordings fitted, ..."""
    held_out_r2: float
    """... and on those held out; nan without any."""
    residual_sigma: float
    """Standard deviation of dR/R about the curve."""
    lowest_strain: float
    """As far as the recordings go."""

    def curve(self) -> BendingCurve:
        """Return the curve, for use."""
        return BendingCurve("strain", self.coefficients)


def fit_bending(recordings: Sequence[Recording], held_out: Sequence[Recording]) -> BendingFit | None:
    """Return the polynomial of degree five through the bent samples, their lag undone; None when there are too few.

    The covariance is sigma^2 (X'X)^-1 times the residuals' time of correlation in samples, 1 + 2 sum of their positive
    autocorrelation.
    """
    bent = [_lag_free_bending(r) for r in recordings if r.stretched_share < 0.5]
    if not bent or min(x.min() for x, _ in bent) > -0.1:
        return None
    x, y = (np.concatenate(column) for column in zip(*bent, strict=True))
    basis = np.vander(x, 6)
    coefficients = np.linalg.lstsq(basis, y, rcond=None)[0]
    residual = y - basis @ coefficients
    sigma = float(residual.std())
    correlated = [correlation_samples(part_y - np.polyval(coefficients, part_x)) for part_x, part_y in bent]
    covariance = sigma**2 * np.linalg.inv(basis.T @ basis) * float(np.mean(correlated))
    tested = [_lag_free_bending(r) for r in held_out if r.stretched_share < 0.5]
    held_out_r2 = float("nan")
    if tested:
        test_x, test_y = (np.concatenate(column) for column in zip(*tested, strict=True))
        held_out_r2 = 1 - float(np.var(test_y - np.polyval(coefficients, test_x)) / np.var(test_y))
    r2 = 1 - sigma**2 / float(np.var(y))
    return BendingFit(
        coefficients=coefficients,
        covariance=covariance,
        r2=r2,
        held_out_r2=held_out_r2,
        residual_sigma=sigma,
        lowest_strain=float(x.min()),
    )


def _lag_free_bending(recording: Recording) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return strain and lag-free dR/R of the settled bent samples."""
    lag_free = LagFree(1)
    step_s = np.diff(recording.t_s, prepend=2 * recording.t_s[0] - recording.t_s[1])
    pairs = zip(recording.change, step_s, strict=True)
    change = np.array([lag_free.step(np.array([y]), float(dt))[0][0] for y, dt in pairs])
    chosen = recording.settled & (recording.strain < 0) & (recording.t_s > recording.scored_from_s)
    return recording.strain[chosen], change[chosen]
