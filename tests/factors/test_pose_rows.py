"""The rows of each aid: errors worked by hand, and Jacobians against finite differences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.watches.jump_watch import common_misfit
from tensegraph.factors.anchor import anchor_rows
from tensegraph.factors.ground import foothold_rows, height_rows
from tensegraph.factors.imu import ImuArray
from tensegraph.factors.position import position_rows
from tensegraph.factors.range import range_rows
from tensegraph.factors.torque import torque_rows
from tensegraph.models.pose.imu_samples import ImuSamples
from tensegraph.models.pose.placed import PlacedShape, Rows
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.suspension import Suspension
from tensegraph.models.values.aids import Imu, OwnFrame, PositionReading, RangeReading
from tensegraph.models.values.rotations import rotation, rotation_vector

STATE = any_state(imus=2, pairs=2, tilts=2, own_frames=2)
SIZE = STATE.layout.size
BODY_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))
FLOOR = Floor(0.01, np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01), 0.17, np.array([0.2, -0.1, 0.0]))
RODS = np.array([[0, 3], [4, 5], [1, 6], [7, 8], [2, 9], [10, 11]])
SHARE = np.full(12, 1 / 12)
IMUS = ImuArray([Imu(0, 0.5, np.array([0.0, 0, 1])), Imu(3, 0.2, np.array([0.6, 0, 0.8]))], RODS)
BEFORE = STATE.turn @ np.linalg.inv(any_state(0, 0).turn)
NODES = np.array([2, 5, 6])
BALL = Suspension(np.zeros(3), np.eye(3)[:2], SHARE)
HINGE = Suspension(np.zeros(3), np.array([[0.8, 0.6, 0.0]]), SHARE)
LEVER_M = np.array([0.03, -0.02, -0.16])
HANDS_M = np.array([0.02, 0.05, -0.01])
FRAME = OwnFrame(1, np.eye(3), np.zeros(3), np.array([0.4, -1.0, 0.2]), np.tril(np.full((6, 6), 0.003)))


def placed(state=STATE) -> PlacedShape:
    return PlacedShape(state, BODY_M, 1e-6 * np.eye(36))


def slow_samples() -> ImuSamples:
    force = np.einsum("iba,b->ia", STATE.imu_turn, 9.81 * UP) + STATE.force_bias_m_per_s2
    none = np.zeros(2, dtype=np.bool_)
    return ImuSamples(
        STATE.rate_bias_rad_per_s,
        force,
        np.array([2, 2]),
        none,
        np.full(2, 0.02),
        rate_is_cut_off=none,
        force_is_cut_off=none,
    )


def direction_in_the_first_axes(state) -> Rows:
    """The rows of directions, whose axes across the rods are those at STATE: others have the same length only."""
    rows = IMUS.direction_rows(placed(state), 1.0, np.arange(2))
    first, second = IMUS.ends.T

    def across(at):
        along = (BODY_M[second] - BODY_M[first]) @ at.turn.T
        u = along / np.linalg.norm(along, axis=1)[:, None]
        return u, np.swapaxes(np.linalg.svd(u[:, :, None])[0][:, :, 1:], 1, 2)

    u, _ = across(state)
    _, fixed = across(STATE)
    error = np.einsum("iab,ib->ia", fixed, u - IMUS.direction(state))
    return Rows(error.ravel(), rows.jacobian, rows.variance)


def turned_ball(state) -> Suspension:
    """The level axes turn with the structure about the vertical."""
    heading = rotation_vector(state.turn @ STATE.turn.T)[2]
    return Suspension(np.zeros(3), BALL.axes @ rotation(np.array([0, 0, heading])).T, SHARE)


ROWS: dict[str, Callable[..., Rows]] = {
    "height": lambda state: height_rows(placed(state), FLOOR, NODES, 5e-4, 1.0),
    "foothold": lambda state: foothold_rows(
        placed(state), FLOOR, NODES, rotation_vector(state.turn @ STATE.turn.T), 5e-4
    ),
    "direction": direction_in_the_first_axes,
    "gravity": lambda state: IMUS.gravity_rows(state, slow_samples(), PoseSettings()),
    "rate at rest": lambda state: IMUS.rest_rows(state, slow_samples()),
    "range": lambda state: range_rows(
        placed(state),
        [RangeReading(0.0, np.array([2.0, 1, 1]), (0, 0, 4), 2.4)],
        {(0, 0, 4): (1, 0)},
        np.eye(SIZE),
        0.05,
    )[0],
    "position": lambda state: position_rows(
        placed(state), [PositionReading(0.0, 3, np.array([0.1, 0.2, 0.3]))], 0.017, 5e-4
    ),
    "position in its own frame": lambda state: position_rows(
        placed(state), [PositionReading(0.0, 3, np.array([0.1, 0.2, 0.3]), 0, FRAME)], 0.017, 5e-4
    ),
    "anchor": lambda state: anchor_rows(placed(state), NODES[:2], np.zeros((2, 3)), 1e-4),
    "torque about a ball": lambda state: torque_rows(placed(state), turned_ball(state), LEVER_M, HANDS_M, np.eye(3)),
    "torque about a hinge": lambda state: torque_rows(placed(state), HINGE, LEVER_M, HANDS_M, np.eye(3)),
}


@pytest.mark.parametrize("name", ROWS)
def test_the_jacobian_is_that_of_the_predicted_value(name, check_jacobian) -> None:
    """error = measured - predicted, so that its derivative is minus the Jacobian."""
    rows = ROWS[name](STATE)
    assert len(rows.error) == len(rows.variance) > 0
    check_jacobian(
        lambda d: -ROWS[name](STATE.moved(d)).error, rows.jacobian, np.zeros(SIZE), step=1e-6, tolerance=2e-5
    )


def test_a_node_on_the_floor_has_no_error_of_height() -> None:
    """By hand: raised by 3 mm along the normal, its row says -3 mm."""
    shape = placed(any_state(imus=2, pairs=2))
    lowest = int(np.argmin(shape.node_position_m @ FLOOR.normal))
    floor = Floor(float(shape.node_position_m[lowest] @ FLOOR.normal) - 0.003, FLOOR.normal)
    rows = height_rows(shape, floor, np.array([lowest]), 5e-4, 1.0)
    assert rows.error == pytest.approx([-0.003])


def test_a_cap_rolls_by_its_radius_times_the_turn(check_jacobian) -> None:
    """By hand: turned by 0.1 rad about y on level ground, the centre of a cap of 10 mm moves by 1 mm along x."""
    floor = Floor(0.0, UP)
    at = placed().node_position_m[NODES] @ floor.axes.T
    state = any_state(2, 2, own_frames=2)
    moved_m = np.array([0.001, 0.0, 0.0]) @ floor.axes.T
    foothold_m = state.foothold_m.copy()
    foothold_m[NODES] = at - moved_m
    rows = foothold_rows(placed(replace(state, foothold_m=foothold_m)), floor, NODES, np.array([0, 0.1, 0]), 5e-4)
    assert rows.error == pytest.approx(0, abs=1e-12)


def test_a_position_is_that_of_its_own_time() -> None:
    """By hand: a body at 1 m/s along x that turns at 2 rad/s about z; 10 ms ago a node 0.1 m along x was elsewhere."""
    state = replace(STATE, turn=np.eye(3), velocity_m_per_s=np.array([1.0, 0, 0]), rate_rad_per_s=np.array([0, 0, 2.0]))
    shape = PlacedShape(state, np.tile([0.1, 0.0, 0.0], (12, 1)), np.zeros((36, 36)))
    measured_m = state.position_m + np.array([0.09, -0.002, 0.0])
    assert position_rows(shape, [PositionReading(0.99, 3, measured_m)], 1.0, 5e-4).error == pytest.approx(0, abs=1e-12)


def test_a_frame_that_is_turned_moves_a_position_by_its_lever() -> None:
    """By hand: turned by 2 mrad about z at 0.5 m along x from the pivot, a reading is 1 mm further along y."""
    frame = OwnFrame(0, np.eye(3), np.zeros(3), STATE.position_m - np.array([0.5, 0, 0]), 0.002 * np.eye(6))
    state = replace(STATE, own_frame_error=np.array([[0, 0, 1.0, 0, 0, 0]]))
    shape = PlacedShape(state, np.zeros((12, 3)), np.zeros((36, 36)))
    rows = position_rows(shape, [PositionReading(1.0, 3, state.position_m, 0, frame)], 1.0, 5e-4)
    assert rows.error == pytest.approx([0, 0.001, 0], abs=1e-12)


def test_a_range_is_as_uncertain_as_its_node_in_the_shape() -> None:
    """Beside the noise, the variance of the node's coordinate towards the beacon."""
    shape = placed()
    beacon_m = shape.node_position_m[4] + np.array([0.0, 3.0, 0.0])
    reading = RangeReading(0.0, beacon_m, (0, 0, 4), 3.0)
    rows, _ = range_rows(shape, [reading], {(0, 0, 4): (1, 0)}, 1e-4 * np.eye(SIZE), 0.05)
    assert shape.node_covariance_m2[4, 1, 1] > 0
    assert rows.variance == pytest.approx(0.05**2 + shape.node_covariance_m2[4, 1, 1])


def test_a_range_that_a_wall_reflects_is_left_out() -> None:
    reading = RangeReading(0.0, np.array([2.0, 1, 1]), (0, 0, 4), 9.0)
    rows, outliers = range_rows(placed(), [reading], {(0, 0, 4): (1, 0)}, 1e-4 * np.eye(SIZE), 0.05)
    assert len(rows.error) == 0
    assert outliers == [reading]


def test_the_attitude_at_rest_points_the_rod_and_gravity() -> None:
    """The turn about the rod, which nobody tells, comes from the specific force."""
    direction = np.array([[0.6, 0, 0.8], [0, 0.6, 0.8]])
    turn = np.array([np.eye(3), np.eye(3)])
    force = np.array([[3.0, 1.0, 9.0], [2.0, 0.5, 9.0]])
    turn = IMUS.attitude_at_rest(direction, force)
    assert np.einsum("iab,ib->ia", turn, IMUS.axis) == pytest.approx(direction)
    sideways = np.einsum("iab,ib->ia", turn, force)
    across = sideways - direction * np.sum(sideways * direction, axis=1)[:, None]
    up = UP - direction * direction[:, 2:]
    assert np.cross(across, up) == pytest.approx(0, abs=1e-9)
    assert (np.sum(across * up, axis=1) > 0).all()


def test_a_rod_points_from_its_first_end_to_its_second() -> None:
    imus = ImuArray([Imu(1, 0.5, np.array([0.0, 0, 1]))], np.array([[0, 1], [3, 2]]))
    nodes_m = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 0.4, 0], [0, 0, 0]])
    np.testing.assert_allclose(imus.rod_m(nodes_m), [[0.3, 0.4, 0]])
    np.testing.assert_allclose(imus.rod_direction(nodes_m), [[0.6, 0.8, 0]])


def test_positions_that_are_off_alike() -> None:
    """By hand: two nodes 3 mm off along x, a body known to 0.6 mm that may move 0.8 mm: (3 / 1)^2; off apart: 0."""
    x = placed().node_position_m
    variance = np.zeros(SIZE)
    variance[STATE.layout.position] = 0.0006**2
    shift_m = np.array([0.003, 0.0, 0.0])
    shape = PlacedShape(STATE, BODY_M, 1e-14 * np.eye(36))

    def misfit(signs: tuple[int, int]) -> float:
        read_m = {2: x[2] + signs[0] * shift_m, 5: x[5] + signs[1] * shift_m}
        readings = [PositionReading(0.0, node, position_m) for node, position_m in read_m.items()]
        return common_misfit(position_rows(shape, readings, 0.0, 1e-6), np.diag(variance), 0.0008)

    assert misfit((1, 1)) == pytest.approx(9.0, rel=1e-3)
    assert misfit((1, -1)) == pytest.approx(0.0, abs=1e-6)
