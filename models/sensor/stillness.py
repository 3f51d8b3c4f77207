"""Whether the structure stands still while its sensors are to be tared."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.errors import TensegraphError
from ..values.readings import ResistanceReading
from .gauge import StaticGauge

BLOCK_S = 0.25
"""Time over which readings are averaged: noise of 0.0022 in dR/R is reduced to 0.1 mm of length, while motion is not
reduced."""
SHORTEST_S = 4 * BLOCK_S
"""Shortest time from which motion can be judged: two whole blocks and the incomplete ones before and after."""
STILL_STRAIN = 0.0059
"""Change of strain below which a tendon counts as still, 1 mm of 0.17 m. At rest the largest change of 24 such tendons
in 2 s is 0.5 to 0.8 mm (six trials), all of it noise. While the structure is pressed 17 tendons change by more than the
threshold, and the largest change is at least 3.5 mm."""
USUAL_READINGS = 12.5
"""Number of readings in a block at 50 Hz, of which those six trials are; with fewer the noise of the mean is larger."""
MOVING_TENDONS = 3
"""Number of tendons that must change for the structure to count as moving. A node that moves changes at least four
tendons, a faulty sensor only one."""


@dataclass(frozen=True, slots=True)
class RestMotion:
    """How much the lengths of the tendons changed while the structure was supposed to stand still."""

    largest_m: float
    """Largest change of a tendon, from the least to the greatest of its block averages."""
    tendon: int
    """The tendon with the largest change."""
    moving: int
    """Number of tendons whose change is larger than noise, see `STILL_STRAIN`."""
    mean_m: float
    """Mean of the changes of all tendons."""

    @property
    def still(self) -> bool:
        """Whether the structure stood still."""
        return self.moving < MOVING_TENDONS

    def __str__(self) -> str:
        return (
            f"tendons changed by {1e3 * self.mean_m:.1f} mm on average, at most by {1e3 * self.largest_m:.1f} mm "
            f"(tendon {self.tendon})"
        )


class StillnessWatch:
    """Averages each tendon's readings over blocks of time, and compares the averages."""

    def __init__(
        self, gauge: StaticGauge, natural_resistance_ohm: NDArray[np.float64], natural_length_m: NDArray[np.float64]
    ) -> None:
        self._R0, self._L0 = natural_resistance_ohm, natural_length_m
        self._m_per_change = natural_length_m / gauge.slope(np.zeros_like(natural_length_m))
        self._sum: defaultdict[int, NDArray[np.float64]] = defaultdict(lambda: np.zeros((2, len(natural_length_m))))

    def add(self, reading: ResistanceReading) -> None:
        """Add one reading."""
        on_tendon = reading.tendon < len(self._R0)  # a reference strip never moves
        e = reading.tendon[on_tendon]
        change_m = (reading.resistance_ohm[on_tendon] / self._R0[e] - 1) * self._m_per_change[e]
        seen = np.isfinite(change_m)
        self._sum[int(reading.t_s // BLOCK_S)][:, e[seen]] += np.stack([change_m[seen], np.ones(seen.sum())])

    def motion(self) -> RestMotion:
        """Return how much the tendons changed.

        The first and the last block are left out because they are incomplete. A tendon without a reading counts as
        still.

        Raises:
            TensegraphError: when fewer than two blocks are left to compare.
        """
        whole = sorted(self._sum)[1:-1]
        if len(whole) < 2:
            raise TensegraphError(
                f"too few readings to judge whether the structure stands still: expected at least {SHORTEST_S:g} s. If "
                "there were more, device_us of a board does not count microseconds"
            )
        blocks = np.array([self._sum[k] for k in whole])
        with np.errstate(invalid="ignore"):
            mean_m = blocks[:, 0] / blocks[:, 1]
        range_m = np.max(mean_m, axis=0, initial=-np.inf, where=np.isfinite(mean_m)) - np.min(
            mean_m, axis=0, initial=np.inf, where=np.isfinite(mean_m)
        )
        range_m = np.where(np.isfinite(range_m), range_m, 0.0)
        tendon = int(np.argmax(range_m))
        noise = np.sqrt(np.maximum(USUAL_READINGS / np.maximum(blocks[:, 1].mean(axis=0), 1.0), 1.0))
        moving = int((range_m > STILL_STRAIN * self._L0 * noise).sum())
        return RestMotion(float(range_m[tendon]), tendon, moving, float(range_m.mean()))
