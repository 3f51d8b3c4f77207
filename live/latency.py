"""The latency of each shape, and the stages in which the time went."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from ..models.values.readings import Reading, TendonLengths
from .feeds import Source


@dataclass(frozen=True, slots=True)
class Latency:
    """Time from the last byte that a frame needs to its shape.

    latency = busy + link + lengths + estimate
    """

    t_s: float
    """Time of the frame."""
    latency_s: float
    busy_s: float
    """While the session was busy with earlier readings, shapes and their output."""
    link_s: float
    """While the session waited for the row: for the process that reads the boards, and to be woken by the system."""
    lengths_s: float
    """From the row to the lengths of all tendons."""
    estimate_s: float
    """From lengths to shape and covariance."""
    processor_s: float
    """Time for which a processor worked on lengths and estimate; in what they lack to it, others had the processor."""
    other_threads_s: float
    """Time for which processors worked meanwhile on other threads of this process, such as the panel's."""
    output_before_s: float
    """How long tables, views and other programs took with the shape before, which may have made the session busy."""


@dataclass(frozen=True, slots=True)
class Clocks:
    """The clocks of the system, at one moment."""

    wall_s: float
    thread_s: float
    """Time for which a processor worked on this thread."""
    process_s: float
    """Time for which processors worked on all threads of this process."""

    @classmethod
    def now(cls) -> Self:
        """Read the clocks."""
        return cls(time.perf_counter(), time.thread_time(), time.process_time())


class Stopwatch:
    """Times the stages of a session; readings and frames pass through it unchanged."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._began = self._ended = Clocks.now()
        self._arrived_s = self._asked_s = self._taken_s = self._measured_s = self._began.wall_s
        self._output_s = 0.0

    def readings(self, readings: Iterator[Reading]) -> Iterator[Reading]:
        """Pass readings on, and note when each had arrived, was asked for, and came."""
        self._asked_s = time.perf_counter()
        for reading in readings:
            self._began = Clocks.now()
            self._taken_s = self._began.wall_s
            self._arrived_s = self._taken_s - self._source.late_s()
            yield reading
            self._asked_s = time.perf_counter()

    def frames(self, frames: Iterator[TendonLengths]) -> Iterator[TendonLengths]:
        """Pass frames on, and note when each was measured."""
        for frame in frames:
            self._measured_s = time.perf_counter()
            yield frame

    def latency_of_shape(self, t_s: float) -> Latency:
        """Return the latency of the shape at `t_s`, which has just been estimated."""
        began, now = self._began, Clocks.now()
        self._ended = now
        latency_s = now.wall_s - self._arrived_s
        link_s = self._taken_s - max(self._arrived_s, self._asked_s)
        lengths_s = self._measured_s - began.wall_s
        estimate_s = now.wall_s - self._measured_s
        processor_s = now.thread_s - began.thread_s
        return Latency(
            t_s=t_s,
            latency_s=latency_s,
            busy_s=latency_s - link_s - lengths_s - estimate_s,
            link_s=link_s,
            lengths_s=lengths_s,
            estimate_s=estimate_s,
            processor_s=processor_s,
            other_threads_s=max(now.process_s - began.process_s - processor_s, 0.0),
            output_before_s=self._output_s,
        )

    def output(self) -> None:
        """Note that the output of the shape has ended."""
        self._began = Clocks.now()  # of the next frame, if the same row completes it
        self._output_s = self._began.wall_s - self._ended.wall_s
