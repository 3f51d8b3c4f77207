"""A structure that hangs: its torque worked by hand, its shape at rest, and the motions that its anchors leave."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Structure, six_strut
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.rigidity import held_jacobian, motions_left
from tensegraph.models.structure.suspension import Suspension

ANCHORS_M = np.array([[0.0, 0.0, 0.5], [0.18371, 0.0, 0.5]])

ANYWHERE_M = 0.15 * np.random.default_rng(5).standard_normal((12, 3))


def hanging(anchors: int) -> Structure:
    return replace(six_strut(0.3), anchors=np.arange(anchors), anchor_position_m=ANCHORS_M[:anchors])


def test_the_torque_of_a_weight_aside_is_its_lever() -> None:
    """By hand: 0.1 m along x from the pivot, a weight turns about +y by 0.1 m times itself; below it, not at all."""
    one = Suspension.of(hanging(1))
    assert one.torque_m(np.array([0.1, 0.0, -0.2])) == pytest.approx([0.0, 0.1])
    assert one.torque_m(np.array([0.0, 0.0, -0.2])) == pytest.approx(0)
    two = Suspension.of(hanging(2))
    assert two.torque_m(np.array([0.0, 0.1, -0.2])) == pytest.approx([-0.1])
    assert two.torque_m(np.array([0.1, 0.0, -0.2])) == pytest.approx([0.0])


@pytest.mark.parametrize("anchors", [1, 2])
def test_a_shape_is_turned_until_it_hangs(anchors: int) -> None:
    suspension = Suspension.of(hanging(anchors))
    x = suspension.hanging_m(suspension.pivot_m + ANYWHERE_M)
    assert suspension.torque_m(suspension.lever_m(x)) == pytest.approx(0, abs=1e-9)
    assert suspension.lever_m(x)[2] < 0
    assert suspension.askew_rad(x) < 1e-6
    upside_down = suspension.pivot_m + (x - suspension.pivot_m) * [1, -1, -1]
    assert suspension.askew_rad(upside_down) == pytest.approx(np.pi)


def test_a_found_rest_shape_hangs_from_its_anchors() -> None:
    structure = hanging(2)
    x = find_rest_shape(structure)
    assert x[:2] == pytest.approx(ANCHORS_M)
    assert structure.tendon_length_m(x) == pytest.approx(0.18371, abs=0.001)
    assert Suspension.of(structure).lever_m(x)[2] < -0.08
    assert Suspension.of(structure).askew_rad(x) < 1e-6


@pytest.mark.parametrize(("anchors", "motions"), [(0, 6), (1, 3), (2, 1), (3, 0)])
def test_anchors_leave_rigid_motions(anchors: int, motions: int) -> None:
    """They move no anchor, and with them the lengths of a shape without symmetry determine all coordinates."""
    structure = six_strut(0.3) if anchors == 3 else hanging(anchors)
    x = structure.with_anchors_placed(ANYWHERE_M)
    left = motions_left(structure, x)
    assert left.shape == (36, motions)
    assert left.T @ left == pytest.approx(np.eye(motions))
    assert left[structure.anchored_coordinates] == pytest.approx(0, abs=1e-9)
    jacobian = held_jacobian(structure, x)
    assert np.linalg.matrix_rank(jacobian) == jacobian.shape[1]
    assert structure.is_square == (anchors == 3)
