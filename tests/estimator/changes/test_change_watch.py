"""A rod, a tendon or the sensors of a board change: it is told, and the nodes stay in their ellipsoids."""

from dataclasses import replace

import numpy as np
import pytest

from balance import pressed
from tensegraph import Flag, Settings
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.structure.shape import Reason, Status
from tensegraph.models.values.readings import SensorDrift

FROM_S = 2.0
PER_CHANGE_M = 0.2
BOARD = np.repeat([0, 1], 12)


def frames_of(structure, balanced, lengths_of, changed_m, error_m):
    """Frames at 10 Hz of the rest shape, and from 2 s on of another one, with errors of the lengths."""
    rng = np.random.default_rng(2)
    drift = SensorDrift(np.zeros(24), np.zeros(24), np.full(24, PER_CHANGE_M), references=3, board=BOARD)
    frames = []
    for t in np.arange(0, 7, 0.1):
        position_m, lasting_m = (changed_m, error_m) if t >= FROM_S else (balanced.node_position_m, 0.0)
        noise_m = lasting_m + 1e-4 * rng.standard_normal(24)
        frames.append(replace(lengths_of(structure, position_m, t, 4e-4, noise_m), drift=drift))
    return frames


def rod_slips(structure, balanced):
    """Rod 3 slips into its cap by 6 mm."""
    shorter_m = structure.rod_length_m - 0.006 * (np.arange(6) == 3)
    return pressed(replace(structure, rod_length_m=shorter_m), balanced, np.zeros((12, 3))), np.zeros(24)


def clamp_slips(structure, balanced):
    """The clamp of tendon 12 slips by 10 mm, of which its strip sees nothing."""
    slip_m = 0.010 * (np.arange(24) == 12)
    mechanics = replace(balanced.mechanics, natural_length_m=balanced.mechanics.natural_length_m + slip_m)
    return pressed(structure, replace(balanced, mechanics=mechanics), np.zeros((12, 3))), -slip_m


def supply_sags(structure, balanced):
    """All sensors of board 1 read 0.7 % less."""
    return balanced.node_position_m, -0.007 * PER_CHANGE_M * (BOARD == 1)


def nees(shape, position_m, free):
    """Squared errors over the covariance, of each free node."""
    error = shape.node_position_m[free] - position_m[free]
    return np.einsum("ni,ni->n", error, np.linalg.solve(shape.node_covariance_m2[free], error[..., None])[..., 0])


@pytest.mark.parametrize(
    ("event", "reason"), [(rod_slips, Reason.CHANGE), (clamp_slips, Reason.CHANGE), (supply_sags, Reason.BOARD)]
)
def test_a_change_is_told_within_four_seconds(event, reason, structure, balanced, lengths_of) -> None:
    changed_m, error_m = event(structure, balanced)
    frames = frames_of(structure, balanced, lengths_of, changed_m, error_m)
    shapes = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))
    assert all(shape.doubt is None for shape in shapes if shape.t_s < FROM_S - 0.05)
    late = [shape for shape in shapes if shape.t_s >= FROM_S + 4]
    assert {shape.status for shape in late} == {Status.DOUBT}
    assert reason in {shape.doubt for shape in late} <= {reason, Reason.SENSORS}
    assert nees(late[-1], changed_m, structure.free_nodes).max() < 16.27  # in their ellipsoids of 99.9 %


def test_batch_tells_it_from_its_beginning(structure, balanced, lengths_of) -> None:
    changed_m, error_m = rod_slips(structure, balanced)
    frames = frames_of(structure, balanced, lengths_of, changed_m, error_m)
    shapes = list(BatchOptimizer(structure, balanced, Settings()).estimate(frames))
    changed = [shape for shape in shapes if shape.t_s >= FROM_S]
    assert {shape.doubt for shape in changed} == {Reason.CHANGE}
    # at once as wide as later, when the frames themselves tell which change it is
    assert max(nees(shape, changed_m, structure.free_nodes).max() for shape in changed) < 2


def test_a_fault_of_one_sensor_is_no_change(structure, balanced, lengths_of) -> None:
    """Its length is 6 mm off, its tendon pulls as before: it is left out, and nothing else is in doubt."""
    frames = frames_of(structure, balanced, lengths_of, balanced.node_position_m, 0.006 * (np.arange(24) == 12))
    last = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))[-1]
    assert last.status is Status.PARTIAL
    assert np.flatnonzero(last.lengths.flags & int(Flag.IMPLAUSIBLE)).tolist() == [12]


def test_loads_are_no_change(structure, balanced, lengths_of) -> None:
    """Two nodes are squeezed by 3 N along a tendon, as a clamp that slips would seem to."""
    a, b = structure.tendons[12]
    along = balanced.node_position_m[b] - balanced.node_position_m[a]
    load_n = np.zeros((12, 3))
    load_n[a], load_n[b] = 3.0 * along / np.linalg.norm(along), -3.0 * along / np.linalg.norm(along)
    frames = frames_of(structure, balanced, lengths_of, pressed(structure, balanced, load_n), np.zeros(24))
    shapes = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))
    assert {shape.doubt for shape in shapes} == {None}
