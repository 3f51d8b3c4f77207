"""How often an inertial sensor measures, whether samples are missing, and whether stamps are those of measurements.

Registers may be read more often than the sensor measures: a sample of which all values are those of the one before is
that one, read again. Pauses, in which the sensor is silent, do not count.
"""

import numpy as np

from ..values.aids import READING_HOLDS_S

SLOW_S = 0.025
"""Mean time between two samples above which a sensor misses impacts: of two trials with 25 samples a second, 4 and 8 %
of the nodes were `ok` and outside of their ellipsoids of 99.9 %."""
PACKED = 0.25
"""Share of this time, below which two samples were stamped as they arrived, in one packet. Of a trial with packets of
0.1 s, 12 % of the nodes were `ok` and outside of their ellipsoids of 99.9 %."""
COUNTED = 100
"""Number of steps between samples from which their mean is known."""
LATE = 1.5
"""Ratio of the time since the newest sample to the mean time between two, above which a sample is missing."""


class ImuCadence:
    """Follows the stamps of some sensors."""

    def __init__(self, imus: int) -> None:
        self._latest_s = [np.nan] * imus
        self._total_s = np.zeros(imus)
        self._steps = np.zeros(imus, dtype=np.int64)
        self._packed = np.zeros(imus, dtype=np.int64)

    def observe(self, imu: int, t_s: float) -> None:
        """Take on the stamp of one more sample that is not the one before, read again."""
        step_s = t_s - self._latest_s[imu]
        self._latest_s[imu] = t_s
        if not 0 <= step_s < READING_HOLDS_S:  # nan of the first one
            return
        self._total_s[imu] += step_s
        self._steps[imu] += 1
        self._packed[imu] += step_s < PACKED * self._total_s[imu] / self._steps[imu]

    def misses(self, imu: int, since_s: float) -> bool:
        """Return whether samples of a sensor are missing, so long after its newest one."""
        if self._steps[imu] < COUNTED or self._is_packed(imu):
            return False
        return since_s > LATE * self._period_s(imu)

    def warnings(self, imu: int) -> list[str]:
        """Return what looks wrong of the stamps of a sensor."""
        texts: list[str] = []
        if self._steps[imu] < COUNTED:
            return texts
        period_s = self._period_s(imu)
        if period_s > SLOW_S:
            expected = f"expected 0.01 s, or {SLOW_S:g} s at most"
            texts.append(f"a new sample each {period_s:.2g} s: {expected}: impacts between them are missed")
        if self._is_packed(imu):
            texts.append("most samples come in packets: tell when each was measured")
        return texts

    def _period_s(self, imu: int) -> float:
        """Return the mean time between two samples."""
        return float(self._total_s[imu] / self._steps[imu])

    def _is_packed(self, imu: int) -> bool:
        """Return whether most samples come in packets."""
        return bool(2 * self._packed[imu] > self._steps[imu])
