"""When the rest at the start of a trial ends: the clock of its stamps may count from anywhere.

A robot rests for `rest.seconds` from the first frame on, as sensors are tared; t_s of that frame need not be 0.
"""

import math

ROUNDING_S = 1e-6
"""More than stamps and their sums are rounded by: a frame at the very end of the rest is after it, on every clock."""


def rest_until_s(first_frame_s: float, rest_seconds: float) -> float:
    """Return the time at which the rest ends, on the clock of the stamps.

    Args:
        first_frame_s: t_s of the first frame.
        rest_seconds: how long the robot rests from then on.
    """
    return first_frame_s + rest_seconds - ROUNDING_S


class RestClock:
    """Tells of readings, which arrive before the first frame is complete, whether they are of the rest."""

    def __init__(self, rest_seconds: float) -> None:
        """Begin before the first frame: the robot rests, unless `rest_seconds` is 0."""
        self._rest_seconds = rest_seconds
        self._until_s = math.inf if rest_seconds > 0 else -math.inf

    def count_frame(self, t_s: float) -> None:
        """Let the rest count from t_s of a frame, if it is the first one."""
        if self._until_s == math.inf:
            self._until_s = rest_until_s(t_s, self._rest_seconds)

    def is_at_rest(self, t_s: float) -> bool:
        """Return whether a reading with this stamp is of the rest."""
        return t_s < self._until_s
