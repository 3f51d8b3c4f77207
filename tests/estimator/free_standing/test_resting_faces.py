"""The face on which a structure rests, by the balance of forces."""

import numpy as np
import pytest

from balance import pressed
from tensegraph.estimator.free_standing.resting_faces import Balance, RestingFaces, balances_of
from tensegraph.models.estimation import DoubtSettings
from tensegraph.models.structure.support import standing


@pytest.fixture(scope="module")
def faces(structure, balanced) -> RestingFaces:
    return RestingFaces(
        structure, balanced.mechanics.rod_mass_kg, balanced.node_position_m, np.arange(12) < 3, DoubtSettings()
    )


def test_a_hull_of_twelve_nodes_has_twenty_faces_and_thirty_edges(faces) -> None:
    assert len(faces.probability) == 50
    assert faces.standing.nodes.tolist() == (np.arange(12) < 3).tolist()


def test_up_is_out_of_the_floor(faces, balanced) -> None:
    """On its base triangle, the structure stands as the rest shape does."""
    up = faces.up(balanced.node_position_m)
    assert up[np.argmax(faces.probability)] == pytest.approx([0, 0, 1], abs=0.02)
    assert np.linalg.norm(up, axis=1) == pytest.approx(1)


def exact_balance(faces, balanced, structure, hypothesis: int, hand_n: np.ndarray) -> Balance:
    """Return what a balance, known to 0.02 N across and along all directions, says of the forces of a hypothesis."""
    x = balanced.node_position_m
    carried = faces._carried[hypothesis]
    support = standing(structure, balanced.mechanics.rod_mass_kg, x, faces.up(x)[hypothesis], 0.0, carried)
    information = np.eye(36) / 0.02**2
    return Balance(information, -information @ (support.force_n + hand_n).ravel(), 0.0)


@pytest.mark.parametrize("hypothesis", [0, 7, 19])
def test_the_face_whose_forces_act_has_the_most_evidence(hypothesis, faces, balanced, structure) -> None:
    balance = exact_balance(faces, balanced, structure, hypothesis, np.zeros((12, 3)))
    evidence = faces.log_evidence([balance], balanced.node_position_m)
    assert np.argmax(evidence) == hypothesis


def test_two_hands_are_no_floor(faces, balanced, structure) -> None:
    """A squeeze of 1.5 N at nodes that do not stand does not change the face."""
    hand_n = np.zeros((12, 3))
    free = np.flatnonzero(faces._carried[3] == 0)
    hand_n[free[0]] = [1.5, 0, 0]
    hand_n[free[1]] = [-1.5, 0, 0]
    evidence = faces.log_evidence([exact_balance(faces, balanced, structure, 3, hand_n)], balanced.node_position_m)
    assert np.argmax(evidence) == 3


def test_evidence_for_another_face_takes_the_structure_over_an_edge(faces, structure, balanced) -> None:
    fresh = RestingFaces(
        structure, balanced.mechanics.rod_mass_kg, balanced.node_position_m, np.arange(12) < 3, DoubtSettings()
    )
    start = int(np.argmax(fresh.probability))
    edge = 20 + int(np.flatnonzero((fresh._beside == start).any(axis=1))[0])
    beside = fresh._beside[edge - 20]
    target = int(beside[beside != start][0])
    evidence = np.full(50, -10.0)
    evidence[target] = 0.0
    for _ in range(30):
        fresh.predict(0.2)
        fresh.update(evidence, np.zeros(50), 0.2)
    assert np.argmax(fresh.probability) == target
    assert fresh.probability.sum() == pytest.approx(1)


def test_known_heights_tell_the_face(faces, balanced) -> None:
    """Heights between all pairs of three nodes as they are on the base: the base, or an edge of it."""
    x = balanced.node_position_m
    pairs = np.array([[3, 7], [3, 11], [7, 11], [4, 8]])
    evidence = faces.log_evidence_of_heights(x, pairs, x[pairs[:, 1], 2] - x[pairs[:, 0], 2])
    assert evidence[np.argmax(faces.probability)] == pytest.approx(0, abs=1)
    assert (evidence < -5).sum() > 30


def test_the_balance_says_what_forces_act(structure, balanced) -> None:
    """Two ways to the same: with a press, the gradient pulls the outer forces towards the pressing force."""
    load = np.zeros((12, 3))
    load[5] = [0, 0, -2.0]
    from tensegraph.estimator.graph import GraphBuilder
    from tensegraph.estimator.linear_frame import linearised
    from tensegraph.factors.noise import weigh
    from tensegraph.models.estimation import NoiseSettings
    from tensegraph.models.values.readings import TendonLengths

    x = pressed(structure, balanced, load)
    count = len(structure.tendons)
    lengths = TendonLengths(
        0.0, structure.tendon_length_m(x), np.full(count, 1e-4), np.zeros(count, np.int64), np.zeros(count, np.int64)
    )
    builder = GraphBuilder(structure, balanced, NoiseSettings())
    frame = linearised(builder, x, weigh(lengths, builder.noise))
    statics = builder.statics
    variances_n2 = builder.internal_variance_n2 + np.array([[0.03], [0.3]]) ** 2
    balance, less_quiet = balances_of(frame, statics.outer_force_jacobian(x), statics.outer_force_n, variances_n2)
    assert np.trace(less_quiet.information) < np.trace(balance.information)
    estimate = np.linalg.solve(balance.information + np.eye(36) / 3.0**2, -balance.gradient).reshape(12, 3)
    assert np.argmax(np.linalg.norm(estimate - statics.outer_force_n, axis=1)) == 5
