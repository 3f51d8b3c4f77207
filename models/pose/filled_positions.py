"""Positions that the software of a motion capture has filled in while it did not see a marker.

It repeats the last position, draws a straight line to the next one, or a cubic. All of these have third differences of
zero in time, which measured positions, with their noise, hardly ever have: if r of n positions before have them, the
next one has them with the probability (r + 1) / (n + 1), by Laplace's rule, and several in succession with the product.
Slow and fast positions are counted apart, because those of a robot that rests may be without noise, as simulated or
rounded ones, and those of one that moves are not smooth.
"""

from collections import Counter, defaultdict, deque

import numpy as np
from numpy.typing import NDArray

from ..values.aids import PositionReading

SMOOTH_M = 1e-4
"""Third difference below which it is zero, per axis: positions are written to a hundredth of a millimetre."""
SLOW_M = 0.002
"""Way over four positions below which a node is slow."""
KNOWN = 20
"""Number of slow positions, or of fast ones, from which they are counted apart."""
LEAST_RUN = 4
"""Least number of positions in succession, with third differences of zero, that are filled in."""
FILLED_PROBABILITY = 1e-6
"""Probability of so many in succession below which they are."""
LONGEST_S = 1.0
"""Time over which four positions of a node have a third difference: a pause may be longer."""


class _Track:
    """The positions of one node in one recording."""

    def __init__(self) -> None:
        self._last: deque[tuple[float, NDArray[np.float64]]] = deque(maxlen=4)
        self._counted = {slow: np.zeros(2, dtype=np.int64) for slow in (False, True)}  # all, and smooth ones
        self._run: Counter[bool] = Counter()  # slow and fast ones of the smooth positions in succession
        self._log_probability = 0.0
        self._is_filled = False

    def is_filled(self, t_s: float, position_m: NDArray[np.float64]) -> bool:
        """Take on one more position; return whether it is filled in."""
        if self._last and not self._last[-1][0] < t_s < self._last[0][0] + LONGEST_S:
            self._last.clear()
            self._end_run()
        self._last.append((t_s, position_m))
        if len(self._last) < 4:
            return False
        times_s, positions_m = (np.array(values) for values in zip(*self._last, strict=True))
        slow = bool(np.abs(positions_m - positions_m[0]).max() < SLOW_M)
        if np.abs(_third_difference(times_s, positions_m)).max() >= SMOOTH_M:
            self._end_run()
            self._counted[slow] += [1, 0]
            return False
        counted = self._counted[slow]
        count, smooth = counted if counted[0] >= KNOWN else self._counted[False] + self._counted[True]
        self._log_probability += float(np.log((smooth + 1) / (count + 1)))
        self._run[slow] += 1
        is_improbable = self._log_probability < np.log(FILLED_PROBABILITY)
        self._is_filled |= self._run.total() >= LEAST_RUN and bool(is_improbable)
        return self._is_filled

    def _end_run(self) -> None:
        """Count the smooth positions in succession, unless they were filled in."""
        if not self._is_filled:
            for slow, count in self._run.items():
                self._counted[slow] += count
        self._run.clear()
        self._log_probability = 0.0
        self._is_filled = False


class FilledPositions:
    """Finds out which positions were filled in, and counts them."""

    def __init__(self) -> None:
        self._tracks: dict[tuple[int, int], _Track] = defaultdict(_Track)
        self._counts: Counter[int] = Counter()

    def passes(self, reading: PositionReading) -> bool:
        """Return whether a position was measured, as far as the ones before it tell."""
        track = self._tracks[reading.recording, reading.node]
        if track.is_filled(reading.t_s, reading.position_m):
            self._counts[reading.node] += 1
            return False
        return True

    def counts(self) -> dict[str, int]:
        """Return the number of positions that were filled in, by their node."""
        return {f"position of node {node}: filled in": n for node, n in sorted(self._counts.items())}


def _third_difference(t_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3,) the third difference of (4, 3) positions at four rising times, as of equal steps of their mean."""
    difference = position_m
    for order in (1, 2, 3):
        difference = np.diff(difference, axis=0) / (t_s[order:] - t_s[:-order])[:, None]
    mean_s = (t_s[-1] - t_s[0]) / 3
    return np.asarray(6 * mean_s**3 * difference[0])
