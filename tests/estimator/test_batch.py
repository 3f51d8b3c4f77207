"""The batch graph: lengths without their lag, and no frames at all."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Settings
from tensegraph.estimator.batch import BatchOptimizer, averaged_forces
from tensegraph.estimator.lag_compensation import VELOCITY_HOLDS_S
from tensegraph.estimator.smoother import AHEAD_S, LiveSmoother
from tensegraph.models.structure.shape import Status
from tensegraph.models.values.readings import Flag


def test_batch_takes_lengths_without_their_lag(structure, rest, lengths_of) -> None:
    """Lengths that come two frames late are used two frames earlier; the last ones stand in for what never came."""
    frames = [
        replace(lengths_of(structure, rest.node_position_m, 0.02 * k, noise=1e-5 * k), lag_s=0.038) for k in range(9)
    ]
    shapes = list(BatchOptimizer(structure, rest, Settings()).estimate(frames))
    assert [shape.t_s for shape in shapes] == [frame.t_s for frame in frames]
    for shape, later in zip(shapes, [2, 3, 4, 5, 6, 7, 8, 8, 8], strict=True):
        np.testing.assert_array_equal(shape.lengths.length_m, frames[later].length_m)


@pytest.mark.parametrize(("step_s", "ahead_s"), [(0.02, VELOCITY_HOLDS_S), (0.1, AHEAD_S)])
def test_a_pass_that_leaves_out_rows_starts_ahead(balanced, lengths_of, monkeypatch, step_s, ahead_s) -> None:
    """The rows that it leaves out show that the robot moves slowly; where rows are slow, there are none."""
    passes = []
    estimate = LiveSmoother.first_shape
    monkeypatch.setattr(LiveSmoother, "first_shape", lambda live, row: passes.append(live) or estimate(live, row))
    frames = [lengths_of(balanced.structure, balanced.node_position_m, step_s * k) for k in range(12)]
    assert len(list(BatchOptimizer(balanced.structure, balanced, Settings()).estimate(frames))) == 12
    assert {live.ahead_s for live in passes} == {ahead_s}


def test_no_frames_give_no_shapes(structure, balanced) -> None:
    assert list(BatchOptimizer(structure, balanced, Settings()).estimate([])) == []


def test_loads_are_averaged_up_to_a_gap_and_not_across_it() -> None:
    """No load before a gap of a second, 3 N after it."""
    t_s = np.concatenate([np.arange(0, 1, 0.02), np.arange(2, 3, 0.02)])
    force_n = np.repeat([0.0, 3.0], 50)[:, None, None] * np.ones((1, 2, 3))
    np.testing.assert_allclose(averaged_forces(force_n, t_s, 6.0), force_n, atol=1e-12)


def test_a_fault_of_all_frames_is_left_out_in_the_first_one_too(balanced, lengths_of) -> None:
    """The live pass finds it after one or two of its looks."""
    structure, rng = balanced.structure, np.random.default_rng(3)
    wrong = np.where(np.arange(len(structure.tendons)) == 8, -0.03, 0.0)
    frames = [
        lengths_of(structure, balanced.node_position_m, 0.02 * k, noise=wrong + rng.normal(0, 2e-4, len(wrong)))
        for k in range(60)
    ]
    shapes = list(BatchOptimizer(structure, balanced, Settings()).estimate(frames))
    for shape in shapes:
        assert np.flatnonzero(shape.lengths.flags & int(Flag.IMPLAUSIBLE)).tolist() == [8]
        assert np.abs(shape.node_position_m - balanced.node_position_m).max() < 0.003


def test_a_stuck_sensor_is_left_out_for_the_second_before_it_is_found(balanced, lengths_of) -> None:
    """Meanwhile it reads 6 mm too much, which no check of single frames finds. It was found as soon as may be."""
    structure, rng = balanced.structure, np.random.default_rng(3)
    stuck_from, found_from = 20, 70
    frames = []
    for k in range(90):
        is_stuck = (np.arange(len(structure.tendons)) == 8) & (k >= stuck_from)
        noise = np.where(is_stuck, 0.006, rng.normal(0, 2e-4, len(is_stuck)))
        lengths = lengths_of(structure, balanced.node_position_m, 0.02 * k, noise=noise)
        if k >= found_from:
            lengths.sigma_m[is_stuck], lengths.length_m[is_stuck] = np.inf, np.nan
            lengths.flags[is_stuck] |= int(Flag.STUCK | Flag.MISSING)
        frames.append(lengths)
    shapes = list(BatchOptimizer(structure, balanced, Settings()).estimate(frames))
    is_usable = np.array([shape.lengths.usable for shape in shapes])
    assert is_usable[:stuck_from, 8].all()
    assert not is_usable[stuck_from + 1 :, 8].any()  # what it read first may be true
    assert is_usable[:, np.arange(len(structure.tendons)) != 8].all()
    assert {shape.status for shape in shapes[stuck_from + 1 :]} == {Status.PARTIAL}
