"""The stages of the latency, by clocks of our own."""

import pytest

from tensegraph import TendonLengths
from tensegraph.live.latency import Stopwatch


class Clock:
    """A clock that goes on only by what the test says, for all three clocks of the system."""

    def __init__(self, monkeypatch) -> None:
        self.wall_s = self.thread_s = self.process_s = 0.0
        monkeypatch.setattr("tensegraph.live.latency.time.perf_counter", lambda: self.wall_s)
        monkeypatch.setattr("tensegraph.live.latency.time.thread_time", lambda: self.thread_s)
        monkeypatch.setattr("tensegraph.live.latency.time.process_time", lambda: self.process_s)

    def work(self, wall_ms: float, thread_ms: float, others_ms: float = 0.0) -> None:
        """Let time pass, in which this thread and the others of the process have the processor for some of it."""
        self.wall_s += 1e-3 * wall_ms
        self.thread_s += 1e-3 * thread_ms
        self.process_s += 1e-3 * (thread_ms + others_ms)


class Source:
    """A source whose rows arrive at given times."""

    def __init__(self, clock: Clock, arrivals_ms: list[float]) -> None:
        self._clock, self._arrivals_ms, self._arrived_s = clock, arrivals_ms, 0.0

    def rows(self):
        for arrived_ms in self._arrivals_ms:
            self._arrived_s = 1e-3 * arrived_ms
            link_ms = max(1e3 * (self._arrived_s - self._clock.wall_s), 0.0) + 1.0  # it comes a millisecond later
            self._clock.work(link_ms, 0.0)
            yield None

    def late_s(self) -> float:
        return self._clock.wall_s - self._arrived_s


def latencies(monkeypatch, arrivals_ms: list[float], frames_of_row: int = 1) -> list:
    """Each frame: 2 ms to its lengths, 5 ms to its shape, of which others take 3, the panel one; 10 ms of output."""
    clock = Clock(monkeypatch)
    source = Source(clock, arrivals_ms)
    stopwatch = Stopwatch(source)

    def frames():
        for _ in stopwatch.readings(source.rows()):
            for _ in range(frames_of_row):
                clock.work(2.0, 2.0)
                yield TendonLengths(0.0, *[None] * 4)

    found = []
    for _ in stopwatch.frames(frames()):
        clock.work(5.0, 1.0, others_ms=1.0)
        found.append(stopwatch.latency_of_shape(0.0))
        clock.work(10.0, 10.0)
        stopwatch.output()
    return found


def parts_ms(latency) -> list[float]:
    stages = (latency.latency_s, latency.busy_s, latency.link_s, latency.lengths_s, latency.estimate_s)
    return [round(1e3 * part, 6) for part in (*stages, latency.processor_s, latency.other_threads_s)]


def test_a_session_that_waits_for_its_rows(monkeypatch) -> None:
    """By hand: a row each 20 ms, taken a millisecond after its arrival."""
    first, second = latencies(monkeypatch, [0.0, 20.0])
    assert parts_ms(first) == parts_ms(second) == [8.0, 0.0, 1.0, 2.0, 5.0, 3.0, 1.0]
    assert (first.output_before_s, second.output_before_s) == pytest.approx((0.0, 0.010))


def test_a_row_that_waits_for_the_output_before(monkeypatch) -> None:
    """By hand: the second row arrives at 10 ms; until 18 ms the session is busy with the first shape and its output."""
    _, second = latencies(monkeypatch, [0.0, 10.0])
    assert parts_ms(second) == [16.0, 8.0, 1.0, 2.0, 5.0, 3.0, 1.0]


def test_two_frames_of_one_row(monkeypatch) -> None:
    """By hand: the second frame waits for the shape of the first, of 7 ms, and its output, of 10 ms."""
    _, second = latencies(monkeypatch, [0.0], frames_of_row=2)
    assert parts_ms(second) == [25.0, 17.0, 1.0, 2.0, 5.0, 3.0, 1.0]
