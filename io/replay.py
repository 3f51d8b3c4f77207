"""A recorded trial in real time, or faster."""

import threading
import time
from collections.abc import Iterable, Iterator
from math import inf

from ..models.sensor.frames import LONGEST_SILENCE_S
from ..models.values.readings import OtherReading, Reading, arrival_s


class Replay:
    """Yields readings at the times at which they arrived, divided by the speed; used in place of boards.

    A silence of the tendons, longer than `LONGEST_SILENCE_S`, is passed over, also where other sensors go on.
    """

    def __init__(self, readings: Iterable[Reading], speed: float) -> None:
        self._readings = readings
        self._speed = speed
        self._due_s = self._next_due_s = time.perf_counter()
        self._stopped = threading.Event()
        self.tared_until_s = -inf  # every reading is yielded when it arrives

    def rows(self) -> Iterator[Reading]:
        """Yield the readings, until the last one or `stop`."""
        start_s = time.perf_counter()
        held: Reading | None = None
        shown_s, tendons_s = 0.0, -inf
        for reading in self._readings:  # yield one reading late, to know when the next is due
            if held is not None:
                if not isinstance(held, OtherReading) or tendons_s == -inf:
                    tendons_s = arrival_s(held)
                if arrival_s(reading) - tendons_s <= LONGEST_SILENCE_S:
                    shown_s += arrival_s(reading) - arrival_s(held)
                self._next_due_s = start_s + shown_s / self._speed
                yield held
            if self._stopped.wait(max(self._next_due_s - time.perf_counter(), 0.0)):
                return
            self._due_s = self._next_due_s
            held = reading
        self._next_due_s = float("inf")
        if held is not None:
            yield held

    def waiting(self) -> int:
        """Return 1 if the next reading is due already, else 0."""
        return int(self._next_due_s <= time.perf_counter())

    def late_s(self) -> float:
        """Return how long ago the reading that was yielded last was due."""
        return time.perf_counter() - self._due_s

    def stop(self) -> None:
        """Stop yielding."""
        self._stopped.set()
