"""Sensors that drift slowly while they are used: all alike as they warm up, and each by itself."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..values.tables import NotNegative, Positive


@dataclass(frozen=True, slots=True)
class DriftPlan:
    """`[drift]` of a plan: what comes on top of the drift that calibration saw (`sensors.drift_sigma`).

    The drift d of a sensor is zero until `from_s`, and stays from `until_s` on where it got to.
    """

    from_s: NotNegative
    until_s: Positive
    """May be later than the end of the trial, which then sees a part of it."""
    of: Literal["resistance", "change"]
    """`resistance`: R (1 + d), as of a temperature or a reference voltage; `change`: R0 (1 + dR/R + d)."""
    common_share: float
    """d that all sensors have at `until_s`."""
    common_course: Literal["ramp", "warm_up"]
    """`ramp`: in proportion to time; `warm_up`: as 1 - exp(-t / tau)."""
    own_sigma: NotNegative
    """Standard deviation over sensors of what each has at `until_s` on top of that."""
    own_course: Literal["ramp", "walk"]
    """`ramp`: in proportion to time; `walk`: a random walk, independent steps of equal variance."""
    time_constant_s: Positive | None = None
    """tau of the warming up."""

    def drift(self, t_s: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return (steps, count) d at (steps,) times, evenly spaced."""
        share = np.clip((t_s - self.from_s) / (self.until_s - self.from_s), 0.0, 1.0)
        common = share
        if self.common_course == "warm_up" and self.time_constant_s is not None:
            constants = (self.until_s - self.from_s) / self.time_constant_s
            common = np.expm1(-constants * share) / np.expm1(-constants)
        if self.own_course == "ramp":
            own = np.outer(share, rng.normal(size=count))
        else:
            passed = np.diff(share, prepend=0.0)
            own = np.cumsum(np.sqrt(passed)[:, None] * rng.normal(size=(len(t_s), count)), axis=0)
        drift: NDArray[np.float64] = self.common_share * common[:, None] + self.own_sigma * own
        return drift
