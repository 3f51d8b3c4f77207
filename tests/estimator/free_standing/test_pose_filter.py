"""The pose filter and its smoother."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.estimator.free_standing.contacts import Standing, nothing_stands
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.pose_smoother import contradiction, smoothed_poses
from tensegraph.estimator.free_standing.prediction import heading_direction
from tensegraph.estimator.free_standing.tipping import ANY_HEADING_RAD, tipping
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import Imu, ImuReading, OwnFrame, PositionReading
from tensegraph.models.values.rotations import rotation, rotation_vector

EXACT_M2 = 1e-10 * np.eye(36)


@pytest.fixture
def robot(balanced) -> FreeStandingRobot:
    return FreeStandingRobot(floor=Floor(float(balanced.node_position_m[0, 2]), UP), rest_seconds=0.2)


def test_a_structure_that_stands_still_stays(balanced, robot) -> None:
    poses = PoseFilter(balanced, robot, PoseSettings())
    for k in range(100):
        step = poses.step(0.02 * k, balanced.node_position_m, EXACT_M2, ())
    assert step.state.turn == pytest.approx(np.eye(3), abs=1e-4)
    assert step.state.position_m == pytest.approx(poses.centre_m, abs=1e-4)
    assert np.flatnonzero(step.standing.nodes).tolist() == [0, 1, 2]


def test_positions_of_three_nodes_move_it(balanced, robot) -> None:
    """Noiseless recovery: it is carried through the air, and found to within a millimetre and a third of a degree."""
    turn, shift_m = rotation(np.array([0.2, -0.1, 0.5])), np.array([0.3, -0.2, 0.1])
    poses = PoseFilter(balanced, robot, PoseSettings())
    x = balanced.node_position_m
    for k in range(150):
        share = min(max((k - 20) / 80, 0.0), 1.0)
        true_m = (
            (x - poses.centre_m) @ rotation(share * np.array([0.2, -0.1, 0.5])).T + poses.centre_m + share * shift_m
        )
        aids = [PositionReading(0.02 * k, node, true_m[node]) for node in (3, 5, 8, 11)]
        step = poses.step(0.02 * k, x, EXACT_M2, aids)
    node_m = PlacedShape(step.state, x - poses.centre_m, np.zeros((36, 36))).node_position_m
    assert node_m == pytest.approx(true_m, abs=1e-3)
    assert step.state.turn == pytest.approx(turn, abs=0.006)


@pytest.mark.parametrize(
    ("turn_sigmas", "shift_sigmas", "contradicts"),
    [(0.0, 0.0, False), (5.0, 0.0, False), (0.0, 5.0, False), (7.0, 0.0, True), (0.0, 7.0, True)],
)
def test_a_smoothed_pose_beyond_six_sigmas_contradicts_the_filter(
    balanced, robot, turn_sigmas, shift_sigmas, contradicts
) -> None:
    """Along an axis, of standard deviations that are those of the filter and 0.001 rad and m."""
    step = PoseFilter(balanced, robot, PoseSettings()).step(0.0, balanced.node_position_m, EXACT_M2, ())
    at, errors = step.state.layout, np.zeros(step.state.layout.size)
    covariance = step.covariance.copy()
    for part, sigma, sigmas in ((at.turn, 0.01, turn_sigmas), (at.position, 0.02, shift_sigmas)):
        covariance[part, part] = (sigma**2 - 1e-6) * np.eye(3)
        errors[part] = [0.0, sigmas * sigma, 0.0]
    found = contradiction(replace(step, covariance=covariance), step.state.moved(errors))
    assert (found is not None) == contradicts
    assert found is None or found == pytest.approx(errors, abs=1e-9)


@pytest.mark.parametrize("is_told", [False, True])
def test_a_robot_that_positions_follow_through_the_air_does_not_stray(balanced, robot, is_told: bool) -> None:
    """By heights as it is live, or told to be in the air, as it is in batch; carried by 1 m, four times its length."""
    poses, x = PoseFilter(balanced, robot, PoseSettings()), balanced.node_position_m
    steps = []
    for k in range(150):
        t_s, true_m = 0.02 * k, x + min(max((k - 20) / 100, 0.0), 1.0) * np.array([1.0, 0.0, 0.2])
        aids = [PositionReading(t_s, node, true_m[node]) for node in (3, 5, 8, 11)]
        steps.append(poses.step(t_s, x, EXACT_M2, aids, nothing_stands(12) if is_told and k >= 25 else None))
    assert not any(step.strays for step in steps)
    assert steps[-1].state.position_m == pytest.approx(poses.centre_m + np.array([1.0, 0.0, 0.2]), abs=1e-3)


def test_a_frame_that_is_wrong_is_in_the_ellipsoids(balanced, robot) -> None:
    """Carried 1 m away, by positions in a frame that is turned by two sigma of 4 mrad more than is told.

    However often they are read, the frame stays as uncertain as it was, and so do the nodes: 4 mm each sigma, across.
    """
    robot = replace(robot, own_frames=1)
    poses, x = PoseFilter(balanced, robot, PoseSettings()), balanced.node_position_m
    root = np.diag([0.004, 0.004, 0.004, 1e-4, 1e-4, 1e-4])
    frame = OwnFrame(0, np.eye(3), np.zeros(3), poses.centre_m, root)
    wrong = rotation(np.array([0, 0, -0.008]))
    for k in range(200):
        true_m = x + min(max((k - 20) / 100, 0.0), 1.0) * np.array([1.0, 0, 0.2])
        read_m = (true_m - poses.centre_m) @ wrong.T + poses.centre_m
        aids = [PositionReading(0.02 * k, node, read_m[node], 0, frame) for node in (3, 5, 8, 11)] if k > 9 else []
        step = poses.step(0.02 * k, x, EXACT_M2, aids)
    own = step.state.layout.own_frame
    assert step.covariance[own, own] == pytest.approx(np.eye(6))
    assert not step.state.own_frame_error.any()
    sigma_m = np.sqrt(np.diag(step.covariance)[step.state.layout.position])
    assert sigma_m[1] == pytest.approx(0.004, rel=0.1)
    assert step.state.position_m - poses.centre_m == pytest.approx([1.0, -0.008, 0.2], abs=0.001)


def test_a_node_that_positions_lift_is_not_held_by_the_floor(balanced, robot) -> None:
    """It tips over the edge 0 2 at 0.3 rad/s, seen at nodes 0 and 8, 60 times a second: node 1 leaves the floor.

    Were contacts told before positions are used, the floor would hold node 1 until it is 10 mm high.
    """
    poses = PoseFilter(balanced, robot, PoseSettings())
    x = balanced.node_position_m
    edge = (x[2] - x[0]) / np.linalg.norm(x[2] - x[0])
    outward = np.sign((np.cross(edge, x[1] - x[0])) @ UP)

    def at(t_s: float) -> np.ndarray:
        return (x - x[0]) @ rotation(0.3 * outward * max(t_s - 0.4, 0.0) * edge).T + x[0]

    aids = [PositionReading(t_s, node, at(t_s)[node]) for t_s in np.arange(0, 1, 1 / 60) for node in (0, 8)]
    for k in range(29):
        now = [reading for reading in aids if 0.02 * (k - 1) < reading.t_s <= 0.02 * k]
        step = poses.step(0.02 * k, x, EXACT_M2, now)
    assert not step.standing.nodes[1]
    node_m = PlacedShape(step.state, x - poses.centre_m, np.zeros((36, 36))).node_position_m
    assert node_m == pytest.approx(at(0.56), abs=0.004)


def test_a_copy_that_is_more_certain_than_the_filter_leaves_no_negative_variance(balanced, robot) -> None:
    """By hand: 1 m^2 before, carried on; the copy that takes over has 0.04 m^2, and is known to 0.01 m^2 later.

    With P- = F P F^T = 1, as no noise is negative, P_k = 1 + (0.01 - 1) = 0.01; with 0.04 it would be 1 - 25 * 0.03.
    """
    poses = PoseFilter(balanced, robot, PoseSettings())
    step = poses.step(0.0, balanced.node_position_m, EXACT_M2, ())
    size, place = len(step.covariance), step.state.layout.position.start
    before, predicted, after = (1e-6 * np.eye(size) for _ in range(3))
    before[place, place], predicted[place, place], after[place, place] = 1.0, 0.04, 0.01
    now = replace(step, covariance=before)
    later = replace(step, transition=np.eye(size), predicted_covariance=predicted, covariance=after)
    _, smoothed = smoothed_poses([now, later])[0]
    assert smoothed[place, place] == pytest.approx(0.01)
    assert np.linalg.eigvalsh(smoothed)[0] > 0


def test_the_smoother_is_no_less_certain_than_the_filter(balanced, robot) -> None:
    poses = PoseFilter(balanced, robot, PoseSettings())
    x = balanced.node_position_m
    steps = [poses.step(0.02 * k, x, EXACT_M2, ()) for k in range(60)]
    states = smoothed_poses(steps)
    assert states[-1][0] is steps[-1].state
    for step, (_, covariance) in zip(steps, states, strict=True):
        assert (np.diag(covariance)[:6] <= np.diag(step.covariance)[:6] * 1.001).all()


def test_tipping_puts_a_face_on_the_floor(balanced) -> None:
    """The face 0, 2 and another node beside the base comes to lie level; 0 and 2 stay on the floor."""
    x = balanced.node_position_m
    stands, stayed = np.zeros(12, dtype=bool), np.zeros(12, dtype=bool)
    stands[[0, 2, 4]] = True
    stayed[[0, 2]] = True
    turn, pivot_m = tipping(x, stands, stayed, UP)
    after = (x - pivot_m) @ turn.T + pivot_m
    assert np.ptp(after[stands, 2]) == pytest.approx(0, abs=1e-9)
    assert after[stands, 2].mean() < after[~stands, 2].min()
    assert after[[0, 2]].mean(axis=0) == pytest.approx(x[[0, 2]].mean(axis=0))


def attitude(direction: np.ndarray) -> np.ndarray:
    """Return (3, 3) a turn that lays the sensor's third axis along a rod."""
    aside = np.cross(direction, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(direction, aside), direction], axis=1)


def test_a_robot_that_hops_is_followed_through_the_air(balanced, robot) -> None:
    """Thrown up for two frames, it flies for ten, in which a hand moves it by 77 mm, and two frames stop it."""
    structure, x = balanced.structure, balanced.node_position_m
    robot = replace(robot, imus=tuple(Imu(rod, 0.5, np.array([0.0, 0.0, 1.0])) for rod in range(len(structure.rods))))
    along = x[structure.rods[:, 1]] - x[structure.rods[:, 0]]
    mounted = np.array([attitude(d / np.linalg.norm(d)) for d in along])
    up, aside = GRAVITY_M_PER_S2 * UP, np.array([12.0, 0.0, 0.0])
    parts = ((25, 0 * up), (27, 2.5 * up), (29, aside - up), (35, -up), (37, -aside - up), (39, 2.5 * up))
    poses, true_m, velocity_m_per_s = PoseFilter(balanced, robot, PoseSettings()), np.zeros(3), np.zeros(3)
    stood = []
    for k in range(60):
        a_m_per_s2 = next((a for until, a in parts if k < until), 0 * up)
        true_m = true_m + 0.02 * (velocity_m_per_s + 0.01 * a_m_per_s2)
        velocity_m_per_s = velocity_m_per_s + 0.02 * a_m_per_s2
        aids = [ImuReading(i, 0.02 * k, np.zeros(3), turn.T @ (a_m_per_s2 + up)) for i, turn in enumerate(mounted)]
        step = poses.step(0.02 * k, x, EXACT_M2, aids)
        stood.append(np.flatnonzero(step.standing.nodes).tolist())
    assert true_m == pytest.approx([0.0768, 0.0, 0.0], abs=1e-4)
    assert step.state.position_m - poses.centre_m == pytest.approx(true_m, abs=0.002)
    assert stood[27:37] == [[]] * 10
    assert stood[:27] + stood[39:] == [[0, 1, 2]] * 48


def test_after_a_gap_of_months_the_covariance_is_still_one(balanced, robot) -> None:
    poses = PoseFilter(balanced, robot, PoseSettings())
    for t_s in (0.0, 0.02, 1e7, 1e7 + 0.02):
        step = poses.step(t_s, balanced.node_position_m, EXACT_M2, ())
    assert np.linalg.eigvalsh(step.covariance).min() > 0


def carried(balanced, robot, silent) -> tuple[PoseFilter, list, np.ndarray]:
    """Carry a robot with two sensors through the air by a turn of 0.7 rad, as some nodes are seen to move.

    Args:
        balanced: the rest shape.
        robot: without sensors.
        silent: function of frame and sensor that says which samples are missing.

    Returns:
        The filter, its steps, and (2, 3, 3) the true attitudes of the sensors in the end.
    """
    rods = (0, 2)
    robot = replace(robot, imus=tuple(Imu(rod, 0.5, np.array([0.0, 0.0, 1.0])) for rod in rods))
    poses, steps, x = PoseFilter(balanced, robot, PoseSettings()), [], balanced.node_position_m
    a, b = balanced.structure.rods[list(rods)].T
    mounted = np.array([attitude(along / np.linalg.norm(along)) for along in x[b] - x[a]])
    vector, before = np.array([0.3, -0.2, 0.6]), np.eye(3)
    for k in range(130):
        turn = rotation(min(max((k - 20) / 60, 0.0), 1.0) * vector)
        rate = rotation_vector(before.T @ turn) / 0.02
        true_m = (x - poses.centre_m) @ turn.T + poses.centre_m
        aids = [
            ImuReading(i, 0.02 * k, mounted[i].T @ rate, GRAVITY_M_PER_S2 * (turn @ mounted[i])[2])
            for i in range(2)
            if not silent(k, i)
        ]
        aids += [PositionReading(0.02 * k, node, true_m[node]) for node in (3, 5, 8, 11)]
        steps.append(poses.step(0.02 * k, x, EXACT_M2, aids))
        before = turn
    return poses, steps, turn @ mounted


def test_a_sensor_that_was_silent_is_taken_on_again_where_it_rests(balanced, robot) -> None:
    """Both are silent while it is turned: the attitudes that they had before are worth nothing."""
    poses, steps, true = carried(balanced, robot, lambda k, _: 22 <= k < 78)
    assert poses.trust.is_used.all()
    assert not steps[-1].contradicted_imus.any()
    errors = rotation_vector(true @ np.swapaxes(steps[-1].state.imu_turn, 1, 2))
    assert np.linalg.norm(errors, axis=1).max() < 0.03
    at = steps[-1].state.layout
    sigma = np.sqrt(np.diag(steps[-1].covariance)[at.imu_turn])
    assert (np.abs(errors.ravel()) < 4 * sigma).all()
    for state, covariance in smoothed_poses(steps):
        assert np.isfinite(state.imu_turn).all()
        assert np.linalg.eigvalsh(covariance).min() > -1e-9


@pytest.mark.parametrize("is_level", [True, False])
def test_a_lost_sensor_that_rests_tells_how_its_rod_is_inclined(balanced, robot, is_level: bool) -> None:
    """Its rod lies otherwise than in the pose that was lost. Heights are those above a floor, which may slope."""
    if not is_level:
        robot = replace(robot, floor=replace(robot.floor, normal=rotation(np.array([0.1, 0.0, 0.0])) @ UP))
    imu = Imu(0, 0.5, np.array([0.0, 0.0, 1.0]))
    poses = PoseFilter(balanced, replace(robot, imus=(imu,)), PoseSettings())
    a, b = balanced.structure.rods[0]
    poses.knows_attitude = False
    for k, sine in enumerate([0.6, 0.28]):
        force = GRAVITY_M_PER_S2 * np.array([np.sqrt(1 - sine**2), 0.0, sine])
        poses.step(0.02 * k, balanced.node_position_m, EXACT_M2, [ImuReading(0, 0.02 * k, np.zeros(3), force)])
        poses.trust.lose()
    ends, height_m = poses.rod_heights()
    length_m = np.linalg.norm(balanced.node_position_m[b] - balanced.node_position_m[a])
    assert ends.tolist() == ([[a, b]] if is_level else [])
    assert height_m == pytest.approx([0.28 * length_m] if is_level else [])


@pytest.mark.parametrize("silent", [False, True])
def test_inertial_sensors_on_a_level_floor_do_not_find_a_heading_that_is_lost(balanced, robot, silent: bool) -> None:
    """Both shake for two seconds, or are silent for as long: neither they nor the floor know of the vertical's turn."""
    rods, rng = (0, 2), np.random.default_rng(3)
    robot = replace(robot, imus=tuple(Imu(rod, 0.5, np.array([0.0, 0.0, 1.0])) for rod in rods))
    poses, x = PoseFilter(balanced, robot, PoseSettings()), balanced.node_position_m
    a, b = balanced.structure.rods[list(rods)].T
    mounted = np.array([attitude(along / np.linalg.norm(along)) for along in x[b] - x[a]])
    for k in range(130):
        if k == 30:
            N = heading_direction(poses.state, robot.floor)
            poses.covariance = poses.covariance + ANY_HEADING_RAD**2 * np.outer(N, N)
        shakes = 0.05 * (k > 30)
        aids = [
            ImuReading(i, 0.02 * k, shakes * rng.normal(size=3), mounted[i].T @ (GRAVITY_M_PER_S2 * UP))
            for i in range(2)
            if not silent or k < 30
        ]
        shape_m = x + 0.02 * shakes * rng.normal(size=x.shape)
        step = poses.step(0.02 * k, shape_m, 1e-6 * np.eye(36), aids)
    turn = step.covariance[step.state.layout.turn, step.state.layout.turn]
    assert np.sqrt(UP @ turn @ UP) == pytest.approx(ANY_HEADING_RAD, rel=0.01)


@pytest.mark.parametrize(("comes_at", "used"), [(100, [True, True]), (1000, [True, False])])
def test_a_sensor_that_comes_late_or_never_does_not_keep_the_others_waiting(balanced, robot, comes_at, used) -> None:
    poses, steps, true = carried(balanced, robot, lambda k, imu: imu == 1 and k < comes_at)
    assert poses.trust.is_used.tolist() == used
    assert not steps[-1].contradicted_imus.any()
    errors = rotation_vector(true @ np.swapaxes(steps[-1].state.imu_turn, 1, 2))
    assert np.linalg.norm(errors[used], axis=1).max() < 0.05


@pytest.mark.parametrize(("jump_m", "is_doubted"), [(0.0, False), (0.05, True)])
def test_positions_that_all_jump_in_sight_are_doubted(
    structure, balanced, lengths_of, jump_m: float, is_doubted: bool
) -> None:
    """A knocked camera: the frame moves by 50 mm between two frames, and the robot stands."""
    x = balanced.node_position_m
    free = replace(structure, anchors=np.empty(0), anchor_position_m=np.empty((0, 3)))
    rest = replace(balanced, structure=free)
    poses = PoseFilter(rest, FreeStandingRobot(floor=Floor(float(x[0, 2]), UP), rest_seconds=0.5), PoseSettings())
    for k in range(60):
        shift_m = np.array([jump_m, 0.0, 0.0]) * (k > 50)
        aids = tuple(PositionReading(0.02 * k, node, x[node] + shift_m) for node in (3, 5, 8, 11))
        assert k > 50 or not poses.doubts_positions
        lengths = replace(lengths_of(structure, x, 0.02 * k), aids=aids)
        shape = poses.without_contradictions(Shape(0.02 * k, x, 1e-6 * np.eye(36), Status.OK, lengths))
        poses.step(shape.t_s, x, shape.covariance_m2, shape.lengths.aids)
    assert poses.doubts_positions == is_doubted


@pytest.mark.parametrize("by_heights", [True, False], ids=["heights", "faces"])
def test_a_robot_whose_motion_is_felt_stops_only_where_its_sensors_are_wrong(balanced, robot, by_heights) -> None:
    """It moves at 1 m/s, and a node 30 mm and more above the floor is taken to have landed.

    Heights may be that wrong while the motion is right. Another face than the sensors tell shows that they are wrong.
    A robot that a hand threw was stopped in the air: it was 0.7 m beside its place half a second later.
    """
    robot = replace(robot, imus=(Imu(0, 0.5, np.array([0.0, 0.0, 1.0])),))
    poses, x = PoseFilter(balanced, robot, PoseSettings()), balanced.node_position_m
    first, second = balanced.structure.rods[0]
    mounted = attitude((x[second] - x[first]) / np.linalg.norm(x[second] - x[first]))

    def samples(t_s: float) -> list[ImuReading]:
        return [ImuReading(0, t_s, np.zeros(3), mounted.T @ (GRAVITY_M_PER_S2 * UP))]

    for k in range(30):
        poses.step(0.02 * k, x, EXACT_M2, samples(0.02 * k))
    thrown_m_per_s = np.array([0.8, 0.0, 0.6])
    poses.state = replace(poses.state, velocity_m_per_s=thrown_m_per_s)
    frame, predicted = poses._expected(0.6, x, EXACT_M2, samples(0.6))
    nodes = np.isin(np.arange(12), [0, 3])
    assert robot.floor.clearance_m(predicted.placed.node_position_m[3]) > 0.03
    found, _, _ = poses._put_on_feet(predicted, frame, Standing(nodes, nodes.astype(float)), by_heights=by_heights)
    expected = thrown_m_per_s if by_heights else np.zeros(3)
    assert found.placed.state.velocity_m_per_s == pytest.approx(expected, abs=0.01)
