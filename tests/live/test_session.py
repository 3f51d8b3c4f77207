"""A live session skips frames when it is late."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Reconstruction, Settings, TendonLengths
from tensegraph.live.activity import Activity, NewestFrames
from tensegraph.live.session import LiveResult
from tensegraph.models.values.aids import ImuReading
from tensegraph.models.values.slip import Slip


class Backlog:
    """A source of which a list says how late each frame is, and how many readings wait behind it."""

    def __init__(self, late_and_waiting: list[tuple[float, int]], tared_until_s: float = -np.inf) -> None:
        self._script = iter(late_and_waiting)
        self.tared_until_s = tared_until_s

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
    kept = [frame.t_s for frame in NewestFrames(Backlog(script, tared_until_s=3.0), activity).select(iter(frames))]
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


def test_who_never_catches_up_skips_from_the_first_frame_after_the_taring() -> None:
    """By hand: half a second late all the time, and always more waits; those of the taring, and the last, are kept."""
    frames = [TendonLengths(0.5 * k, *[np.empty(0)] * 4) for k in range(10)]
    activity = Activity.of(boards=1, imus=0)
    kept = [f.t_s for f in NewestFrames(Backlog([(0.5, 9)] * 10, 2.0), activity).select(iter(frames))]
    assert kept == [0.0, 0.5, 1.0, 1.5, 2.0, 4.5]
    assert activity.skipped_frames == 4


def test_a_late_shape_is_better_than_none(monkeypatch) -> None:
    """A frame a quarter of a second, by a clock of our own: of those too late, every fifth is passed on."""
    clock_s = iter(np.arange(0.0, 100.0, 0.25))
    monkeypatch.setattr("tensegraph.live.activity.time.perf_counter", lambda: next(clock_s))
    frames = [TendonLengths(10.0 + k, *[np.empty(0)] * 4) for k in range(20)]
    activity = Activity.of(boards=1, imus=0)
    kept = [f.t_s for f in NewestFrames(Backlog([(5.0, 9)] * 20), activity).select(iter(frames))]
    assert len(kept) == 4
    assert len(set(np.diff(kept))) == 1


def test_a_board_whose_readings_wait_is_not_silent() -> None:
    """Read two seconds late, at 50 Hz; one without any reading is."""
    arrivals = Activity.of(boards=2, imus=0).boards
    now_s = time.perf_counter()
    for k in range(10):
        arrivals[0].add(now_s - 2.0 + 0.02 * k)
    assert arrivals[0].rate_hz() == pytest.approx(50)
    assert not arrivals[0].is_silent()
    assert arrivals[1].rate_hz() == 0
    assert arrivals[1].is_silent()


def test_a_long_session_draws_every_slip(loaded, tmp_path, monkeypatch) -> None:
    """Of 100 frames at most 10 are drawn; the slips of all are, in order and at their own times, as in slips.csv."""
    monkeypatch.setattr("tensegraph.live.session.FIGURE_FRAMES", 10)
    drawn: list[Reconstruction] = []
    monkeypatch.setattr("tensegraph.io.figures.shape_figures.write_figures", lambda r, *_: drawn.append(r))
    slipping = {k: Slip(k / 50, 5, np.array([0.003, 0.0, 0.0]), 0.001) for k in (0, 1, 2, 17, 33, 64, 98, 99)}
    with LiveResult(tmp_path / "long", loaded.structure, Settings(), print) as result:
        for k, shape in enumerate(loaded):
            contacts = np.ones(loaded.structure.node_count)
            result.add(replace(shape, contacts=contacts, slips=(slipping[k],) if k in slipping else ()))
        result.finish("toy", {})
    (figures,) = drawn
    assert len(figures) <= 10
    assert [slip for frame in figures.slips for slip in frame] == list(slipping.values())
    written = np.genfromtxt(tmp_path / "long" / "slips.csv", delimiter=",", names=True)
    np.testing.assert_allclose(written["t_s"], [slip.t_s for slip in slipping.values()])
