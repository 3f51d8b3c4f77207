"""A live session skips frames when it is late."""

import numpy as np

from tensegraph import TendonLengths
from tensegraph.live.activity import Activity, NewestFrames


class Backlog:
    """A source of which a list says how late each frame is, and how many readings wait behind it."""

    def __init__(self, late_and_waiting: list[tuple[float, int]]) -> None:
        self._script = iter(late_and_waiting)

    def waiting(self) -> int:
        self._late_s, waiting = next(self._script)
        return waiting

    def late_s(self) -> float:
        return self._late_s


def test_late_frames_are_skipped_until_the_newest() -> None:
    """By hand: the first frames wait for the taring and are kept; then 0.15 s late is too late, until none wait."""
    script = [(2.0, 100), (1.0, 50), (0.01, 0), (0.05, 3), (0.15, 8), (0.09, 4), (0.03, 1), (0.01, 0), (0.05, 2)]
    empty = np.empty(0)
    frames = [TendonLengths(float(k), empty, empty, empty, empty) for k in range(len(script))]
    activity = Activity.of(boards=2, imus=0)
    kept = [frame.t_s for frame in NewestFrames(Backlog(script), activity).select(iter(frames))]
    assert kept == [0, 1, 2, 3, 7, 8]
    assert activity.skipped_frames == 3
