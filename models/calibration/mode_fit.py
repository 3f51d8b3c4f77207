"""The odds of bending against stretching for a reading, from histograms of the calibration recordings."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..sensor.bending import LagFree
from ..sensor.sensor_model import ModeOdds
from .recordings import Recording

CHANGE_STEP = 0.001
"""Width of a bin of dR/R."""
CHANGE_RANGE = (-0.3, 0.3)
"""Range of the bins of dR/R."""
KERNEL = 0.004
"""Standard deviation of the Gaussian that smooths the histograms, in dR/R."""


def fit_mode(recordings: Sequence[Recording]) -> ModeOdds:
    """Return the log likelihood ratio of the modes as a function of dR/R, from smoothed histograms.

    Near zero strain bent and stretched strips have the same dR/R, because eq. (9) has a fold there. So the ratio is
    counted and not derived, from samples with almost no lag. Outside of the bins that were seen, that of the nearest
    applies.
    Without recordings of both modes the ratio follows the sign of dR/R.
    """
    edges = np.arange(*CHANGE_RANGE, CHANGE_STEP)
    counts = np.zeros((2, len(edges) - 1))
    for recording in recordings:
        step_s = np.diff(recording.t_s, prepend=recording.t_s[0] - 0.05)
        change, lag = np.stack(LagFree(1).run(recording.change[:, None], step_s[:, None]))[..., 0]
        settled = recording.settled & (np.abs(lag) < KERNEL)
        for mode, chosen in enumerate((recording.strain >= 0, recording.strain < 0)):
            chosen = chosen & settled & (np.abs(recording.strain) < 0.3)
            counts[mode] += np.histogram(np.clip(change[chosen], edges[0], edges[-1] - 1e-9), edges)[0]
    middle = 0.5 * (edges[1:] + edges[:-1])
    if (counts.sum(axis=1) == 0).any():
        return ModeOdds(middle, np.where(middle < 0, 5.0, -5.0))
    density = gaussian_filter1d(counts / counts.sum(axis=1, keepdims=True), KERNEL / CHANGE_STEP, mode="nearest")
    floor = 1e-6
    seen = np.flatnonzero(counts.sum(axis=0))
    bins = slice(seen[0], seen[-1] + 1)
    return ModeOdds(middle[bins], np.log((density[1] + floor) / (density[0] + floor))[bins])
