"""Ranges of beacons that are elsewhere than told, or that somebody stands in front of."""

from collections.abc import Callable

import numpy as np
import pytest

from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.pose_smoother import PoseStep
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.values.aids import RangeReading

BEACON_M = np.array([[-2.2, -1.7, 0.4], [2.1, -2.0, 2.0], [1.9, 2.6, 1.0], [-2.0, 1.9, 2.0]])
NODES = range(12)
REST_S = 2.0

Told = Callable[[np.ndarray], np.ndarray]


def steps(balanced, told: Told = lambda beacon_m: beacon_m, late_m: Callable[[float, int], float] = lambda t_s, b: 0.0):
    """A robot that stands still for 6 s: each frame reads two ranges, with noise of 0.05 m and offsets of 0.05 m.

    Args:
        balanced: its rest shape.
        told: from the true places of the beacons to those that are told.
        late_m: what a range of a beacon is too long by, by its time.
    """
    rng = np.random.default_rng(5)
    x = balanced.node_position_m
    pairs = tuple((0, b, n) for b in range(4) for n in NODES)
    offset_m = {pair: 0.05 * rng.standard_normal() for pair in pairs}
    robot = FreeStandingRobot(floor=Floor(float(x[:, 2].min()), UP), range_pairs=pairs, rest_seconds=REST_S)
    poses, beacon_m = PoseFilter(balanced, robot, PoseSettings()), told(BEACON_M)
    for k in range(300):
        t_s, aids = 0.02 * k, []
        for pair in rng.permutation(pairs)[:2].tolist():
            _, b, n = pair
            range_m = np.linalg.norm(x[n] - BEACON_M[b]) + offset_m[0, b, n] + 0.05 * rng.standard_normal()
            aids.append(RangeReading(t_s, beacon_m[b], tuple(pair), float(range_m + late_m(t_s, b))))
        yield poses.step(t_s, x, 1e-8 * np.eye(x.size), aids)


def doubted(found: list[PoseStep]) -> list[bool]:
    return [step.doubts_ranges for step in found]


def test_ranges_as_told_are_used_and_not_doubted(balanced) -> None:
    found = list(steps(balanced))
    assert not any(doubted(found))
    assert sum(len(step.outlying_ranges) for step in found) == 0


@pytest.mark.parametrize(
    "told",
    [
        lambda m: m[[1, 0, 2, 3]],
        lambda m: m + np.array([0.4, 0, 0]),
        lambda m: 1.3 * m,
    ],
    ids=["exchanged", "shifted", "scaled"],
)
def test_beacons_elsewhere_than_told_are_doubted_and_not_used(balanced, told: Told) -> None:
    found = list(steps(balanced, told))
    assert all(doubted(found)[100:])
    assert all(len(step.outlying_ranges) == 2 for step in found[100:])


def test_a_beacon_that_somebody_stands_before_is_left_out_until_it_is_free(balanced) -> None:
    """0.3 m too long from 3 to 4.5 s, each within five standard deviations: left out after a few, and used again."""
    found = list(steps(balanced, late_m=lambda t_s, b: 0.3 if b == 1 and 3.0 <= t_s < 4.5 else 0.0))
    assert not any(doubted(found))
    left_out = np.array([len(step.outlying_ranges) for step in found])
    assert left_out[:150].sum() == 0
    assert left_out[165:225].sum() > 15
    assert left_out[280:].sum() == 0


def test_a_range_that_is_no_number_and_a_beacon_that_fell_silent_while_off_say_nothing(balanced) -> None:
    """Beacon 0 is off by 0.4 m until it falls silent at 4 s; later one other is off: one of the three that are read."""

    def late_m(t_s: float, b: int) -> float:
        if b == 0:
            return 0.4 if 3.0 <= t_s < 4.0 else np.nan if t_s >= 4.0 else 0.0
        return 0.4 if b == 1 and t_s >= 5.2 else 0.0

    found = list(steps(balanced, late_m=late_m))
    assert not any(doubted(found))
    assert sum(len(step.outlying_ranges) for step in found[270:]) > 5


def test_where_half_of_the_beacons_are_off_ranges_stay_in_doubt(balanced) -> None:
    found = list(steps(balanced, late_m=lambda t_s, b: 0.4 if b < 2 and t_s >= 3.0 else 0.0))
    assert not any(doubted(found)[:150])
    assert doubted(found)[-1]
