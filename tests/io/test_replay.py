"""A recorded trial at its pace."""

import time
from dataclasses import replace

import numpy as np

from tensegraph import open_trial
from tensegraph.io.replay import Replay
from tensegraph.models.values.aids import ImuReading


def test_a_replay_keeps_the_pace_of_the_trial(example) -> None:
    """Two seconds of the trial, four times faster: rows come when they are due, never before."""
    readings = [r for r in open_trial(example).readings() if r.host_s < 2.0]
    replay, came_s = Replay(readings, speed=4.0), []
    begin_s = time.perf_counter()
    for _ in replay.rows():
        came_s.append(time.perf_counter() - begin_s)
    due_s = (np.array([r.host_s for r in readings]) - readings[0].host_s) / 4
    assert (np.array(came_s) >= due_s - 1e-3).all()
    assert np.median(came_s - due_s) < 0.1  # at half of the pace it would be 0.25
    assert replay.waiting() == 0


def test_a_replay_passes_over_a_silence_of_hours(example) -> None:
    """The clock of a recording jumps by a day: the next reading comes at once."""
    readings = [r for r in open_trial(example).readings() if r.host_s < 0.2]
    readings += [replace(r, host_s=r.host_s + 86_400) for r in readings]
    begin_s = time.perf_counter()
    assert len(list(Replay(readings, speed=1.0).rows())) == len(readings)
    assert time.perf_counter() - begin_s < 5


def test_a_replay_does_not_wait_for_sensors_that_go_on_without_the_tendons(example) -> None:
    """For an hour, at 10 s: a minute of it is shown, a hundred times faster."""
    readings = [r for r in open_trial(example).readings() if r.host_s < 0.2]
    readings += [ImuReading(0, 10.0 * k, np.zeros(3), np.zeros(3)) for k in range(1, 360)]
    begin_s = time.perf_counter()
    assert len(list(Replay(readings, speed=100.0).rows())) == len(readings)
    assert 0.4 < time.perf_counter() - begin_s < 5
