"""The plausibility of samples of inertial sensors: absurd ones and those of a sensor that is stuck are left out.

The others are given the times at which they were measured, see `ImuCadence`.

Absurd is also a rate that is far from the one before, and of a sensor that does not turn a specific force that is,
unless the next sample confirms it.

A single axis is stuck, too: that of a gyroscope which turned about it made a robot with ranges slide by 6 m.

Of a sensor whose samples are mostly absurd, as those in another unit, the others are left out, too.
"""

import math
from dataclasses import replace

import numpy as np

from ..structure.floor import GRAVITY_M_PER_S2
from ..values.aids import READING_HOLDS_S, ImuReading
from ..values.stamps import RestClock
from .imu_agreement import has_size_of_gravity
from .imu_cadence import ImuCadence

MOST_RATE_RAD_PER_S = 70.0
"""Rate beyond the range of every small sensor: 4000 degrees per second."""
MOST_FORCE_M_PER_S2 = 400.0
"""Specific force beyond the range of every small sensor: 40 g."""
MOST_RATE_AT_REST_RAD_PER_S = 0.4
"""Mean rate at rest that is told: as large as the largest bias of small sensors, 20 degrees a second."""
MOST_JUMP_RAD_PER_S = 12.0
"""Change of the rate from one sample to the next above which the second has to be confirmed. Impacts at which caps hit
the floor change it by up to 6.1 in the development trials, at 100 samples a second."""
MOST_JUMP_M_PER_S2 = 1.0
"""Change of the specific force above which the same holds for a sensor that does not turn, or `CHANGES` times its mean
change: what turns it, or an impact at the end of a tip, turns the sensor, too. Eight samples in half a second of which
one axis reads 0 turned a robot at rest so far that it was 0.4 m off."""
CHANGES = 5.0
"""Ratio of a jump to the mean change: samples of a sensor that is noisy, or that a motor shakes, are no jumps."""
ONWARD = 1.5
"""Ratio of a change of the force to the jump before, in the same direction, up to which it confirms the jump: a hand
that lifts a robot without turning it changes the force in every sample."""
CHANGE_WEIGHT = 0.05
"""Weight of one more sample in the mean change."""
TURNS_RAD_PER_S = 0.05
"""Rate from which a sensor turns."""
STUCK_SAMPLES = 5
"""Number of successive samples, all six values the same, from which a sensor is stuck: a live one is never so quiet."""
STUCK_AXIS_SAMPLES = 20
"""Least number of successive samples with one value the same, from which that axis is stuck."""
STUCK_PROBABILITY = 1e-6
"""Probability of so many equal values in succession, below which it is. A value is repeated as often as the axis has
repeated itself before, or one of the others, which have the same noise and resolution."""


class ImuGate:
    """Decides which samples to use, and counts the others and the frames without any."""

    def __init__(self, imus: int, rest_clock: RestClock) -> None:
        """Begin; `rest_clock` is told the frames that are counted here."""
        self._rest_clock = rest_clock
        self._samples = np.zeros(imus, dtype=np.int64)
        self._cadence = [ImuCadence() for _ in range(imus)]
        self._measured_s = [math.nan] * imus
        self._rested = np.zeros(imus, dtype=np.int64)
        self._force_at_rest = np.zeros((imus, 3))
        self._rate_at_rest = np.zeros((imus, 3))
        self._last: list[list[float]] = [[]] * imus
        self._same = [[1] * 6 for _ in range(imus)]  # how often each value was read in succession
        self._repeats = [[0] * 6 for _ in range(imus)]  # and how often it was the one before, in all
        self._passed: list[list[float] | None] = [None] * imus  # rate and specific force of the last sample that passed
        self._jumped: list[list[float] | None] = [None] * imus  # the same of one that jumped since
        self._change_m_per_s2 = [0.0] * imus  # mean of the largest change of the force from sample to sample
        self.absurd = np.zeros(imus, dtype=np.int64)
        """(imus,) number of samples that no sensor can have measured, or that jumped and were not confirmed."""
        self.stuck = np.zeros(imus, dtype=np.int64)
        """(imus,) number of samples that only repeat those before, or in which one axis does."""
        self.silent_frames = np.zeros(imus, dtype=np.int64)
        """(imus,) number of frames in which the sensor was silent."""
        self._newest_s = np.full(imus, np.nan)

    def count_frame(self, t_s: float) -> None:
        """Count in one more frame which sensors are silent; from the first one on the rest lasts."""
        self._rest_clock.count_frame(t_s)
        self._newest_s = np.where(np.isnan(self._newest_s), t_s, self._newest_s)
        self.silent_frames += t_s - self._newest_s > READING_HOLDS_S

    def passes(self, reading: ImuReading) -> bool:
        """Return whether a sample is to be used."""
        rate, force = reading.rate_rad_per_s.tolist(), reading.specific_force_m_per_s2.tolist()
        values = rate + force
        same, repeats = self._same[reading.imu], self._repeats[reading.imu]
        for axis, (value, before) in enumerate(zip(values, self._last[reading.imu], strict=False)):
            if value == before:
                same[axis] += 1
                repeats[axis] += 1
            else:
                same[axis] = 1
        if values != self._last[reading.imu]:
            self._measured_s[reading.imu] = self._cadence[reading.imu].observe(reading.t_s)
        self._last[reading.imu] = values
        self._newest_s[reading.imu] = reading.t_s
        self._samples[reading.imu] += 1
        if self._rest_clock.is_at_rest(reading.t_s):
            self._rested[reading.imu] += 1
            self._force_at_rest[reading.imu] += reading.specific_force_m_per_s2
            self._rate_at_rest[reading.imu] += reading.rate_rad_per_s
        in_range = all(abs(one) < MOST_RATE_RAD_PER_S for one in rate) and all(
            abs(one) < MOST_FORCE_M_PER_S2 for one in force
        )
        if not in_range or self._jumps(reading.imu, values):
            self.absurd[reading.imu] += 1
            return False
        if min(same) >= STUCK_SAMPLES or (max(same) >= STUCK_AXIS_SAMPLES and self._is_an_axis_stuck(reading.imu)):
            self.stuck[reading.imu] += 1
            return False
        return bool(2 * self.absurd[reading.imu] <= self._samples[reading.imu])

    def measured(self, reading: ImuReading) -> ImuReading:
        """Return the sample of a sensor that has just passed with the time at which it was measured as its stamp."""
        return replace(reading, t_s=self._measured_s[reading.imu], due_s=self._cadence[reading.imu].due_s)

    def _jumps(self, imu: int, values: list[float]) -> bool:
        """Return whether a sample is far from the last one that passed, and from one that jumped since."""
        passed, jumped = self._passed[imu], self._jumped[imu]
        if passed is None:
            self._passed[imu] = values
            return False
        most_force = max(MOST_JUMP_M_PER_S2, CHANGES * self._change_m_per_s2[imu])
        change = min(_furthest(values[3:], (jumped or passed)[3:]), most_force)
        self._change_m_per_s2[imu] += CHANGE_WEIGHT * (change - self._change_m_per_s2[imu])
        is_still = max(map(abs, values[:3] + passed[:3])) < TURNS_RAD_PER_S

        def is_near(before: list[float]) -> bool:
            if _furthest(values[:3], before[:3]) > MOST_JUMP_RAD_PER_S:
                return False
            return not is_still or _furthest(values[3:], before[3:]) <= most_force

        jumps = not is_near(passed)
        if jumps and jumped is not None:
            jumps = not (is_near(jumped) or (is_still and _goes_on(passed[3:], jumped[3:], values[3:])))
        if jumps:
            self._jumped[imu] = values
        else:
            self._passed[imu], self._jumped[imu] = values, None
        return jumps

    def _is_an_axis_stuck(self, imu: int) -> bool:
        """Return whether one axis repeats itself for longer than the others make likely."""
        same, repeats, n = self._same[imu], self._repeats[imu], int(self._samples[imu])
        for axis in (axis for axis, count in enumerate(same) if count >= STUCK_AXIS_SAMPLES):
            run = same[axis]
            if run == n and self._last[imu][axis] == 0:  # simulated without noise, and in a plane
                continue
            kind = 3 * (axis // 3)
            others = [other for other in range(kind, kind + 3) if other != axis]
            by_others = (max(repeats[other] for other in others) + 1) / (n + 1)
            before = (repeats[axis] - run + 2) / (n - run + 2)
            if max(by_others, before) ** run < STUCK_PROBABILITY:
                return True
        return False

    def warnings(self) -> dict[str, str]:
        """Return all that looks wrong of each sensor, by its name."""
        texts = {f"imu {imu}": self._warnings_of(imu) for imu in range(len(self._samples))}
        return {name: "; ".join(of_one) for name, of_one in texts.items() if of_one}

    def _warnings_of(self, imu: int) -> list[str]:
        texts: list[str] = []
        size = np.linalg.norm(self._force_at_rest[[imu]], axis=1) / max(int(self._rested[imu]), 1)
        if self._rested[imu] > 0 and not has_size_of_gravity(size).all():
            texts.append(f"specific force at rest: expected {GRAVITY_M_PER_S2:.2f} m/s^2, got {size[0]:.4g}: unit?")
        rate = float(np.linalg.norm(self._rate_at_rest[imu])) / max(int(self._rested[imu]), 1)
        if rate > MOST_RATE_AT_REST_RAD_PER_S:
            texts.append(f"rate at rest: expected about 0 rad/s, got {rate:.3g}: unit, or is it moved?")
        if 2 * self.absurd[imu] > self._samples[imu]:
            texts.append("most samples are absurd, and none is used: unit?")
        return texts + self._cadence[imu].warnings()

    def counts(self) -> dict[str, int]:
        """Return the number of samples that were left out, by sensor and cause."""
        counts = {f"imu {i}: absurd samples": int(n) for i, n in enumerate(self.absurd)}
        counts |= {f"imu {i}: stuck samples": int(n) for i, n in enumerate(self.stuck)}
        return counts | {f"imu {i}: silent frames": int(n) for i, n in enumerate(self.silent_frames)}


def _goes_on(passed: list[float], jumped: list[float], force: list[float]) -> bool:
    """Return whether a specific force goes on in the direction of the jump before it, by about as much."""
    onward = sum((f - j) * (j - p) for p, j, f in zip(passed, jumped, force, strict=True))
    return onward > 0 and _furthest(force, jumped) <= ONWARD * _furthest(jumped, passed)


def _furthest(values: list[float], others: list[float]) -> float:
    """Return the largest difference of two numbers at the same place."""
    return max(abs(value - other) for value, other in zip(values, others, strict=True))
