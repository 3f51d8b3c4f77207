"""Which nodes the floor carries, by their heights."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.contacts import ContactsByHeight, Standing, may_have_landed
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import UP, Floor


def observe(
    contacts: ContactsByHeight, height_m: np.ndarray, frames: int = 1, tilt_rad: float = 0.001, **seen: bool
) -> np.ndarray:
    """Return which nodes stand after some frames with the nodes at these heights, and this sigma of the attitude."""
    state = replace(any_state(0, 0), turn=np.eye(3), position_m=np.zeros(3))
    body_m = np.column_stack([np.arange(12) * 0.02, np.zeros(12), height_m])
    placed = PlacedShape(state, body_m, 1e-8 * np.eye(36))
    covariance = 1e-6 * np.eye(state.layout.size)
    covariance[state.layout.turn, state.layout.turn] = tilt_rad**2 * np.eye(3)
    for _ in range(frames):
        standing = contacts.observe(placed, covariance, 0.02, **seen)
    return np.flatnonzero(standing.nodes)


def test_a_node_that_rises_is_lifted_and_one_that_lands_stands() -> None:
    start = np.arange(12) < 3
    contacts = ContactsByHeight(Floor(0.0, UP), start, PoseSettings())
    height_m = np.where(start, 0.0, 0.1)
    assert observe(contacts, height_m, 5).tolist() == [0, 1, 2]
    height_m[0] = 0.03
    assert observe(contacts, height_m, 5).tolist() == [1, 2]
    height_m[7] = 0.0
    assert observe(contacts, height_m, 5).tolist() == [1, 2, 7]


@pytest.mark.parametrize(("tilt_rad", "stand"), [(0.003, [0, 11]), (0.05, [0])])
def test_frames_of_an_uncertain_attitude_do_not_add_up(tilt_rad, stand) -> None:
    """A node is 1 mm above another, 0.22 m beside it, as is known to 0.7 or 11 mm, for ten frames."""
    contacts = ContactsByHeight(Floor(0.0, UP), np.arange(12) < 1, PoseSettings())
    height_m = np.where(np.arange(12) < 1, 0.0, 0.1)
    height_m[11] = 0.001
    assert observe(contacts, height_m, 10, tilt_rad).tolist() == stand


def test_the_lowest_node_stands_unless_the_robot_is_seen_to_be_lifted() -> None:
    """50 mm above the floor nothing stands, if positions tell where the robot is; else the pose is wrong by as much."""
    contacts = ContactsByHeight(Floor(0.0, UP), np.arange(12) < 3, PoseSettings())
    assert observe(contacts, 0.05 + 0.02 * np.arange(12.0), 20).tolist() == [0]
    assert observe(contacts, 0.05 + 0.02 * np.arange(12.0), 20, is_located=True).tolist() == []
    assert observe(contacts, 0.004 + 0.02 * np.arange(12.0), 20, is_located=True).tolist() == [0]


def test_nothing_stands_while_the_robot_flies() -> None:
    """It is on the floor as heights tell, and weighs nothing; then one node lands, and the others after it."""
    contacts = ContactsByHeight(Floor(0.0, UP), np.arange(12) < 3, PoseSettings())
    height_m = np.where(np.arange(12) < 3, 0.0, 0.1)
    assert observe(contacts, height_m, flies=True).tolist() == []
    assert observe(contacts, height_m).tolist() == [0]
    assert observe(contacts, height_m, 5).tolist() == [0, 1, 2]


def test_the_probability_of_nodes_is_that_of_the_faces_that_have_them() -> None:
    """Of three faces, 0 1 2 with 0.5, 0 1 3 with 0.3 and 4 5 6 with 0.2: 0 1 stand with 0.8, 0 4 with none."""
    faces = [np.isin(np.arange(12), nodes) for nodes in ([0, 1, 2], [0, 1, 3], [4, 5, 6])]
    standing = Standing(faces[0], np.zeros(12), ((0.3, faces[1]), (0.2, faces[2])))
    assert abs(standing.probability_of(np.isin(np.arange(12), [0, 1])) - 0.8) < 1e-12
    assert abs(standing.probability_of(faces[2]) - 0.2) < 1e-12
    assert standing.probability_of(np.isin(np.arange(12), [0, 4])) == 0.0


@pytest.mark.parametrize(
    ("limit", "told", "ratio"),
    [(3.0, [0, 1], 3), (1.7, [0, 1, 3], 4), (1.3, None, None)],
)
def test_the_likeliest_other_face_or_edge_is_told_where_it_is_about_as_probable(limit, told, ratio) -> None:
    """Of 0 1 2 with 0.6, the edge 0 1 with 0.2, 0 1 3 with 0.15 and 0 2 4 with 0.05: an edge has a lower limit."""
    sets = [np.isin(np.arange(12), nodes) for nodes in ([0, 1, 2], [0, 1], [0, 1, 3], [0, 2, 4])]
    standing = Standing(sets[0], np.zeros(12), tuple(zip((0.2, 0.15, 0.05), sets[1:], strict=True)))
    other = standing.likeliest_other(limit)
    if told is None:
        assert other is None
        return
    log_ratio, nodes = other
    assert abs(log_ratio - np.log(ratio)) < 1e-12
    assert np.flatnonzero(nodes).tolist() == told


@pytest.mark.parametrize(
    ("height_m", "sinks_m_per_s", "lands"),
    [(0.015, 0.0, True), (0.025, 0.0, False), (0.0, -0.15, True), (0.0, -0.25, False), (-0.1, 0.0, True)],
)
def test_a_robot_lands_where_height_and_speed_may_be_zero(height_m: float, sinks_m_per_s: float, lands: bool) -> None:
    """Standard deviations of 10 mm and 0.1 m/s: two of them are 20 mm or 0.2 m/s. Below the floor it stands."""
    velocity = np.array([0.0, 0.0, sinks_m_per_s])
    state = replace(any_state(0, 0), turn=np.eye(3), position_m=height_m * UP, velocity_m_per_s=velocity)
    placed = PlacedShape(state, np.zeros((12, 3)), 1e-12 * np.eye(36))
    variance = np.zeros(state.layout.size)
    variance[state.layout.position], variance[state.layout.velocity] = 0.01**2, 0.1**2
    assert may_have_landed(placed, np.diag(variance), Floor(0.0, UP)) == lands


@pytest.mark.parametrize(
    ("along_m_per_s", "rate_rad_per_s", "lands"), [(0.3, 0.0, False), (0.15, 0.0, True), (0.3, 3.0, True)]
)
def test_a_robot_lands_where_its_lowest_node_may_be_at_rest(along_m_per_s, rate_rad_per_s, lands) -> None:
    """It glides, or rolls: at 3 rad/s about the lowest node, which is 0.1 m below the centroid, this one rests."""
    state = replace(
        any_state(0, 0),
        turn=np.eye(3),
        position_m=0.1 * UP,
        velocity_m_per_s=np.array([along_m_per_s, 0.0, 0.0]),
        rate_rad_per_s=np.array([0.0, rate_rad_per_s, 0.0]),
    )
    placed = PlacedShape(state, np.tile(-0.1 * UP, (12, 1)), 1e-12 * np.eye(36))
    variance = np.zeros(state.layout.size)
    variance[state.layout.position], variance[state.layout.velocity] = 0.01**2, 0.1**2
    assert may_have_landed(placed, np.diag(variance), Floor(0.0, UP)) == lands


def test_a_lifted_robot_at_the_floor_stands_once_it_has_come_down() -> None:
    contacts = ContactsByHeight(Floor(0.0, UP), np.arange(12) < 3, PoseSettings())
    state = replace(any_state(0, 0), turn=np.eye(3), position_m=np.zeros(3), velocity_m_per_s=np.zeros(3))
    placed = PlacedShape(replace(state, rate_rad_per_s=np.zeros(3)), np.zeros((12, 3)), 1e-8 * np.eye(36))
    covariance = 1e-6 * np.eye(state.layout.size)
    for has_come_down in (False, True):
        standing = contacts.observe(placed, covariance, 0.02, is_lifted=True, has_come_down=has_come_down)
        assert standing.nodes.any() == has_come_down
