"""Whether the structure stands still while its sensors are to be tared."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..values.readings import ResistanceReading
from .gauge import StaticGauge

BLOCK_S = 0.25
"""Readings are averaged over this long: noise of 0.0022 in dR/R becomes 0.1 mm of length, motion stays."""
STILL_M = 0.001
"""A tendon that changes by less is taken as still. At rest the most of any of 24 is 0.5 to 0.8 mm in 2 s (six
trials), all of it noise; while the structure is pressed 17 tendons change by more, the most by 3.5 mm and up."""
MOVING_TENDONS = 3
"""So many have to change: a node takes at least four tendons along, a bad sensor is alone."""


@dataclass(frozen=True, slots=True)
class RestMotion:
    """How much the tendons changed while the structure was to stand still."""

    largest_m: float
    """Of the tendon that changed most, from the lowest to the highest of its averages."""
    tendon: int
    """That tendon."""
    moving: int
    """How many tendons changed by more than noise does."""
    mean_m: float
    """Over all tendons."""

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
        self._R0 = natural_resistance_ohm
        self._m_per_change = natural_length_m / gauge.slope(np.zeros_like(natural_length_m))
        self._sum: defaultdict[int, NDArray[np.float64]] = defaultdict(lambda: np.zeros((2, len(natural_length_m))))

    def add(self, reading: ResistanceReading) -> None:
        """Take one reading in."""
        e = reading.tendon
        change_m = (reading.resistance_ohm / self._R0[e] - 1) * self._m_per_change[e]
        seen = np.isfinite(change_m)
        self._sum[int(reading.t_s // BLOCK_S)][:, e[seen]] += np.stack([change_m[seen], np.ones(seen.sum())])

    def motion(self) -> RestMotion:
        """Return how much the tendons changed; the first and the last block are cut short by the watch, and left out.

        A tendon that no reading told of counts as still.
        """
        blocks = np.array([self._sum[k] for k in sorted(self._sum)[1:-1]]).reshape(-1, 2, len(self._R0))
        with np.errstate(invalid="ignore"):
            mean_m = blocks[:, 0] / blocks[:, 1]
        range_m = np.max(mean_m, axis=0, initial=-np.inf, where=np.isfinite(mean_m)) - np.min(
            mean_m, axis=0, initial=np.inf, where=np.isfinite(mean_m)
        )
        range_m = np.where(np.isfinite(range_m), range_m, 0.0)
        tendon = int(np.argmax(range_m))
        return RestMotion(float(range_m[tendon]), tendon, int((range_m > STILL_M).sum()), float(range_m.mean()))
