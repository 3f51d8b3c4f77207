"""How often an inertial sensor measures, when it did, and whether samples are missing.

Registers may be read more often than the sensor measures: a sample of which all values are those of the one before is
that one, read again. Pauses, in which the sensor is silent, do not count.

A sensor measures by a clock of its own, and stamps are often those of arrival. With s_k the time of a measurement, P
the mean time between two, u_k what the clock, or the one who asks the sensor, adds at random, and v_k the scatter of
the stamp t_k alone:

    s_k = s_k-1 + P + u_k,   t_k = s_k + v_k

Steps tell both variances, var(t_k - t_k-n) = n var(u) + 2 var(v), with n = 1 and n = `LONG_STEP`. The steady gain g of
the Kalman filter of s solves g^2 / (1 - g) = var(u) / var(v). Stamps are taken to be right in the mean.
"""

import math

from ..values.aids import READING_HOLDS_S

SLOW_S = 0.025
"""Mean time between two samples above which a sensor misses impacts: of three trials with 25 samples a second nodes
were 12, 21 and 38 mm off, in place of 12, 8 and 13 mm."""
PACKED = 0.25
"""Share of this time, below which two samples were stamped as they arrived, in one packet. Of two trials with packets
of 0.05 s, 3 % of the nodes were `ok` and outside of their ellipsoids of 99.9 %: samples are late by the time for which
they have waited."""
COUNTED = 100
"""Number of steps between samples from which their mean and its scatter are known."""
DUE_STEPS = 10
"""Number of steps, none of which is short as in a packet, from which their mean tells when the next sample is due: a
robot may be moved within a second."""
LATE = 1.5
"""Ratio of the time since the newest sample to the mean time between two, above which a sample is missing."""
FAR = 8.0
"""Standard deviations of the step from one sample to the next, above which it is a pause. Of exponentially
distributed steps one in 8000 is as long."""
UNSTEADY_S = 5e-4
"""Least standard deviation of u: stamps that scatter less stay as they are."""
LONG_STEP = 50
"""n of the long steps."""
LONG_STEPS = 20
"""Number of long steps over which the variances are means: they follow within ten seconds."""


class ImuCadence:
    """Follows the stamps of one sensor."""

    def __init__(self) -> None:
        self._latest_s = math.nan
        self._measured_s = math.nan
        self._total_s = 0.0
        self._steps = 0
        self._packed = 0
        self._step_variance_s2 = 0.0
        self._long_steps = 0
        self._long_variance_s2 = 0.0
        self._long_s = 0.0  # of the long step that is not complete, and of how many steps it is
        self._long_of = 0

    def observe(self, t_s: float) -> float:
        """Return when a sample was measured that has the stamp t_s, and is not the one before, read again."""
        step_s = t_s - self._latest_s
        self._latest_s = t_s
        if not 0 < step_s < READING_HOLDS_S or self._is_pause(step_s):  # nan of the first one
            self._long_s, self._long_of = 0.0, 0
            self._measured_s = t_s
        else:
            self._count(step_s)
            expected_s = self._measured_s + self._period_s
            self._measured_s = expected_s + self._gain * (t_s - expected_s)
        return self._measured_s

    @property
    def due_s(self) -> float:
        """When the sample after the newest should have come; infinite while that is not known, and of packets."""
        if self._steps < (COUNTED if self._packed else DUE_STEPS) or self._is_packed:
            return math.inf
        return self._measured_s + LATE * self._period_s

    def warnings(self) -> list[str]:
        """Return what looks wrong of the stamps."""
        texts: list[str] = []
        if self._steps < COUNTED:
            return texts
        if self._period_s > SLOW_S:
            expected = f"expected 0.01 s, or {SLOW_S:g} s at most"
            texts.append(f"a new sample each {self._period_s:.2g} s: {expected}: impacts between them are missed")
        if self._is_packed:
            texts.append("most samples come in packets: give the time at which each was measured")
        return texts

    def _is_pause(self, step_s: float) -> bool:
        """Return whether samples are missing between two, and the second has not only come late."""
        if self._steps < COUNTED:
            return False
        return step_s - self._period_s > max((LATE - 1) * self._period_s, FAR * math.sqrt(self._step_variance_s2))

    def _count(self, step_s: float) -> None:
        """Take on the time from one sample to the next."""
        self._total_s += step_s
        self._steps += 1
        self._packed += step_s < PACKED * self._period_s
        weight = 1 / min(self._steps, LONG_STEPS * LONG_STEP)
        self._step_variance_s2 += weight * ((step_s - self._period_s) ** 2 - self._step_variance_s2)
        self._long_s += step_s
        self._long_of += 1
        if self._long_of == LONG_STEP:
            self._long_steps += 1
            off_s = self._long_s - LONG_STEP * self._period_s
            self._long_variance_s2 += (off_s**2 - self._long_variance_s2) / min(self._long_steps, LONG_STEPS)
            self._long_s, self._long_of = 0.0, 0

    @property
    def _period_s(self) -> float:
        """P, the mean time between two samples."""
        return self._total_s / self._steps

    @property
    def _unsteady_s2(self) -> float:
        """var(u)."""
        excess_s2 = (self._long_variance_s2 - self._step_variance_s2) / (LONG_STEP - 1)
        return min(max(excess_s2, UNSTEADY_S**2), self._step_variance_s2)

    @property
    def _scatter_s2(self) -> float:
        """var(v)."""
        return (self._step_variance_s2 - self._unsteady_s2) / 2

    @property
    def _gain(self) -> float:
        """g; 1 until the variances are known."""
        if self._long_steps * LONG_STEP < COUNTED or self._scatter_s2 == 0:
            return 1.0
        return 2 / (1 + math.sqrt(1 + 4 * self._scatter_s2 / self._unsteady_s2))

    @property
    def _is_packed(self) -> bool:
        """Whether most samples come in packets."""
        return 2 * self._packed > self._steps
