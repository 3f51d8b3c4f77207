"""Which sensors tell how a robot is turned."""

import numpy as np
import pytest

from tensegraph.estimator.free_standing.estimators import clearances
from tensegraph.estimator.free_standing.watches.measured_attitude import MeasuredAttitude, are_parallel
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import PositionReading
from tensegraph.models.values.readings import TendonLengths


def seen(nodes: list[int]) -> TendonLengths:
    """Return a frame with a position of each of some nodes."""
    none = np.zeros(0)
    readings = tuple(PositionReading(0.0, node, np.zeros(3), 0) for node in nodes)
    return TendonLengths(t_s=0.0, length_m=none, sigma_m=none, mode=none, flags=none, aids=readings)


@pytest.mark.parametrize(("nodes", "on_one_line"), [([3], False), ([3, 8], True), ([3, 8, 10], False)])
def test_positions_of_two_nodes_do_not_tell_the_turn_about_their_line(rest: RestShape, nodes, on_one_line) -> None:
    """The balance of forces is asked besides, as it is with inertial sensors on parallel rods."""
    attitude = MeasuredAttitude()
    assert attitude.observe(seen(nodes), np.zeros(0, dtype=np.bool_)) == (len(nodes) > 1)
    assert are_parallel(attitude.located_pairs, rest) == on_one_line


@pytest.mark.parametrize(("normal_sigma_rad", "nodes"), [(0.0, [3, 8]), (0.1, [])])
def test_heights_are_known_above_a_floor_that_is_told_exactly(normal_sigma_rad: float, nodes) -> None:
    """By hand: two nodes at the origin, of which one that stands would be 10 mm high."""
    known, clearance_m = clearances(seen([3, 8]).aids, Floor(0.01, UP, normal_sigma_rad))
    assert known.tolist() == nodes
    np.testing.assert_allclose(clearance_m, [-0.01] * len(nodes))
