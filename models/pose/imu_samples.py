"""Means of inertial sensors over frames, from samples that are read at times of their own.

A sample x_k of a sensor, with the stamp s_k, tells the mean of the time since the sample before: sensors filter what
they measure. After the newest sample it is taken to last. The mean over a frame, from t' to t, is what this adds to the
integral up to t', as it was then:

    mean (t - t') = -x_0 (t' - s_0) + sum_k x_k (s_k - s_k-1) + x_n (t - s_n)

So the means of all frames sum up to the integral, however many samples fall into a frame. The mean of the samples of
each frame does not: where two of them fall into most frames, but one or three into some, a robot that lands hard was
turned wrongly by degrees. A sensor that is slower than the frames is read in each of them, too: x_n is the sample of a
frame in which none is due.

Samples are missing in a frame that has none, and in which one should have come. How the sensor has turned is not known
then: x_n is of before the impact that has shaken a wire loose. The sums begin anew with the next sample. Where it was
taken to last since x_n, a robot that had landed was tipped by 15 degrees after 0.1 s.

A rate that is larger than a sensor's range is cut off: the largest value is read again and again. So is a specific
force, for single samples in a shock: the largest value is that of a usual range, 2, 4, 8 or 16 g, or one read before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.floor import GRAVITY_M_PER_S2
from ..values.aids import READING_HOLDS_S, ImuReading

CUT_OFF_SAMPLES = 3
"""Number of samples in succession with the largest rate so far from which it is the end of the sensor's range."""
LEAST_CUT_OFF_RAD_PER_S = 1.0
"""Least end of a range; slower rates may repeat themselves."""
FORCE_RANGES_M_PER_S2 = GRAVITY_M_PER_S2 * np.array([2.0, 4.0, 8.0, 16.0])
"""Usual ends of the range of a specific force."""
NEAR_RANGE = 0.015
"""Share of a range, as which its end may differ from the usual one, by scale and bias."""
LEAST_CUT_OFF_M_PER_S2 = 15.0
"""Least end of a range; smaller forces may repeat themselves."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuSamples:
    """The means of each sensor over one frame, see `ImuPreintegration`."""

    rate_rad_per_s: NDArray[np.float64]
    """(imus, 3)"""
    specific_force_m_per_s2: NDArray[np.float64]
    """(imus, 3)"""
    count: NDArray[np.int64]
    """(imus,) number of samples, of which the newest counts until the next is due; where it is 0, the rate is that of
    the newest sample, and the force is nan."""
    are_missing: NDArray[np.bool_]
    """(imus,) whether none has come in the frame, and one should have."""
    lasted_s: NDArray[np.float64]
    """(imus,) the time of which they are the means: all since the frame before, however long. It is nan in the first
    frame and of a sensor that was silent in this time."""
    rate_is_cut_off: NDArray[np.bool_]
    """(imus,) whether the rate was larger than the sensor's range."""
    force_is_cut_off: NDArray[np.bool_]
    """(imus,) whether the specific force was larger than the sensor's range."""

    @property
    def excess_m_per_s2(self) -> NDArray[np.float64]:
        """(imus,) by how much the size of the specific force differs from g."""
        return np.asarray(np.abs(np.linalg.norm(self.specific_force_m_per_s2, axis=1) - GRAVITY_M_PER_S2))


class ImuPreintegration:
    """Integrates rate and specific force of some sensors over one frame after another."""

    def __init__(self, imus: int) -> None:
        self._frame_s = np.nan
        self._newest_s = np.full(imus, np.nan)
        self._newest = np.zeros((imus, 2, 3))
        self._due_s = np.full(imus, np.inf)
        self._were_missing = np.zeros(imus, dtype=np.bool_)
        self._largest_rad_per_s = np.full(imus, LEAST_CUT_OFF_RAD_PER_S)
        self._at_largest = np.zeros(imus, dtype=np.int64)
        self._largest_m_per_s2 = np.full(imus, LEAST_CUT_OFF_M_PER_S2)

    def mean(self, t_s: float, readings: Sequence[ImuReading]) -> ImuSamples:
        """Return the means over one more frame; those of its own samples alone where a sensor was silent before.

        Args:
            t_s: time of the frame.
            readings: since the frame before, in order of time.
        """
        count = np.zeros(len(self._newest), dtype=np.int64)
        goes_on = ~self._were_missing
        rate_is_cut_off, force_is_cut_off = np.zeros((2, len(count)), dtype=np.bool_)
        total = np.zeros_like(self._newest)
        integral = -(self._frame_s - self._newest_s)[:, None, None] * self._newest
        for reading in readings:
            imu = reading.imu
            x = np.array([reading.rate_rad_per_s, reading.specific_force_m_per_s2])
            step_s = reading.t_s - self._newest_s[imu]
            goes_on[imu] &= abs(step_s) < READING_HOLDS_S
            integral[imu] += step_s * x
            total[imu] += x
            count[imu] += 1
            self._newest_s[imu], self._newest[imu], self._due_s[imu] = reading.t_s, x, reading.due_s
            rate_is_cut_off[imu] |= self._is_rate_cut_off(imu, float(np.abs(x[0]).max()))
            force_is_cut_off[imu] |= self._is_force_cut_off(imu, float(np.abs(x[1]).max()))
        since_s = t_s - self._newest_s
        lasts = (count == 0) & goes_on & (t_s <= self._due_s) & (since_s < READING_HOLDS_S)
        count[lasts] = 1
        integral += since_s[:, None, None] * self._newest
        own = total / np.maximum(count, 1)[:, None, None]
        goes_on &= np.isfinite(integral).all(axis=(1, 2))
        mean = np.where(goes_on[:, None, None], integral / (t_s - self._frame_s), own)
        is_read = count > 0
        rate = np.where(is_read[:, None], mean[:, 0], self._newest[:, 0])
        is_whole = is_read & goes_on & (since_s < READING_HOLDS_S)
        lasted_s = np.where(is_whole, t_s - self._frame_s, np.nan)
        self._frame_s, self._were_missing = t_s, ~is_read & (t_s > self._due_s)
        return ImuSamples(
            rate_rad_per_s=rate,
            specific_force_m_per_s2=np.where(is_read[:, None], mean[:, 1], np.nan),
            count=count,
            are_missing=self._were_missing,
            lasted_s=lasted_s,
            rate_is_cut_off=rate_is_cut_off,
            force_is_cut_off=force_is_cut_off,
        )

    def _is_rate_cut_off(self, imu: int, rad_per_s: float) -> bool:
        """Return whether the largest rate about an axis, in one more sample, is the end of a sensor's range."""
        if rad_per_s < self._largest_rad_per_s[imu]:
            self._at_largest[imu] = 0
        else:
            self._at_largest[imu] = 1 + self._at_largest[imu] * (rad_per_s == self._largest_rad_per_s[imu])
            self._largest_rad_per_s[imu] = rad_per_s
        return bool(self._at_largest[imu] >= CUT_OFF_SAMPLES)

    def _is_force_cut_off(self, imu: int, m_per_s2: float) -> bool:
        """Return whether the largest specific force along an axis, in one more sample, is the end of the range."""
        before = self._largest_m_per_s2[imu]
        self._largest_m_per_s2[imu] = largest = max(before, m_per_s2)
        is_usual = np.abs(m_per_s2 / FORCE_RANGES_M_PER_S2 - 1).min() < NEAR_RANGE
        return bool((is_usual and m_per_s2 > (1 - 2 * NEAR_RANGE) * largest) or m_per_s2 == before)
