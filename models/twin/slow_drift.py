"""Slow drift of sensors while they are used: a part that is common to all, and a part of each sensor."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..values.tables import NotNegative, Positive


@dataclass(frozen=True, slots=True)
class DriftPlan:
    """`[drift]` of a plan: a slow drift d of each sensor, added to the small drift that calibration saw.

    The small one is `sensors.drift_sigma`. The slow drift d is zero before `from_s` and constant after `until_s`.
    """

    from_s: NotNegative
    """When it begins."""
    until_s: Positive
    """When it ends; it may end after the trial, which then sees a part of it."""
    of: Literal["resistance", "change"]
    """`resistance`: R (1 + d), as a temperature or a reference voltage has it; `change`: R0 (1 + dR/R + d)."""
    common_share: float
    """The part of d that is common to all sensors, at `until_s`."""
    common_course: Literal["ramp", "warm_up"]
    """How the common part grows from `from_s` to `until_s`. `ramp`: in proportion to time; `warm_up`: in proportion to
    1 - exp(-t / tau)."""
    own_sigma: NotNegative
    """Standard deviation over sensors of the part of d that is the sensor's own, at `until_s`."""
    own_course: Literal["ramp", "walk"]
    """How the own part grows. `ramp`: in proportion to time; `walk`: a random walk, whose steps are independent and of
    equal variance."""
    time_constant_s: Positive | None = None
    """tau of `warm_up`, which needs it; `ramp` has none."""

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
