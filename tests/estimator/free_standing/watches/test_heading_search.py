"""A robot that heads anywhere is found by ranges, and its errors become those of the search."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poses import any_state
from tensegraph.estimator.free_standing.prediction import Frame, Prediction
from tensegraph.estimator.free_standing.watches.heading_search import Headed, HeadingSearch, headed
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.values.aids import RangeReading
from tensegraph.models.values.rotations import rotation

BEACON_M = np.array([[-2.2, -1.7, 0.4], [2.1, -2.0, 2.0], [1.9, 2.6, 1.0], [-2.0, 1.9, 2.0]])
PAIRS = {(0, b, n): (12 * b + n, b) for b in range(4) for n in range(12)}
FLOOR = Floor(0.0, UP)
STANDING = np.arange(12) < 3
OFFSET_M, NOISE_M, BEHIND_M = 0.02, 0.05, 0.1


def lost(body_m: np.ndarray) -> Prediction:
    """Return what is expected of a robot whose heading is lost, and whose offsets are known to 2 cm."""
    state = replace(any_state(0, 48), position_m=np.array([0.3, -0.2, 0.1]), beacon_error_m=np.zeros(4))
    variance = np.full(state.layout.size, 1e-4)
    variance[state.layout.turn.start + 2] = 3.0
    variance[state.layout.range_offset], variance[state.layout.beacon_error] = OFFSET_M**2, BEHIND_M**2
    placed = PlacedShape(state, body_m, 1e-8 * np.eye(36))
    return Prediction(placed, np.eye(len(variance)), np.diag(variance), np.zeros(3))


def search(predicted: Prediction, angle: float, shift_m, nodes=range(12), seconds=0.6, late=lambda rng, b: 0.0, seed=1):
    """Return what is found of a robot that is turned and moved, by two ranges in each frame."""
    rng = np.random.default_rng(seed)
    watch, placed = HeadingSearch(PAIRS, PoseSettings(range_m=NOISE_M)), predicted.placed
    p = placed.state.position_m
    x = p + (placed.node_position_m - p) @ rotation(angle * UP).T + np.append(shift_m, 0.0)
    offset_m = placed.state.range_offset_m + OFFSET_M * rng.standard_normal(48)
    pairs, found = rng.permutation([pair for pair in PAIRS if pair[2] in nodes]).tolist(), None
    for k in range(round(seconds / 0.02)):
        t_s, ranges = 0.02 * k, []
        for j in (2 * k, 2 * k + 1):
            pair = tuple(pairs[j % len(pairs)])
            range_m = np.linalg.norm(x[pair[2]] - BEACON_M[pair[1]]) + offset_m[PAIRS[pair][0]]
            error_m = NOISE_M * rng.standard_normal() + late(rng, pair[1])
            ranges.append(RangeReading(t_s, BEACON_M[pair[1]], pair, float(range_m + error_m)))
        frame = Frame(t_s, t_s - 0.02, 0.02, x, x, np.eye(36), [], ranges, None)
        found = watch.observe(predicted, frame, STANDING, FLOOR) or found
    return found


def errors(found: Headed, angle: float, shift_m) -> np.ndarray:
    return np.array([np.angle(np.exp(1j * (found.angle_rad - angle))), *(found.shift_m @ FLOOR.axes[:, :2] - shift_m)])


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(-np.pi, np.pi), x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), seed=st.integers(0, 10**6))
def test_any_heading_and_place_are_found(balanced, angle, x, y, seed) -> None:
    """All 48 ranges once: within five standard deviations, in which the place includes somebody before a beacon."""
    found = search(lost(balanced.node_position_m), angle, [x, y], seed=seed)
    assert (np.abs(errors(found, angle, [x, y])) < 5 * np.sqrt(np.diag(found.covariance))).all()
    assert np.sqrt(found.covariance[0, 0]) < 0.15
    assert 0.05 < np.sqrt(found.covariance[1, 1]) < 0.12


def test_ranges_to_one_node_tell_its_place_alone(balanced) -> None:
    """The robot may stand on any side of the node, which is some decimetre from p."""
    found = search(lost(balanced.node_position_m), 2.0, [0.3, 0.1], nodes=[7])
    assert np.sqrt(found.covariance[0, 0]) > 1.0
    error = errors(found, 2.0, [0.3, 0.1])
    assert error[1:] @ np.linalg.solve(found.covariance[1:, 1:], error[1:]) < 16


@pytest.mark.parametrize(
    "late",
    [lambda rng, b: 0.8 * (rng.random() < 0.1), lambda rng, b: 1.0 * (b == 2)],
    ids=["a_tenth_reflected", "somebody_before_a_beacon"],
)
def test_ranges_that_are_too_long_do_no_harm(balanced, late) -> None:
    found = search(lost(balanced.node_position_m), -2.5, [0.2, -0.1], late=late)
    assert (np.abs(errors(found, -2.5, [0.2, -0.1])) < 4 * np.sqrt(np.diag(found.covariance))).all()


@pytest.mark.parametrize(
    ("seconds", "late"),
    [(0.4, lambda rng, b: 0.0), (0.6, lambda rng, b: 2.0 * (b < 2))],
    ids=["too_early", "ranges_do_not_fit"],
)
def test_nothing_is_found(balanced, seconds, late) -> None:
    assert search(lost(balanced.node_position_m), 1.0, [0.0, 0.0], seconds=seconds, late=late) is None


def test_ranges_count_as_long_as_the_robot_stands_on_the_same_nodes(balanced) -> None:
    predicted = lost(balanced.node_position_m)
    watch = HeadingSearch(PAIRS, PoseSettings())
    x = predicted.placed.node_position_m
    for k in range(100):
        stands = STANDING if k // 20 % 2 else ~STANDING
        reading = RangeReading(0.02 * k, BEACON_M[k % 4], (0, k % 4, k % 12), 1.0)
        frame = Frame(0.02 * k, 0.02 * k - 0.02, 0.02, x, x, np.eye(36), [], [reading], None)
        assert watch.observe(predicted, frame, stands, FLOOR) is None


def test_robot_feet_and_sensors_are_turned_as_one(balanced) -> None:
    """What each is relative to the robot keeps its error; the errors of heading and place are those of the search."""
    rng = np.random.default_rng(3)
    state = any_state(2, 2)
    root = 0.01 * rng.standard_normal((state.layout.size,) * 2)
    before = Prediction(
        PlacedShape(state, balanced.node_position_m, 1e-8 * np.eye(36)), np.eye(len(root)), root @ root.T, np.zeros(3)
    )
    found = Headed(2.0, np.array([0.2, 0.1]), np.diag([0.04, 0.01, 0.02]))
    after = headed(before, found, FLOOR)
    at = state.layout

    def relative(state_now) -> np.ndarray:
        """What no turn about the vertical and no move along the floor changes."""
        R, p = state_now.turn, state_now.position_m
        feet = np.column_stack([state_now.foothold_m @ FLOOR.axes[:, :2] - p[:2], np.zeros(12)])
        vectors = [R.T @ UP, R.T @ state_now.velocity_m_per_s, R.T @ state_now.rate_rad_per_s, p[2:]]
        return np.concatenate([*vectors, (feet @ R).ravel(), (R.T @ state_now.imu_turn).ravel()])

    def of_relative(predicted: Prediction) -> np.ndarray:
        """The covariance of that, by central differences."""
        H, size = [], predicted.placed.state.layout.size
        for d in 1e-6 * np.eye(size):
            H.append((relative(predicted.placed.state.moved(d)) - relative(predicted.placed.state.moved(-d))) / 2e-6)
        return np.array(H).T @ predicted.covariance @ np.array(H)

    np.testing.assert_allclose(relative(after.placed.state), relative(state), atol=1e-12)
    np.testing.assert_allclose(of_relative(after), of_relative(before), atol=1e-8)
    assert UP @ after.covariance[at.turn, at.turn] @ UP == pytest.approx(0.04)
    of_place = FLOOR.axes @ after.covariance[at.position, at.position] @ FLOOR.axes.T
    np.testing.assert_allclose(of_place, np.diag([0.01, 0.02]), atol=1e-12)
    np.testing.assert_allclose(after.placed.state.turn, rotation(2.0 * UP) @ state.turn)
    np.testing.assert_allclose(
        after.transition @ before.covariance @ after.transition.T, after.covariance - spread(after, found), atol=1e-7
    )


def spread(after: Prediction, found: Headed) -> np.ndarray:
    """Return the covariance that the search adds, D a + M s by definition: feet and sensors turn about p."""
    state = after.placed.state
    away = []
    for d in 1e-6 * np.eye(3):
        turn, moved_m = rotation(d[0] * UP), np.append(d[1:] @ FLOOR.axes[:, :2], 0.0)
        p = state.position_m
        feet = state.foothold_m @ FLOOR.axes - p
        moved = replace(
            state,
            turn=turn @ state.turn,
            position_m=p + moved_m,
            rate_rad_per_s=turn @ state.rate_rad_per_s,
            velocity_m_per_s=turn @ state.velocity_m_per_s,
            foothold_m=(p + feet @ turn.T + moved_m) @ FLOOR.axes.T,
            imu_turn=turn @ state.imu_turn,
        )
        away.append(state.errors_to(moved) / 1e-6)
    J = np.array(away).T
    return J @ found.covariance @ J.T
