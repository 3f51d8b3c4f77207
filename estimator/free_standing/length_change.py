"""Whether the lengths change as they do when a structure tips onto another face of its hull.

While it tips, the floor and the hand let go of some nodes and load others: lengths change by `TIPPED_M`, and while it
stands still by their noise alone. With the mean square q of the changes of all tendons, the two are as probable as

    log ratio = -nu / 2 (log(1 + s) - q / noise^2  s / (1 + s)),    s = (TIPPED_M / noise)^2

where nu counts the tendons whose changes are independent. A hand that only presses changes lengths, too, so that a
change never says that the structure has tipped; but without a change it has not.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ...models.values.readings import TendonLengths
from ...models.values.stamps import RestClock

WINDOW_S = 0.2
"""Time over which lengths are averaged; two such means, with as much time between them, are compared."""
TIPPED_M = 0.001
"""Root mean square of the change of the lengths as a six-strut of 0.3 m tips: 0.6 to 1.8 mm at 21 tips, and 0.2 mm
while it stands still."""
INDEPENDENT_SHARE = 0.5
"""Share of the tendons whose changes count as independent."""


class LengthChange:
    """Follows how much the lengths have changed in the last moments."""

    def __init__(self, rest_seconds: float) -> None:
        self._rest_clock = RestClock(rest_seconds)
        self._newest: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._at_rest = np.zeros(2)

    def observe(self, lengths: TendonLengths) -> None:
        """Add the lengths of one more frame; those with an infinite sigma are left out."""
        self._rest_clock.count_frame(lengths.t_s)
        self._newest.append((lengths.t_s, np.where(np.isfinite(lengths.sigma_m), lengths.length_m, np.nan)))
        while self._newest[0][0] <= lengths.t_s - 3 * WINDOW_S:
            self._newest.popleft()

    def may_have_tipped(self) -> float:
        """Return how much more probable the last change is if the structure tips than if it stands still; at most 1.

        While the structure is known to rest the answer is 0, and noise is learned. Where no earlier lengths are known
        the answer is 1.
        """
        t_s = np.array([time_s for time_s, _ in self._newest])
        length_m = np.array([length_m for _, length_m in self._newest])
        age_s = t_s[-1] - t_s
        change_m = _mean(length_m[age_s < WINDOW_S]) - _mean(length_m[age_s >= 2 * WINDOW_S])
        known = np.isfinite(change_m)
        squared = float(np.mean(change_m[known] ** 2)) if known.any() else np.nan
        if self._rest_clock.is_at_rest(t_s[-1]):
            if known.any():
                self._at_rest += [squared, 1]
            return 0.0
        if not known.any() or not self._at_rest[0]:
            return 1.0
        noise_m2 = self._at_rest[0] / self._at_rest[1]
        s = TIPPED_M**2 / noise_m2
        log_ratio = -0.5 * INDEPENDENT_SHARE * known.sum() * (np.log1p(s) - squared / noise_m2 * s / (1 + s))
        return float(np.exp(min(log_ratio, 0.0)))


def _mean(length_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (tendons,) the means of (frames, tendons) lengths; nan for a tendon without a length."""
    count = np.isfinite(length_m).sum(axis=0)
    return np.asarray(np.nansum(length_m, axis=0) / np.where(count, count, np.nan))
