"""Whether a robot stands on a face of its hull."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state, robot_with_two_sensors
from tensegraph.estimator.free_standing.watches.stand_watch import nearest_face
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.values.aids import ImuReading, PositionReading
from tensegraph.models.values.rotations import rotation


@pytest.mark.parametrize("sigmas", [0.5, 5.0])
def test_how_far_a_structure_is_from_lying_flat(sigmas: float) -> None:
    """By hand: turned about x by some of its standard deviations of 0.01 rad, e = (0, 0.3 rad) m, S = (0.3 sigma)^2."""
    body_m = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.1, 0.1, 0.2]])
    turn = rotation(np.array([0.01 * sigmas, 0.0, 0.0]))
    state = replace(any_state(0, 0), turn=turn, position_m=np.zeros(3))
    placed = PlacedShape(state, body_m, 1e-12 * np.eye(12))
    covariance = np.zeros((state.layout.size, state.layout.size))
    covariance[:3, :3] = 0.01**2 * np.eye(3)
    face, squared = nearest_face(placed, covariance, Floor(0.0, UP))
    assert np.flatnonzero(face).tolist() == [0, 1, 2]
    assert squared == pytest.approx(sigmas**2, rel=0.01)


@pytest.mark.parametrize(("nodes", "is_doubted"), [((), True), ((8,), True), ((3, 8), False)])
def test_positions_of_two_nodes_tell_how_a_robot_is_held_and_that_of_one_does_not(balanced, nodes, is_doubted) -> None:
    """A hand leans it by 0.2 rad over the edge 0 2 and holds it so; positions are read in every second frame."""
    poses, x = robot_with_two_sensors(balanced), balanced.node_position_m
    edge = (x[2] - x[0]) / np.linalg.norm(x[2] - x[0])
    edge *= np.sign(np.cross(edge, x[1] - x[0]) @ UP)
    contradicted = []
    for k in range(130):
        turn = rotation(0.004 * min(max(k - 30, 0), 50) * edge)
        rate = 0.2 * edge * (30 < k <= 80)
        force = GRAVITY_M_PER_S2 * turn.T @ UP
        true_m = x[0] + (x - x[0]) @ turn.T
        aids = [ImuReading(i, 0.02 * k, rate, force) for i in range(2)]
        aids += [PositionReading(0.02 * k, node, true_m[node]) for node in nodes if k % 2]
        contradicted.append(poses.step(0.02 * k, x, 1e-8 * np.eye(36), aids).standing.contradicted)
    assert set(contradicted[110:]) == {is_doubted}
