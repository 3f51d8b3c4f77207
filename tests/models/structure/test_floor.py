"""The floor, and its tilt against the normal as told."""

import numpy as np
import pytest

from tensegraph.models.structure.floor import UP, Floor

TOLD = Floor(0.01, np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01), 0.17, np.array([0.3, -0.2, 0.05]))
TILT = np.array([0.12, -0.07])
X_M = 0.4 * np.random.default_rng(6).standard_normal((5, 3))


def test_a_tilt_turns_the_normal_about_the_pivot() -> None:
    """By hand: a tilt of tan(0.1) along the first axis turns it by 0.1 rad, and the pivot stays as high as it was."""
    floor = Floor(0.01, UP, 0.17, np.array([0.3, -0.2, 0.0]))
    tilted = floor.tilted(np.array([np.tan(0.1), 0.0]))
    assert tilted.normal == pytest.approx(np.sin(0.1) * floor.axes[0] + np.cos(0.1) * UP)
    assert tilted.clearance_m(floor.pivot_m) == pytest.approx(-0.01)


def test_heights_change_with_the_tilt_as_their_derivative_tells(check_jacobian) -> None:
    check_jacobian(lambda t: TOLD.tilted(t).clearance_m(X_M), TOLD.clearance_by_tilt_m(X_M, TILT), TILT)


def test_a_floor_that_is_told_exactly_has_no_tilt() -> None:
    exact = Floor(0.01, UP)
    assert exact.tilt_count == 0
    assert exact.tilted(np.zeros(0)) is exact
    assert exact.clearance_by_tilt_m(X_M, np.zeros(0)).shape == (5, 0)
    assert exact.estimated(np.zeros(0), np.zeros((0, 0))) is None


def test_a_floor_under_a_structure_goes_through_its_lowest_nodes() -> None:
    """By hand: feet at 2, 3 and 4 cm far from the origin, of which a level floor passes the middle."""
    x = np.array([[5.0, 0, 0.02], [5.1, 0, 0.03], [5.0, 0.1, 0.04], [5.0, 0, 0.2]])
    floor = Floor(0.01, UP, 0.1).under(x)
    assert floor.height_m == pytest.approx(0.03)
    assert floor.carries_at_rest(x).tolist() == [True, True, True, False]


def test_sigma_is_that_of_the_axis_that_is_known_least() -> None:
    normal = TOLD.estimated(TILT, np.diag([1e-6, 4e-6]))
    assert normal.sigma_rad == pytest.approx(0.002)
    assert np.linalg.norm(normal.direction) == pytest.approx(1)
