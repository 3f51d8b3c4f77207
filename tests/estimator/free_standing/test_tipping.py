"""How a pose tips unseen: derivatives against finite differences, and what is not known after it."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.contacts import Standing
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.prediction import Prediction, heading_direction, without_heading
from tensegraph.estimator.free_standing.tipping import (
    ANY_HEADING_RAD,
    LANDING_RAD_PER_RAD05,
    misplaced,
    rolled_about_one_node,
    tipped,
    tipping,
)
from tensegraph.factors.ground import foothold_rows, height_rows
from tensegraph.models.pose.placed import PlacedShape, stacked
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.values.rotations import rotation, rotation_vector

STATE = any_state(imus=0, pairs=0)
SIZE = STATE.layout.size
BODY_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))
FLOOR = Floor(0.01, np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01))
NO_CAPS = replace(FLOOR, cap_radius_m=0.0)
STANDS = np.isin(np.arange(12), [0, 2, 4])
STAYED = np.isin(np.arange(12), [0, 2])


def prediction(state) -> Prediction:
    placed = PlacedShape(state, BODY_M, 1e-6 * np.eye(36))
    return Prediction(placed, np.eye(SIZE), 1e-6 * np.eye(SIZE), turned=np.zeros(3))


def after_tip(state, stayed=STAYED, floor=NO_CAPS) -> Prediction:
    """Return the prediction tipped onto three nodes."""
    before = prediction(state)
    turn, pivot_m = tipping(before.placed.node_position_m, STANDS, stayed, FLOOR.normal)
    return tipped(before, turn, pivot_m, STANDS, stayed, floor, PoseSettings())


def turned(state, angle: float):
    """Return the state with robot and footholds turned about the floor's normal, through the origin of the world."""
    R = rotation(angle * FLOOR.normal)
    return replace(
        state,
        turn=R @ state.turn,
        position_m=R @ state.position_m,
        rate_rad_per_s=R @ state.rate_rad_per_s,
        velocity_m_per_s=R @ state.velocity_m_per_s,
        foothold_m=state.foothold_m @ FLOOR.axes @ R.T @ FLOOR.axes.T,
    )


def test_the_transition_of_a_tip_is_its_derivative(check_jacobian) -> None:
    after = after_tip(STATE)
    check_jacobian(
        lambda d: after.placed.state.errors_to(after_tip(STATE.moved(d)).placed.state),
        after.transition,
        np.zeros(SIZE),
        step=1e-6,
        tolerance=2e-5,
    )


def test_who_was_turned_wrongly_may_head_and_be_elsewhere() -> None:
    """By hand: wrong by 0.5 rad with the centroid 0.1 m above the floor, 0.5 rad about the normal and 50 mm beside."""
    state = replace(STATE, position_m=(0.01 + 0.1) * FLOOR.normal)
    before = prediction(state)
    after = misplaced(before, 0.5, NO_CAPS)
    added = after.covariance - before.covariance
    at = STATE.layout
    assert added[at.turn, at.turn].diagonal() == pytest.approx((0.5 * FLOOR.normal) ** 2)
    assert added[at.position, at.position].diagonal() == pytest.approx(0.05**2)
    assert after.placed.state.position_m == pytest.approx(state.position_m)


def test_the_direction_of_a_heading_is_the_derivative_of_a_turn(check_jacobian) -> None:
    check_jacobian(
        lambda angle: STATE.errors_to(turned(STATE, float(angle[0]))),
        heading_direction(STATE, FLOOR)[:, None],
        np.zeros(1),
        step=1e-6,
        tolerance=2e-5,
    )


def test_an_error_of_the_heading_is_one_after_a_tip_on_caps() -> None:
    """F N = N' for the pose: a robot that is turned about the normal before a tip is turned so after it."""
    after = after_tip(STATE, floor=FLOOR)
    pose = STATE.layout.pose
    told = (after.transition @ heading_direction(STATE, FLOOR))[pose]
    assert told == pytest.approx(heading_direction(after.placed.state, FLOOR)[pose], abs=1e-9)


def test_a_tip_rolls_on_the_caps_of_the_feet_that_stay() -> None:
    """By hand: the mean of the feet moves by r phi x n, 10 mm times the angle."""
    before, after = prediction(STATE).placed, after_tip(STATE, floor=FLOOR).placed
    moved_m = (after.node_position_m - before.node_position_m)[STAYED].mean(axis=0)
    phi = rotation_vector(after.state.turn @ before.state.turn.T)
    assert moved_m == pytest.approx(0.01 * np.cross(phi, FLOOR.normal))


def test_a_robot_that_has_rolled_over_several_faces_heads_anywhere() -> None:
    after = after_tip(STATE, stayed=np.zeros(12, dtype=np.bool_))
    turn = after.covariance[STATE.layout.turn, STATE.layout.turn]
    assert FLOOR.normal @ turn @ FLOOR.normal == pytest.approx(ANY_HEADING_RAD**2, rel=1e-3)


def test_a_robot_that_has_rolled_about_one_node_may_head_either_way_round_it() -> None:
    """By hand: heading and place are as uncertain as after a turn by its angle, onto a face that shares no edge."""
    one = np.isin(np.arange(12), [2])
    after = after_tip(STATE, stayed=one)
    angle = np.linalg.norm(rotation_vector(after.placed.state.turn @ STATE.turn.T))
    turn = after.covariance[STATE.layout.turn, STATE.layout.turn]
    assert FLOOR.normal @ turn @ FLOOR.normal == pytest.approx(angle**2, rel=1e-3)
    assert [rolled_about_one_node(STANDS, stayed) for stayed in (one, STAYED)] == [True, False]
    two = np.isin(np.arange(12), [0, 2])  # an edge, onto which it tips about one of its nodes
    assert not rolled_about_one_node(two, one)


@pytest.mark.parametrize("floor_m", [0.0, 1.0, -0.3])
def test_it_has_rolled_by_its_height_above_the_floor_wherever_the_floor_is(floor_m) -> None:
    """By hand: a centroid 0.2 m above the centres of caps of 10 mm rolls by 0.21 m times the angle, per axis."""
    state = replace(STATE, position_m=np.array([0.4, -0.7, floor_m + 0.21]))
    turn, nothing = rotation(np.array([0.9, 0.0, 0.0])), np.zeros(12, dtype=np.bool_)
    floor = Floor(floor_m + 0.01, UP)
    after = tipped(prediction(state), turn, state.position_m, STANDS, nothing, floor, PoseSettings())
    place = STATE.layout.position
    assert after.covariance[place, place] == pytest.approx((0.21 * 0.9) ** 2 * np.eye(3), abs=1e-5)


def test_what_the_floor_tells_says_nothing_of_the_heading() -> None:
    """Feet are 20 mm from where they stood: linearised there, they would tell the heading."""
    nodes = np.flatnonzero(STANDS)
    after = after_tip(STATE)
    foothold_m = after.placed.node_position_m @ FLOOR.axes.T + np.array([0.02, 0.0])
    placed = PlacedShape(replace(after.placed.state, foothold_m=foothold_m), BODY_M, 1e-6 * np.eye(36))
    N = heading_direction(placed.state, FLOOR)
    before = replace(after, placed=placed, covariance=1e-6 * np.eye(SIZE) + np.outer(N, N))
    rows = stacked(
        [
            height_rows(placed, FLOOR, nodes, 5e-4, 1.0),
            foothold_rows(placed, FLOOR, nodes, np.zeros(3), 5e-4),
        ]
    )
    heading = np.zeros(SIZE)
    heading[STATE.layout.turn] = FLOOR.normal
    _, told = before.corrected(rows)
    rows = without_heading(rows, placed.state, FLOOR)
    _, untold = before.corrected_blindly(rows, FLOOR)
    assert heading @ told @ heading < 0.1
    assert heading @ untold @ heading == pytest.approx(1.0, abs=1e-5)
    state, covariance = before.corrected(rows)
    J = np.eye(SIZE) + np.outer(heading_direction(state, FLOOR) - N, heading)
    np.testing.assert_allclose(untold, J @ covariance @ J.T, atol=1e-12)


def test_the_heading_walks_with_every_tip_and_stays_as_uncertain_at_rest(balanced) -> None:
    """By hand: four tips to and fro over one edge, each by the angle a, leave 4 * 0.14^2 a of variance; feet creep."""
    floor = Floor(float(balanced.node_position_m[0, 2]), UP)
    poses = PoseFilter(balanced, FreeStandingRobot(floor=floor, rest_seconds=0.2), PoseSettings())
    x, base = balanced.node_position_m, np.isin(np.arange(12), [0, 1, 2])
    turn, _ = tipping(x, STANDS, STAYED, UP)
    variances = []
    for k in range(300):
        nodes = STANDS if (k // 60) % 2 else base
        step = poses.step(0.02 * k, x, 1e-8 * np.eye(36), (), Standing(nodes, nodes.astype(np.float64)))
        variances.append(step.covariance[2, 2])
    walked = LANDING_RAD_PER_RAD05**2 * np.linalg.norm(rotation_vector(turn))
    assert variances[-1] - variances[59] == pytest.approx(4 * walked, rel=0.05)
    assert (np.diff(variances)[61:119] > -1e-5).all()


def test_a_robot_that_stands_on_nodes_on_both_sides_of_its_middle_turns_no_further() -> None:
    """The middle of all nodes is their centroid; so is the middle of two opposite ones of a box, wherever it is."""
    box_m = np.array(np.meshgrid([-0.1, 0.1], [-0.2, 0.2], [-0.1, 0.1])).reshape(3, -1).T
    rng = np.random.default_rng(3)
    for _ in range(20):
        turned_m = box_m @ rotation(rng.normal(size=3)).T + rng.normal(size=3)
        for stands in (np.ones(8, dtype=bool), np.isin(np.arange(8), [0, 7])):
            turn, pivot_m = tipping(turned_m, stands, stands, UP)
            np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
            np.testing.assert_allclose(pivot_m, turned_m.mean(axis=0), atol=1e-12)
        np.testing.assert_allclose(turn, np.eye(3), atol=1e-12)
