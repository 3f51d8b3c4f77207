"""Whether a lone sensor has lost the robot: its limits by hand, and in a filter with one sensor and with two."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from plan_edits import PLANS, replaced
from poses import robot_with_two_sensors
from tensegraph import reconstruct, simulate
from tensegraph.estimator.free_standing.pose_filter import PoseFilter
from tensegraph.estimator.free_standing.pose_start import state_at_rest
from tensegraph.estimator.free_standing.watches.lone_sensor_watch import LoneSensorWatch
from tensegraph.estimator.free_standing.world import in_world
from tensegraph.factors.imu import ImuArray
from tensegraph.models.estimation import BranchSettings
from tensegraph.models.pose.imu_samples import ImuSamples
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.pose.pose_settings import PoseSettings
from tensegraph.models.pose.robot import FreeStandingRobot
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import Imu, ImuReading

AXIS = np.array([0.0, 0.0, 1.0])
ACROSS = np.array([1.0, 0.0, 0.0])
NONE = np.zeros(1, dtype=np.bool_)


def samples_of(rate_rad_per_s: np.ndarray) -> ImuSamples:
    force = GRAVITY_M_PER_S2 * UP[None]
    return ImuSamples(rate_rad_per_s[None], force, np.ones(1, dtype=np.int64), NONE, np.full(1, 0.02), NONE, NONE)


class Robot:
    """A robot at rest on nodes 0 to 2, with a sensor, as a watch sees it in one frame after another."""

    def __init__(self, balanced) -> None:
        imus = (Imu(0, 0.5, AXIS),)
        self.floor = Floor(float(balanced.node_position_m[0, 2]), UP)
        state = state_at_rest(
            balanced.node_position_m, FreeStandingRobot(floor=self.floor, imus=imus, rest_seconds=0.2)
        )
        body_m = balanced.node_position_m - state.position_m
        self.placed = PlacedShape(state, body_m, 1e-6 * np.eye(36))
        self.watch = LoneSensorWatch(ImuArray(imus, balanced.structure.rods), floor_m=0.0)
        self.stands = np.isin(np.arange(12), [0, 1, 2])

    def is_lost(self, rate_rad_per_s: np.ndarray, below_m: float = 0.0, frames: int = 1) -> bool:
        """Return whether it is lost after some frames in which node 1 seems to be below the floor."""
        body_m = self.placed.body_m.copy()
        body_m[1, 2] -= below_m
        placed = replace(self.placed, body_m=body_m)
        used, samples = np.ones(1, dtype=np.bool_), samples_of(rate_rad_per_s)
        for _ in range(frames):
            lost = self.watch.observe(placed, self.floor, self.stands, samples, used, 0.02)
        return lost


@pytest.mark.parametrize(
    ("rate", "below_m", "frames", "expected"),
    [(1.0, 0.008, 2, False), (1.0, 0.008, 5, True), (1.0, 0.004, 50, False), (0.1, 0.008, 50, False)],
    ids=["a blow", "in a tip", "a little", "without a turn"],
)
def test_the_floor_by_hand(balanced, rate: float, below_m: float, frames: int, expected: bool) -> None:
    """8 mm at a sigma of 1 mm: 64 (1 - exp(-t / 0.1 s)) is 21 after two frames and 40 after five. 4 mm make 16."""
    assert Robot(balanced).is_lost(rate * ACROSS, below_m, frames) == expected


def turned(poses: PoseFilter, balanced, imus: int) -> np.ndarray:
    """Return (imus,) which sensors are lost after 0.1 s in which all rods turn at 4 rad/s about a level axis."""
    rods = balanced.structure.rods
    first, second = balanced.node_position_m[rods[0]]
    level = np.cross(second - first, UP)
    rate = 4.0 * level / np.linalg.norm(level)
    for k in range(31):
        t_s = 0.02 * k
        w = rate if t_s > 0.5 else np.zeros(3)
        force = GRAVITY_M_PER_S2 * UP
        aids = [ImuReading(i, t_s - 0.01 + 0.01 * half, w, force) for half in (0, 1) for i in range(imus)]
        poses.step(t_s, balanced.node_position_m, 1e-8 * np.eye(36), aids)
    return poses.trust.is_lost


def test_one_sensor_is_lost_and_two_in_different_directions_are_not(balanced) -> None:
    x, rods = balanced.node_position_m, balanced.structure.rods
    along = x[rods[0, 1]] - x[rods[0, 0]]
    floor = Floor(float(x[0, 2]), UP)
    robot = FreeStandingRobot(floor=floor, imus=(Imu(0, 0.5, along / np.linalg.norm(along)),), rest_seconds=0.5)
    assert turned(PoseFilter(balanced, robot, PoseSettings()), balanced, 1).tolist() == [True]
    assert not turned(robot_with_two_sensors(balanced), balanced, 2).any()


@pytest.mark.parametrize(("rate_rad_per_s", "imus", "spins"), [(0.5, 1, True), (0.1, 1, False), (0.5, 2, False)])
def test_the_rod_of_a_lone_sensor_may_have_spun_while_the_robot_tips(
    balanced, lengths_of, rate_rad_per_s: float, imus: int, spins: bool
) -> None:
    """Its only sensors are on parallel rods: the ellipsoids hold a turn by 3 degrees about the rod, and the feet."""
    x, rods = balanced.node_position_m, balanced.structure.rods
    along = [(x[b] - x[a]) / np.linalg.norm(x[b] - x[a]) for a, b in rods[[0, 2]]]
    floor = Floor(float(x[0, 2]), UP)
    sensors = (Imu(0, 0.5, along[0]), Imu(2, 0.5, along[1]))[:imus]
    poses = PoseFilter(balanced, FreeStandingRobot(floor=floor, imus=sensors, rest_seconds=0.1), PoseSettings())
    for k in range(20):
        rate, force = rate_rad_per_s * along[0] * (k > 15), GRAVITY_M_PER_S2 * UP
        aids = [ImuReading(i, 0.02 * k, rate, force) for i in range(imus)]
        step = poses.step(0.02 * k, x, 1e-8 * np.eye(36), aids)
    assert (step.spun_about is not None) == spins
    if step.spun_about is None:
        return
    assert np.abs(step.spun_about @ along[0]) == pytest.approx(1, abs=1e-3)
    shape = Shape(0.38, x, 1e-8 * np.eye(36), Status.OK, lengths_of(balanced.structure, x, 0.38))
    with_spin, without = (
        in_world(shape, balanced, floor, step.state, step.covariance, told, BranchSettings())
        for told in (step, replace(step, spun_about=None))
    )
    node_m = without.node_position_m
    away_m = np.cross(step.spun_about, node_m[11] - node_m[step.standing.nodes].mean(axis=0))
    added_m2 = (with_spin.covariance_m2 - without.covariance_m2).reshape(12, 3, 12, 3)[11, :, 11]
    assert added_m2 == pytest.approx(0.05**2 * np.outer(away_m, away_m), abs=1e-12)


def test_a_robot_with_one_sensor_that_rolls_over_several_faces_is_followed(tmp_path) -> None:
    """It turns by 150 degrees within a second, and its rods spin by 10 at most, as tendons hold them."""
    shutil.copy(PLANS["press"], tmp_path)
    edits = ("duration_s = 24.0", "duration_s = 9.0"), ("until_s = 23.0", "until_s = 9.0")
    whole = replaced(PLANS["roll"].read_text(), *edits)
    before, first, second = whole.split("[[imu]]")
    plan = tmp_path / "roll.toml"
    plan.write_text(f"{before}[[imu]]{first}{second[second.index('[load]') :]}")
    trial = simulate(plan, tmp_path / "trial", 13)
    result, truth = reconstruct(trial, "live"), trial.truth()
    at = np.minimum(np.searchsorted(truth.t_s, result.t_s - 1e-9), len(truth.t_s) - 1)
    error_m = np.linalg.norm(result.node_position_m - truth.node_position_m[at], axis=-1).max(axis=-1)
    is_ok = np.array([status is Status.OK for status in result.status])
    sigma_m = result.node_sigma_m.min(axis=-1)
    assert np.linalg.norm(np.diff(truth.node_position_m[:, 0], axis=0), axis=-1).sum() > 0.3
    assert error_m.max() < 0.1
    assert (is_ok & (error_m > 5 * sigma_m)).mean() < 0.03
    assert sigma_m[-1] < 0.05
