"""The face on which a structure rests, by the balance of forces."""

import numpy as np
import pytest

from balance import pressed
from tensegraph.estimator.free_standing.estimators import FreeStandingSmoother
from tensegraph.estimator.free_standing.resting_faces import Balance, RestingFaces, _gain, _gain_of_squeeze, balances_at
from tensegraph.models.balance.support import standing
from tensegraph.models.estimation import DoubtSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.settings import Settings
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.lengths import member_length_m
from tensegraph.models.values.readings import TendonLengths
from told_rows import rows_of


@pytest.fixture(scope="module")
def faces(structure, balanced) -> RestingFaces:
    return RestingFaces(
        balanced.mechanics.node_mass_kg(structure), balanced.node_position_m, np.arange(12) < 3, DoubtSettings()
    )


def test_a_hull_of_twelve_nodes_has_twenty_faces_and_thirty_edges(faces) -> None:
    assert len(faces.probability) == 20 + 2 * 30
    assert len(faces._carried) == 20 + 30
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
    support = standing(balanced.mechanics.node_mass_kg(structure), x, faces.up(x)[hypothesis], 0.0, carried)
    information = np.eye(36) / 0.02**2
    return Balance(information, -information @ (support.force_n + hand_n).ravel(), 0.0)


@pytest.mark.parametrize("hypothesis", [0, 7, 19])
def test_the_face_whose_forces_act_has_the_most_evidence(hypothesis, faces, balanced, structure) -> None:
    balance = exact_balance(faces, balanced, structure, hypothesis, np.zeros((12, 3)))
    (evidence,) = faces.log_evidence_in_parts([balance], balanced.node_position_m, 1)
    assert np.argmax(evidence) == hypothesis


def test_two_hands_are_no_floor(faces, balanced, structure) -> None:
    """A squeeze of 1.5 N at nodes that do not stand does not change the face."""
    hand_n = np.zeros((12, 3))
    free = np.flatnonzero(faces._carried[3] == 0)
    hand_n[free[0]] = [1.5, 0, 0]
    hand_n[free[1]] = [-1.5, 0, 0]
    balance = exact_balance(faces, balanced, structure, 3, hand_n)
    (evidence,) = faces.log_evidence_in_parts([balance], balanced.node_position_m, 1)
    assert np.argmax(evidence) == 3


def test_evidence_in_parts_is_that_of_all(faces, balanced, structure) -> None:
    balances = [exact_balance(faces, balanced, structure, 3, np.ones((12, 3)))]
    (whole,) = faces.log_evidence_in_parts(balances, balanced.node_position_m, 1)
    parts = list(faces.log_evidence_in_parts(balances, balanced.node_position_m, 7))
    assert len(parts) == 7
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-6)


@pytest.mark.parametrize(
    ("frames_per_s", "in_batch", "told_s"),
    [
        (50, False, [0.0, 0.24, 0.44]),
        (25, False, [0.0, 0.24, 0.44]),
        (10, False, [0.0, 0.2, 0.4]),
        (50, True, [0, 0.2, 0.4]),
    ],
)
def test_a_look_is_told_some_frames_later(frames_per_s, in_batch, told_s, balanced) -> None:
    """Looks begin at 0, 0.2 and 0.4 s; nothing tells how long the first frame lasts, which does all of its look."""
    x = balanced.node_position_m
    robot = FreeStandingRobot(floor=Floor(float(x[0, 2]), UP), rest_seconds=0.1)
    live = FreeStandingSmoother(balanced, robot, Settings())
    live.kept = [] if in_batch else None
    tendons = balanced.structure.tendons
    length_m, zero = member_length_m(x, tendons), np.zeros(len(tendons), dtype=np.int64)
    found_s = []
    for k in range(frames_per_s // 2 + 1):
        live.update(TendonLengths(k / frames_per_s, length_m, np.full(len(zero), 5e-4), zero, zero))
        if live._faces.found is not None:
            found_s.append(k / frames_per_s)
    assert found_s == pytest.approx(told_s)


def told(faces, evidence: np.ndarray, may_tip: float, looks: int) -> np.ndarray:
    """Return (50,) the probability of each face and edge after some looks with the same evidence."""
    for _ in range(looks):
        faces.update(evidence, np.zeros(50), 0.2, may_tip)
    assert faces.probability.sum() == pytest.approx(1)
    return np.bincount(faces._hypothesis, faces.probability)


@pytest.fixture
def fresh(structure, balanced) -> RestingFaces:
    return RestingFaces(
        balanced.mechanics.node_mass_kg(structure), balanced.node_position_m, np.arange(12) < 3, DoubtSettings()
    )


def beside(faces) -> tuple[int, int, int]:
    """Return the likeliest face, one of its edges, and the face on the other side of it."""
    start = int(np.argmax(faces.probability))
    edge = int(np.flatnonzero((faces._beside == start).any(axis=1))[0])
    return start, 20 + edge, int(faces._beside[edge][faces._beside[edge] != start][0])


def test_evidence_while_lengths_change_takes_the_structure_over_an_edge(fresh) -> None:
    """Two looks of 0.2 s, then still: it has landed."""
    _, _, target = beside(fresh)
    evidence = np.where(np.arange(50) == target, 0.0, -10.0)
    told(fresh, evidence, 1.0, 2)
    assert np.argmax(told(fresh, evidence, 0.0, 3)) == target


def test_a_structure_whose_lengths_stay_the_same_stays_where_it_is(fresh) -> None:
    """Sensors that are wrong for two seconds, by as much as evidence may be; then doubt grows."""
    start, _, target = beside(fresh)
    evidence = np.where(np.arange(50) == target, 0.0, -10.0)
    assert np.argmax(told(fresh, evidence, 0.0, 10)) == start
    assert np.argmax(told(fresh, evidence, 0.0, 100)) == target


def test_evidence_that_changes_counts_at_once_without_a_change_of_the_lengths(fresh, structure, balanced) -> None:
    """As a robot is pushed slowly, evidence turns to an edge. Had it always been so, it would tell little."""
    start, edge, _ = beside(fresh)
    on_face, on_edge = (np.where(np.arange(50) == h, 0.0, -4.0) for h in (start, edge))
    always = told(fresh, on_edge, 0.0, 2)[edge]
    told(fresh, on_face, 0.0, 20)
    assert told(fresh, on_edge, 0.0, 2)[edge] > 2 * always


def test_it_leans_over_an_edge_without_a_change_and_falls_back(fresh) -> None:
    start, edge, target = beside(fresh)
    before = told(fresh, np.zeros(50), 0.0, 1)[edge]
    leaning = told(fresh, np.where(np.arange(50) == edge, 0.0, -10.0), 0.0, 10)
    assert leaning[edge] > 2 * before
    assert leaning[edge] > 10 * leaning[target]
    assert told(fresh, np.zeros(50), 0.0, 10)[start] > 0.9


def test_a_face_counts_with_the_edges_over_which_it_begins_to_lean(fresh) -> None:
    start, edge, target = beside(fresh)
    falls_back, lands = (
        (fresh._hypothesis == edge).nonzero()[0][fresh._from[fresh._hypothesis[20:] == edge] == f]
        for f in (start, target)
    )
    fresh.probability = np.zeros(80)
    fresh.probability[start], fresh.probability[falls_back], fresh.probability[lands] = 0.85, 0.11, 0.04
    assert fresh.probability_with_leaning == pytest.approx(0.96)


def test_probabilities_stay_such(fresh) -> None:
    for may_tip in (0.0, 0.3, 1.0):
        step = fresh._transition(0.2, may_tip)
        assert step.min() >= 0
        assert step.sum(axis=1) == pytest.approx(1)


def test_a_later_look_tells_an_earlier_one(fresh) -> None:
    """Between two faces nothing is told as it lands; what follows tells it."""
    _, _, target = beside(fresh)
    sure = np.where(np.arange(50) == target, 0.0, -10.0)
    filtered, may_tip = [], np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    for ratio, evidence in zip(may_tip, [np.zeros(50)] * 2 + [sure] * 4, strict=True):
        told(fresh, evidence, ratio, 1)
        filtered.append(fresh.probability)
    smoothed = fresh.smoothed(0.2, np.array(filtered), may_tip)
    landed = fresh._carried[target]
    assert smoothed[1].probability_of(landed > 0) > fresh._standing(filtered[1]).probability_of(landed > 0)


def test_a_squeeze_is_worth_as_much_as_its_force_explains() -> None:
    """By hand, with M = m 1 for two nodes: G = 1 + 2 m load^2, gain = g^2 / 2 G - 3/2 log G, g = load (e_a - e_b)."""
    load, m = 1.5, 4.0
    e = np.array([[0.7, 0, 0, -0.7, 0, 0]])
    G = 1 + 2 * m * load**2
    expected = (load * 1.4) ** 2 / (2 * G) - 1.5 * np.log(G)
    assert _gain_of_squeeze(load, m * np.eye(6)[None], e)[0, 0] == pytest.approx(expected)


def test_the_gain_written_out_is_that_of_linear_algebra() -> None:
    rng = np.random.default_rng(2)
    root, g = rng.standard_normal((4, 5, 3, 3)), rng.standard_normal((4, 5, 3))
    G = np.eye(3) + root @ np.swapaxes(root, -1, -2)
    solved = np.linalg.solve(G, g[..., None])[..., 0]
    assert _gain(G, g) == pytest.approx(0.5 * np.sum(g * solved, axis=-1) - 0.5 * np.linalg.slogdet(G)[1])


def test_known_heights_tell_the_face(faces, balanced) -> None:
    """Heights between all pairs of three nodes as they are on the base: the base, or an edge of it."""
    x = balanced.node_position_m
    pairs = np.array([[3, 7], [3, 11], [7, 11], [4, 8]])
    evidence = faces.log_evidence_of_heights(x, pairs, x[pairs[:, 1], 2] - x[pairs[:, 0], 2])
    assert evidence[np.argmax(faces.probability)] == pytest.approx(0, abs=1)
    assert (evidence < -5).sum() > 30


def test_the_height_of_one_node_tells_which_faces_it_is_not(faces, balanced) -> None:
    """By hand: one that stands is at the floor on the faces with it, and its own height above the base on that."""
    base, nodes = int(np.argmax(faces.probability)), np.array([5])
    x = balanced.node_position_m
    at_floor = faces.log_evidence_of_clearances(x, nodes, np.zeros(1))
    with_node = np.flatnonzero(faces._carried[:20, 5])
    assert at_floor[with_node] == pytest.approx(0, abs=1e-6)
    assert at_floor[base] < -5
    above_m = x[5, 2] - x[:, 2].min()
    assert faces.log_evidence_of_clearances(x, nodes, np.array([above_m]))[base] == pytest.approx(0, abs=1)


def test_the_balance_says_what_forces_act(structure, balanced) -> None:
    """Two ways to the same: with a press, the gradient pulls the outer forces towards the pressing force."""
    load = np.zeros((12, 3))
    load[5] = [0, 0, -2.0]
    from tensegraph.estimator.graph import GraphBuilder
    from tensegraph.estimator.linear_frame import linearised
    from tensegraph.factors.noise import weigh
    from tensegraph.models.estimation import NoiseSettings

    x = pressed(structure, balanced, load)
    (lengths,) = rows_of([structure.tendon_length_m(x)], 1e-4)
    builder = GraphBuilder(structure, balanced, NoiseSettings())
    frame = linearised(builder, x, weigh(lengths, builder.noise))
    balance, *_, less_quiet = balances_at(x, frame, builder, 0.03)
    assert np.trace(less_quiet.information) < np.trace(balance.information)
    estimate = np.linalg.solve(balance.information + np.eye(36) / 3.0**2, -balance.gradient).reshape(12, 3)
    assert np.argmax(np.linalg.norm(estimate - builder.statics.outer_force_n, axis=1)) == 5
