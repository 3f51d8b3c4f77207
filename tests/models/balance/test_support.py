"""What gravity and the floor do to the nodes."""

import numpy as np
import pytest

from tensegraph import Structure
from tensegraph.models.balance.support import hung_up, standing, weightless
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2, UP, Floor
from tensegraph.models.structure.form_finding import find_rest_shape

MASS_KG = 0.03
MASSES_KG = np.full(12, 0.5 * MASS_KG)
"""Of six rods, half at either end."""
NODE_N = 0.5 * MASS_KG * GRAVITY_M_PER_S2
TOTAL_N = 12 * NODE_N


@pytest.fixture(scope="module")
def shape(structure: Structure) -> np.ndarray:
    """The regular structure, which stands on nodes 0, 1 and 2."""
    return find_rest_shape(structure)


def carried_by(*nodes: int) -> np.ndarray:
    carried = np.zeros(12)
    carried[list(nodes)] = 1.0
    return carried


def test_an_anchored_structure_has_its_weight(structure) -> None:
    assert hung_up(MASSES_KG).force_n == pytest.approx(np.tile([0, 0, -NODE_N], (12, 1)))


def test_three_legs_below_the_centroid_carry_a_third_each(structure, shape) -> None:
    force_n = standing(MASSES_KG, shape, UP, 0.0, carried_by(0, 1, 2)).force_n
    assert force_n[:3, 2] == pytest.approx(np.full(3, TOTAL_N / 3 - NODE_N), rel=1e-6)
    assert force_n[3:] == pytest.approx(np.tile([0, 0, -NODE_N], (9, 1)))


def test_the_leg_nearest_to_the_centroid_carries_most() -> None:
    """Two legs at x = -0.1 and one at 0.2, with the centroid at 0: two thirds and one third of the weight.

    Moments about y: N_front 0.2 = N_back 0.1, and N_front + N_back = W.
    """
    x = np.zeros((12, 3))
    x[:3] = [[-0.1, -0.1, 0], [-0.1, 0.1, 0], [0.2, 0, 0]]
    force_n = standing(MASSES_KG, x, UP, 0.0, carried_by(0, 1, 2)).force_n
    assert force_n[2, 2] + NODE_N == pytest.approx(TOTAL_N / 3, rel=1e-6)
    assert force_n[:2, 2] + NODE_N == pytest.approx(np.full(2, TOTAL_N / 3), rel=1e-6)


def test_only_nodes_that_may_stand_have_uncertain_forces(structure, shape) -> None:
    support = standing(MASSES_KG, shape, UP, 0.0, carried_by(0, 1, 2))
    variance = np.trace(support.covariance_n2, axis1=1, axis2=2)
    assert (variance[:3] > 0.01).all()
    assert variance[3:] == pytest.approx(0)


def test_a_structure_in_a_hand_may_be_pulled_in_any_direction(structure) -> None:
    support = weightless(MASSES_KG)
    assert support.force_n == pytest.approx(0)
    assert support.covariance_n2[4] == pytest.approx(np.eye(3) * NODE_N**2 / 3)


def test_the_floor_carries_what_is_near_it(shape) -> None:
    floor = Floor(float(shape[0, 2]), UP)
    assert np.flatnonzero(floor.carries_at_rest(shape)).tolist() == [0, 1, 2]
    assert floor.clearance_m(shape)[:3] == pytest.approx(0, abs=1e-9)


def test_the_axes_of_a_floor_lie_in_it() -> None:
    floor = Floor(0.0, np.array([0.6, 0, 0.8]))
    frame = np.vstack([floor.axes, floor.normal])
    assert frame @ frame.T == pytest.approx(np.eye(3))
    assert np.linalg.det(frame) == pytest.approx(1)
