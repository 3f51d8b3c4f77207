"""Frames of motion capture: the fit at rest worked by hand, its covariance sampled, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.models.pose.position_frames import OwnFrames, fitted_frame
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.aids import PositionReading
from tensegraph.models.values.rotations import rotation
from tensegraph.models.values.stamps import RestClock

TURN, ORIGIN_M = rotation(np.array([1.1, -0.7, 1.9])), np.array([1.3, -2.1, 0.8])
SEEN = (2, 4, 9, 11)
REST_S = 1.0


def in_frame(world_m: np.ndarray) -> np.ndarray:
    return (world_m - ORIGIN_M) @ TURN


def own_frames(rest: RestShape) -> OwnFrames:
    """Return the frame of recording 1 of a robot that begins to rest at t = 0."""
    clock = RestClock(REST_S)
    clock.count_frame(0.0)
    return OwnFrames(rest, (1,), clock, 5e-4)


def at_rest(own: OwnFrames, rest: RestShape, nodes=SEEN, markers=SEEN) -> None:
    """Give positions of some nodes at rest, 20 times a second; node by node, on which node its marker is."""
    for t_s in np.arange(0, REST_S, 0.05):
        for node, marker in zip(nodes, markers, strict=True):
            assert own.placed(PositionReading(t_s, node, in_frame(rest.node_position_m[marker]), 1)) is None


def test_a_quarter_turn_and_its_sigma_by_hand() -> None:
    """Four points at 0.2 m on the axes x and y, wrong by 1 mm each.

    The turn about z has four levers of 0.2 m: 1 mm / (2 * 0.2 m); about x and y two: 1 mm / (sqrt 2 * 0.2 m).
    """
    x = 0.2 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    y = np.stack([x[:, 1], -x[:, 0], x[:, 2]], axis=1) + np.array([0.0, 0.0, 0.5])
    frame = fitted_frame(x, y, 1e-6 * np.eye(12), 0)
    assert frame.quaternion == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert frame.origin_m == pytest.approx([0, 0, -0.5])
    assert frame.turn_sigma_rad == pytest.approx([1e-3 / 0.2 / np.sqrt(2), 1e-3 / 0.2 / np.sqrt(2), 1e-3 / 0.4])
    shift_m, lever_m = 0.5e-3, 0.5e-3 / 0.2 / np.sqrt(2)  # the origin is 0.5 m below the pivot
    assert frame.origin_sigma_m == pytest.approx([np.hypot(shift_m, lever_m), np.hypot(shift_m, lever_m), shift_m])


def test_the_covariance_of_a_placed_position_is_that_of_fits_to_wrong_readings(balanced) -> None:
    """Sampled: where frames that were fitted to noise place a point two metres away."""
    rng = np.random.default_rng(3)
    x = balanced.node_position_m[list(SEEN)]
    root = 0.0004 * rng.standard_normal((12, 12))
    variance_m2 = root @ root.T
    far_m = np.array([2.0, 0.3, 0.1])
    placed = [
        fitted_frame(x, in_frame(x + (root @ rng.standard_normal(12)).reshape(4, 3)), variance_m2, 0).world_m(
            in_frame(far_m)
        )
        for _ in range(3000)
    ]
    frame = fitted_frame(x, in_frame(x), variance_m2, 0)
    told = frame.jacobian(far_m) @ frame.jacobian(far_m).T
    assert np.cov(np.transpose(placed)) == pytest.approx(told, abs=0.08 * told.max())
    assert np.mean(placed, axis=0) == pytest.approx(far_m, abs=0.2 * np.sqrt(told.max()))


def test_positions_are_placed_from_the_end_of_the_rest_on(balanced) -> None:
    """Those of other recordings are in the world already; one wild reading at rest changes nothing."""
    own = own_frames(balanced)
    at_rest(own, balanced)
    own.placed(PositionReading(0.99, 4, np.array([9.0, 9.0, 9.0]), 1))
    later_m = np.array([0.5, -0.3, 0.2])
    placed = own.placed(PositionReading(1.5, 7, in_frame(later_m), 1))
    assert placed is not None
    assert placed.frame is not None
    assert placed.position_m == pytest.approx(later_m, abs=1e-9)
    in_world = PositionReading(0.5, 7, later_m, 0)
    assert own.placed(in_world) is in_world
    (fit,) = own.fits
    assert fit.as_table()["origin_m"] == pytest.approx(ORIGIN_M, abs=1e-6)
    assert fit.misfit_m == pytest.approx(0, abs=1e-9)
    assert set(own.counts().values()) == {0}


def on_one_line(rest: RestShape) -> RestShape:
    x = rest.node_position_m.copy()
    x[9] = 0.5 * (x[2] + x[4]) + 1e-4
    return replace(rest, node_position_m=x)


UNKNOWN = {
    "expected three nodes or more while the robot is at rest, got 0": ((), (), False),
    "expected three nodes or more while the robot is at rest, got 2": ((2, 4), (2, 4), False),
    "expected nodes that are not on one line at rest, got 2, 4, 9": ((2, 4, 9), (2, 4, 9), True),
    "mm only: wrong node, unit or axis?": (SEEN, (4, 2, 9, 11), False),
}


@pytest.mark.parametrize("message", UNKNOWN)
def test_a_frame_that_is_not_known_is_said_and_its_positions_are_counted(message, balanced) -> None:
    nodes, markers, is_line = UNKNOWN[message]
    rest = on_one_line(balanced) if is_line else balanced
    own = own_frames(rest)
    at_rest(own, rest, nodes, markers)
    for t_s in (1.1, 1.2, 1.3):
        assert own.placed(PositionReading(t_s, 2, np.zeros(3), 1)) is None
    assert own.counts() == {"position 1: rows in an unknown frame": 3}
    (fit,) = own.fits
    assert message in fit.text()
    assert message in fit.as_table()["unknown"]
    assert own.as_table()["own_frame"][0]["recording"] == 1
