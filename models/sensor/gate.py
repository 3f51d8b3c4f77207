"""What a single sensor's readings say against themselves: jumps there and back, and codes that never change."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.readings import Flag
from ..values.tables import AtLeastOne, Positive, Probability


@dataclass(frozen=True, slots=True)
class GateSettings:
    """When a reading is not believed."""

    max_rate_per_s: Positive = 4.0
    """Of dR/R. The calibration recordings, random motion included, exceed it in less than one reading of 1000."""
    accept_after: AtLeastOne = 3
    """This many readings in succession that jumped to the same place are believed after all."""
    stuck_s: Positive = 1.0
    """A sensor is stuck after this long on one code, if noise makes that very unlikely, ..."""
    stuck_probability: Probability = 1e-9
    """... that is, less likely than this, by how often the code has stayed the same so far."""


class ReadingGate:
    """Flags outliers and stuck sensors of one source, reading by reading, and blanks them."""

    def __init__(self, settings: GateSettings, sensors: int) -> None:
        self._settings = settings
        self._accepted = np.full(sensors, np.nan)
        self._accepted_s = np.full(sensors, np.nan)
        self._rejected = np.full(sensors, np.nan)
        self._rejections = np.zeros(sensors, dtype=np.int64)
        self._last = np.full(sensors, np.nan)
        self._last_s = np.nan
        self._same_since_s = np.full(sensors, np.nan)
        self._run = np.zeros(sensors)
        self._same = np.full(sensors, 49.0)  # a quiet sensor, until it shows noise
        self._seen = np.full(sensors, 50.0)

    def check(
        self, t_s: float, value: NDArray[np.float64], sigma: NDArray[np.float64], flags: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the values, nan where they are not believed, and the flags with the reasons added.

        Args:
            t_s: when the values were measured.
            value: (sensors,) dR/R, nan where there is none.
            sigma: (sensors,) its sigma.
            flags: (sensors,) `Flag` bits so far.
        """
        outlier = self._jumps(t_s, value, sigma)
        stuck = self._stays(t_s, value)
        flags = flags | np.where(outlier, Flag.OUTLIER, 0) | np.where(stuck, Flag.STUCK, 0)
        return np.where(outlier | stuck, np.nan, value), flags

    def _jumps(self, t_s: float, value: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.bool_]:
        finite = np.isfinite(value)
        room = self._settings.max_rate_per_s * (t_s - self._accepted_s) + 8 * sigma
        jumped = finite & (np.abs(value - self._accepted) > room)
        again = jumped & (np.abs(value - self._rejected) <= room)
        self._rejections = np.where(
            again, self._rejections + 1, np.where(jumped, 1, np.where(finite, 0, self._rejections))
        )
        self._rejected = np.where(jumped, value, self._rejected)
        outlier: NDArray[np.bool_] = jumped & (self._rejections < self._settings.accept_after)
        taken = finite & ~outlier
        self._accepted = np.where(taken, value, self._accepted)
        self._accepted_s = np.where(taken, t_s, self._accepted_s)
        return outlier

    def _stays(self, t_s: float, value: NDArray[np.float64]) -> NDArray[np.bool_]:
        finite = np.isfinite(value)
        same = finite & (value == self._last)
        ended = finite & ~same  # only runs that have ended say how often a code stays: the present one is to be judged
        counted = ended & np.isfinite(self._last)
        self._same += np.where(counted, self._run, 0)
        self._seen += np.where(counted, self._run + 1, 0)
        self._run = np.where(same, self._run + 1, np.where(ended, 0, self._run))
        self._same_since_s = np.where(ended, t_s, self._same_since_s)
        self._last = np.where(finite, value, self._last)
        unlikely = self._run * np.log(self._same / self._seen) < np.log(self._settings.stuck_probability)
        stuck: NDArray[np.bool_] = same & unlikely & (t_s - self._same_since_s >= self._settings.stuck_s)
        return stuck
