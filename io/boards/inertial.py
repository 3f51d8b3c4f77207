"""Inertial sensors that boards read: their samples become readings on the host's clock."""

import numpy as np

from ...models.sensor.clock import SEQ_WRAP, BoardClock
from ...models.values.aids import DECIMALS, ImuReading
from ...models.values.link import ImuCounts
from .protocol import Sample

COUNTER_HOLDS_S = 10.0
"""Time after which the counter may have wrapped; samples that come late come sooner."""


class BoardImu:
    """Converts the samples of one inertial sensor, and counts those that are missing.

    Args:
        imu: number of the sensor in the rig.
        clock: of the board that reads it. Its rows tell when a sample was measured.
    """

    def __init__(self, imu: int, clock: BoardClock) -> None:
        self._imu = imu
        self._clock = clock
        self._last: Sample | None = None
        self._time_s = -np.inf
        self.counts = ImuCounts()

    def reading(self, sample: Sample) -> ImuReading | None:
        """Return the reading of a sample; None if it came twice or late, or its time is not known."""
        time_s = self._clock.time_of_stamp_s(sample.device_us, sample.boot)
        if time_s is None or not self._follows(sample, time_s):
            self.counts += ImuCounts(dropped_samples=1)
            return None
        self.counts += ImuCounts(samples=1, lost_samples=(self._steps(sample) - 1) % SEQ_WRAP)
        self._last = sample
        # strictly increasing in the decimals of a trial's files
        self._time_s = max(round(time_s, DECIMALS), round(self._time_s + 10**-DECIMALS, DECIMALS))
        return ImuReading(
            imu=self._imu,
            t_s=self._time_s,
            rate_rad_per_s=np.round(sample.rate_unit_rad_per_s * np.array(sample.rate), DECIMALS),
            specific_force_m_per_s2=np.round(sample.force_unit_m_per_s2 * np.array(sample.force), DECIMALS),
        )

    def _follows(self, sample: Sample, time_s: float) -> bool:
        """Whether a sample is later than the last, by its counter or, after a long silence, by its time."""
        return 0 < self._steps(sample) < SEQ_WRAP // 2 or time_s > self._time_s + COUNTER_HOLDS_S

    def _steps(self, sample: Sample) -> int:
        """Return by how much the sensor's counter has grown; 1 for the first sample since the board started."""
        if self._last is None or sample.boot != self._last.boot:
            return 1
        return (sample.seq - self._last.seq) % SEQ_WRAP
