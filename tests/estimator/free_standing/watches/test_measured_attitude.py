"""Which sensors tell how a robot is turned."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.estimator.free_standing.watches.face_watch import clearances
from tensegraph.estimator.free_standing.watches.measured_attitude import Attitude, MeasuredAttitude
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import Imu, ImuReading, PositionReading
from tensegraph.models.values.readings import TendonLengths


def seen(nodes: list[int]) -> TendonLengths:
    """Return a frame with a position of each of some nodes."""
    none = np.zeros(0)
    readings = tuple(PositionReading(0.0, node, np.zeros(3), 0) for node in nodes)
    return TendonLengths(t_s=0.0, length_m=none, sigma_m=none, mode=none, flags=none, aids=readings)


@pytest.mark.parametrize(
    ("nodes", "known"),
    [([3], Attitude.UNKNOWN), ([3, 8], Attitude.KNOWN_BUT_ONE_TURN), ([3, 8, 10], Attitude.KNOWN)],
)
def test_positions_of_two_nodes_do_not_tell_the_turn_about_their_line(rest: RestShape, nodes, known) -> None:
    """The balance of forces is asked besides, as it is with inertial sensors on parallel rods."""
    robot = FreeStandingRobot(floor=Floor(0.01, UP), rest_seconds=0.0)
    assert MeasuredAttitude(rest, robot).observe(seen(nodes), np.zeros(0, dtype=np.bool_)) is known


@pytest.mark.parametrize(("rods", "known"), [((0,), Attitude.KNOWN_BUT_ONE_TURN), ((0, 2), Attitude.KNOWN)])
def test_sensors_on_rods_of_one_direction_do_not_tell_the_turn_about_them(rest: RestShape, rods, known) -> None:
    robot = FreeStandingRobot(floor=Floor(0.01, UP), imus=tuple(Imu(rod, 0.5, UP) for rod in rods), rest_seconds=0.0)
    felt = tuple(ImuReading(number, 0.0, np.zeros(3), 9.81 * UP) for number in range(len(rods)))
    lengths = replace(seen([]), aids=felt)
    assert MeasuredAttitude(rest, robot).observe(lengths, np.ones(len(rods), dtype=np.bool_)) is known
    assert MeasuredAttitude(rest, robot).observe(lengths, np.zeros(len(rods), dtype=np.bool_)) is Attitude.UNKNOWN


@pytest.mark.parametrize(("normal_sigma_rad", "nodes"), [(0.0, [3, 8]), (0.1, [])])
def test_heights_are_known_above_a_floor_that_is_told_exactly(normal_sigma_rad: float, nodes) -> None:
    """By hand: two nodes at the origin, of which one that stands would be 10 mm high."""
    known, clearance_m = clearances(seen([3, 8]).aids, Floor(0.01, UP, normal_sigma_rad))
    assert known.tolist() == nodes
    np.testing.assert_allclose(clearance_m, [-0.01] * len(nodes))
