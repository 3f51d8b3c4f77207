"""The stamps of rows and frames, whose clock may count from anywhere: which is later, and when the rest is over.

A robot rests for `rest.seconds` from the first frame on, as sensors are tared; t_s of that frame need not be 0.
"""

import math

from .errors import InputError
from .units import LARGEST

ROUNDING_S = 1e-6
"""More than stamps, their sums and their differences are rounded by: a frame at the very end of the rest is after it,
on every clock."""
STAMP_DECIMALS = 4
"""Decimals of a time in seconds in the tables of a result."""
SHORTEST_STEP_S = 1e-4
"""Shortest time between two rows, that of the last decimal: what moves in a shorter one is not known."""


def is_later(t_s: float, latest_s: float) -> bool:
    """Return whether a row is `SHORTEST_STEP_S` later than the one before, as it is and as results write it."""
    is_written_later = round(t_s, STAMP_DECIMALS) > round(latest_s, STAMP_DECIMALS)
    return is_written_later and t_s - latest_s > SHORTEST_STEP_S - ROUNDING_S


def is_due(since_s: float, every_s: float) -> bool:
    """Return whether what is done at most once in `every_s` is due, so long since the last time, but for rounding."""
    return since_s >= 0.999 * every_s


def check_stamp(name: str, t_s: float) -> None:
    """Check that a stamp is a time, after which others may come.

    Raises:
        InputError: for a stamp beyond the range of `units.LARGEST`, or what is no number.
    """
    if not abs(t_s) <= LARGEST["s"]:
        raise InputError(f"{name}: expected a stamp of at most {LARGEST['s']:g} s, got {t_s:g}")


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
