"""Samples of an inertial sensor on the host's clock, without a board."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import BoardReading
from tensegraph.io.boards.inertial import BoardImu
from tensegraph.io.boards.protocol import Sample
from tensegraph.models.sensor.clock import BoardClock, ClockSettings
from tensegraph.models.values.link import ImuCounts

DELAY_S = 0.004


class Board:
    """A board whose clock has started at 3 s of the host's, and a sensor on it, sampled 5 ms after each row."""

    def __init__(self) -> None:
        self.clock = BoardClock(ClockSettings(minimum_delay_s=DELAY_S))
        self.imu = BoardImu(1, self.clock)

    def row(self, k: int) -> None:
        """Let a row arrive."""
        counts = np.zeros(2, dtype=np.int64)
        self.clock.time_s(BoardReading(0, 3.0 + 0.02 * k + DELAY_S, k % 2**16, 20_000 * k, counts, 0))

    def sample(self, k: int) -> Sample:
        return Sample(0, 0, 0, k % 2**16, 20_000 * k + 5000, 0.001, 0.002, (1, -2, 32767), (0, -1, 4905))


def test_a_sample_by_hand() -> None:
    board = Board()
    board.row(0)
    reading = board.imu.reading(board.sample(0))
    assert reading.imu == 1
    assert reading.t_s == pytest.approx(3.005)
    assert reading.rate_rad_per_s.tolist() == [0.001, -0.002, 32.767]
    assert reading.specific_force_m_per_s2.tolist() == [0.0, -0.002, 9.81]


def test_lost_double_and_late_samples_are_counted() -> None:
    board, taken = Board(), []
    for k in (0, 1, 2, 5, 5, 4, 6):
        board.row(k)
        taken.append(board.imu.reading(board.sample(k)) is not None)
    assert taken == [True, True, True, True, False, False, True]
    assert board.imu.counts == ImuCounts(samples=5, lost_samples=2, dropped_samples=2)


def test_a_sample_before_the_first_row_since_a_start_has_no_time() -> None:
    board = Board()
    assert board.imu.reading(board.sample(0)) is None
    board.row(0)
    assert board.imu.reading(replace(board.sample(0), boot=1)) is None
    assert board.imu.reading(board.sample(0)) is not None
    assert board.imu.counts == ImuCounts(samples=1, dropped_samples=2)


def test_after_a_long_silence_the_counter_may_stand_anywhere() -> None:
    """A cable was out for twelve minutes: the counter has wrapped by more than a half."""
    board = Board()
    board.row(0)
    first = board.imu.reading(board.sample(0))
    for k in (35_999, 36_000):  # the clock, too, takes the second row that follows
        board.row(k)
    again = board.imu.reading(board.sample(36_000))
    assert again.t_s - first.t_s == pytest.approx(720.0)


def test_stamps_never_go_back_when_the_clock_is_corrected() -> None:
    """The first rows were late by 30 ms: with the first punctual one, everything has been earlier than thought."""
    board, times_s = Board(), []
    counts = np.zeros(2, dtype=np.int64)
    for k in range(20):
        late_s = 0.03 if k < 10 else 0.0
        board.clock.time_s(BoardReading(0, 3.0 + 0.02 * k + DELAY_S + late_s, k, 20_000 * k, counts, 0))
        times_s.append(board.imu.reading(board.sample(k)).t_s)
    assert (np.diff(times_s) > 0).all()
    assert times_s[-1] == pytest.approx(3.0 + 0.02 * 19 + 0.005, abs=1e-3)
