"""Stretching or bending: how often a reading belonged to a bent strip, in the calibration recordings."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ..calibration.recordings import Recording

LAG_S = (0.124, 0.236)
"""Time constants of a bent sensor, bending and straightening: the paper's 286 and 544 ms to 90 %, over ln 10."""
SMOOTHING_S = 0.06
"""Memory of the rate by which the lag is undone."""
CHANGE_STEP, CHANGE_RANGE, KERNEL = 0.001, (-0.3, 0.3), 0.004
"""Bins of dR/R, and the width to which they are smoothed."""


class LagFree:
    """dR/R with a bent sensor's lag undone: y + tau dy/dt, the rate taken of y smoothed.

    On the bending recordings that takes the error of eq. (9) from 0.019 to 0.007 strain.
    """

    def __init__(self, sensors: int) -> None:
        self._smooth = np.full(sensors, np.nan)

    def step(self, change: NDArray[np.float64], step_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (sensors,) lag-free dR/R, and by how much it differs from the given one."""
        smooth = np.where(np.isnan(self._smooth), change, self._smooth)
        rate = (change - smooth) * (1 - np.exp(-step_s / SMOOTHING_S)) / step_s
        self._smooth = smooth + rate * step_s
        lag = np.where(rate < 0, *LAG_S) * rate
        return change + lag, lag


def fit_mode(recordings: Sequence[Recording]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return dR/R (bins,) and log p(dR/R | bending) / p(dR/R | stretching) (bins,), from smoothed histograms.

    Near zero strain bent and stretched strips read the same (eq. (9) folds): what a reading says of the mode is
    counted, not derived, over samples that hardly lag. Beyond the bins the outermost ratio holds. Without recordings
    of both modes the ratio is that of the sign of dR/R.
    """
    edges = np.arange(*CHANGE_RANGE, CHANGE_STEP)
    counts = np.zeros((2, len(edges) - 1))
    for recording in recordings:
        lag_free, step_s = LagFree(1), np.diff(recording.t_s, prepend=recording.t_s[0] - 0.05)
        pairs = zip(recording.change, step_s, strict=True)
        change, lag = np.array([lag_free.step(np.array([y]), float(dt)) for y, dt in pairs])[..., 0].T
        settled = recording.settled & (np.abs(lag) < KERNEL)
        for mode, chosen in enumerate((recording.strain >= 0, recording.strain < 0)):
            chosen = chosen & settled & (np.abs(recording.strain) < 0.3)
            counts[mode] += np.histogram(np.clip(change[chosen], edges[0], edges[-1] - 1e-9), edges)[0]
    middle = 0.5 * (edges[1:] + edges[:-1])
    if (counts.sum(axis=1) == 0).any():
        return middle, np.where(middle < 0, 5.0, -5.0)
    density = gaussian_filter1d(counts / counts.sum(axis=1, keepdims=True), KERNEL / CHANGE_STEP, mode="nearest")
    floor = 1e-6
    return middle, np.log((density[1] + floor) / (density[0] + floor))
