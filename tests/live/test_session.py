"""A live session skips frames when it is late."""

import numpy as np

from tensegraph import TendonLengths
from tensegraph.live.activity import Activity, NewestFrames
from tensegraph.models.values.aids import ImuReading


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


def test_rates_of_turn_in_skipped_frames_are_not_lost() -> None:
    """By hand: frames 1 and 2 are skipped; frame 3 has their samples beside its own."""
    script = [(0.01, 0), (0.15, 8), (0.15, 7), (0.01, 0), (0.01, 0)]
    empty = np.empty(0)
    samples = [ImuReading(0, float(k), np.zeros(3), np.zeros(3)) for k in range(len(script))]
    frames = [TendonLengths(s.t_s, empty, empty, empty, empty, aids=(s,)) for s in samples]
    kept = NewestFrames(Backlog(script), Activity.of(boards=2, imus=1)).select(iter(frames))
    assert [[s.t_s for s in frame.aids] for frame in kept] == [[0.0], [1.0, 2.0, 3.0], [4.0]]
