"""By how much the shape is wrong while blows and pushes shake the structure, as inertial sensors feel it.

What changes the velocity of the body by D deforms it, too, at a rate in proportion to D, and strips follow late. With
the specific force f,

    D = int exp(-(t - s) / `SHAKEN_S`) | |f(s)| - g | ds,     sigma = tau D

is the standard deviation of each node's place in the shape, per axis, with tau of `PoseSettings.shape_lag_s`. No length
tells it: the lengths of all strips are late in the same way, and agree.
"""

import numpy as np
from numpy.typing import NDArray

from ....models.pose.imu_samples import ImuSamples

SHAKEN_S = 0.05
"""Memory of D: strips have followed after this time, and rods swing to and fro within it."""


class ShakeWatch:
    """Follows the error of the shape that shaking makes, frame by frame."""

    def __init__(self, shape_lag_s: float) -> None:
        """Begin at rest; see `PoseSettings.shape_lag_s`."""
        self._shape_lag_s = shape_lag_s
        self._changed_m_per_s = 0.0

    def observe(self, samples: ImuSamples | None, step_s: float) -> None:
        """Learn from the samples of sensors in one more frame; None without such sensors."""
        if samples is None:
            return
        kept = float(np.exp(-step_s / SHAKEN_S))
        felt = samples.excess_m_per_s2[samples.count > 0]
        gained_m_per_s = float(felt.mean()) * SHAKEN_S * (1 - kept) if len(felt) else 0.0
        self._changed_m_per_s = kept * self._changed_m_per_s + gained_m_per_s

    @property
    def shaken_m2(self) -> float:
        """Variance of each node's place in the shape, per axis, that shaking adds."""
        return (self._shape_lag_s * self._changed_m_per_s) ** 2


def shaken(covariance_m2: NDArray[np.float64], shaken_m2: float) -> NDArray[np.float64]:
    """Return (3 nodes, 3 nodes) the covariance of a shape, with the variance that shaking adds to each coordinate."""
    return np.asarray(covariance_m2 + shaken_m2 * np.eye(len(covariance_m2)))
