"""Rods that share nodes: what they take of a force, by hand, as a projection, and its derivatives."""

import numpy as np
import pytest

from balance import K, nominal, pressed
from structures import PLATE_M, TOWER, TOWER_M, mixed, plate
from tensegraph import Structure, six_strut
from tensegraph.models.balance.joined_rods import JoinedRods
from tensegraph.models.balance.observable_loads import (
    Observable,
    external_loads,
    observable_loads,
    observable_part,
)
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.rigidity import rigid_motions


def test_two_rods_at_a_right_angle_by_hand() -> None:
    """Rods 3-4 along x and 4-5 along y: node 4 keeps its z alone, 3 its y and z, 5 its x and z.

    Along x the force 6 N at node 4 is shared by nodes 3 and 4, which move together: 3 N each.
    """
    structure = Structure(
        rods=np.array([(3, 4), (4, 5)]),
        tendons=np.array([(0, 3), (1, 4), (2, 5)]),
        rod_length_m=np.array(1.0),
        natural_length_m=np.array(1.0),
        anchors=np.arange(3),
        anchor_position_m=np.array([[0, 0, 1.0], [1, 0, 1], [1, 1, 1]]),
    )
    x = np.array([[0, 0, 1.0], [1, 0, 1], [1, 1, 1], [0, 0, 0], [1, 0, 0], [1, 1, 0]])
    joined = JoinedRods(structure)
    assert joined.nodes.tolist() == [3, 4, 5]
    force = np.array([[0, 1.0, 2], [6, 0, 3], [4, 0, 5]])
    left = (joined.allowed(x) @ force.ravel()).reshape(3, 3)
    assert left == pytest.approx(np.array([[3, 1, 2], [3, 0, 3], [4, 0, 5]]))
    assert Statics(structure, nominal(structure)).rank == 9 - 2


def test_a_rigid_body_leaves_what_moves_it_as_a_whole() -> None:
    told = plate()
    joined = JoinedRods(told.structure)
    motions = rigid_motions(PLATE_M[:5])
    np.testing.assert_allclose(joined.allowed(PLATE_M), motions @ motions.T, atol=1e-9)
    assert joined.rows_per_node.sum() == pytest.approx(6)


def test_a_node_that_rods_hold_entirely_tells_nothing_of_its_load() -> None:
    """Three rods from the anchors to node 3, a tripod, and two nodes more on a rod of their own."""
    x = np.array([[0, 0, 0], [0.3, 0, 0], [0.15, 0.26, 0], [0.15, 0.09, 0.25], [0.07, 0.09, 0.1], [0.2, 0.1, 0.35]])
    rods = np.array([(0, 3), (1, 3), (2, 3), (4, 5)])
    tendons = np.array([(4, 0), (4, 1), (4, 3), (5, 0), (5, 2), (5, 3)])
    length_m = np.linalg.norm(x[rods[:, 0]] - x[rods[:, 1]], axis=1)
    tripod = Structure(rods, tendons, length_m, np.array(0.1), np.arange(3), x[:3])
    assert JoinedRods(tripod).rows_per_node.tolist() == [0.0]
    assert observable_loads(tripod)[3] == Observable.NONE
    statics = Statics(tripod, nominal(tripod))
    residual_n = statics.residual_n(x)
    loads = external_loads(statics, x, residual_n, np.ones_like(residual_n))
    assert np.isnan(loads.force_n[3]).all()
    assert loads.sigma_n[3] == np.inf
    assert np.isfinite(loads.force_n[4:]).all()
    assert np.isnan(observable_part(tripod, np.ones((6, 3)), x)[3]).all()
    assert np.isfinite(statics.support_variance_n2(x)).all()


def test_disjoint_rods_are_not_joined_nor_are_rods_that_meet_in_an_anchor() -> None:
    assert len(JoinedRods(six_strut(0.3)).rods) == 0
    star = Structure(
        np.array([(0, 3), (0, 4)]), np.array([(3, 4), (1, 3), (2, 4)]), np.array(0.3), np.array(0.2), np.arange(3),
        np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]),
    )  # fmt: skip
    assert len(JoinedRods(star).rods) == 0
    assert Statics(star, nominal(star)).rank == 4


def test_jacobians(check_jacobian) -> None:
    structure = mixed()
    statics = Statics(structure, nominal(structure))
    x = 0.3 * np.random.default_rng(0).standard_normal((structure.node_count, 3))
    residual, jacobian = statics.residual_and_jacobian(x)
    np.testing.assert_allclose(residual, statics.residual_n(x), atol=1e-12)
    check_jacobian(statics.residual_n, jacobian, x, step=1e-7, tolerance=1e-4)
    assert statics.rank == 24 - 12  # eight free nodes; five in a body keep 6 of 15, three rods more

    def longer(change_m):
        natural_m = structure.natural_length_m + change_m
        return Statics(structure, Mechanics(np.full(10, K), natural_m, 0.03, 0.02)).residual_n(x)

    check_jacobian(longer, statics.mechanics_jacobian(x)[1], np.zeros(10), step=1e-7, tolerance=1e-4)
    together = statics.residual_and_jacobian(np.stack([x, x + 0.01]))
    np.testing.assert_allclose(together[1][0], jacobian, atol=1e-9)


def test_a_tower_of_prisms_is_in_balance() -> None:
    statics = Statics(TOWER, Mechanics(np.full(15, K), TOWER.natural_length_m, 0.0, 0.02))
    assert np.abs(statics.residual_n(TOWER_M)).max() < 1e-9
    assert np.abs(statics.node_force_n(TOWER_M)[3:]).max() > 1  # the rods take it


def test_the_load_on_a_plate_is_told_where_it_moves_it() -> None:
    """A load balances the springs; what is seen of it is what moves the body as a whole, and it is all of that."""
    told = plate()
    rest = RestShape(told.structure, PLATE_M, np.eye(39) * 1e-8, "measured", mechanics=told.mechanics)
    load_n = np.zeros((13, 3))
    load_n[1] = [0.5, 0.0, -2.0]
    x = pressed(told.structure, rest, load_n)
    statics = Statics(told.structure, told.mechanics)
    seen = external_loads(statics, x, statics.residual_n(x), np.full(len(statics.group), 1e-4))
    expected = observable_part(told.structure, load_n, x)
    np.testing.assert_allclose(seen.force_n[:5], expected[:5], atol=1e-4)
    assert seen.force_n[:5].sum(axis=0) == pytest.approx(load_n[1], abs=1e-4)
    assert np.isfinite(seen.sigma_n[:5]).all()


def test_masses_are_at_the_nodes_by_hand() -> None:
    """0.2 kg on five nodes of the plate, 10 g on each tendon, half at either end, and a motor of 50 g at node 2."""
    told = plate(tendon_mass_kg=0.01, knot_mass_kg=[0, 0, 0.05, *[0] * 10])
    mass_kg = told.mechanics.node_mass_kg(told.structure)
    assert mass_kg[:5] == pytest.approx([0.05, 0.05, 0.10, 0.05, 0.04])
    assert mass_kg[5:] == pytest.approx(0.005)
    weight_n = Statics(told.structure, told.mechanics).outer_force_n[2]
    assert weight_n == pytest.approx([0, 0, -0.1 * GRAVITY_M_PER_S2])


def test_a_slack_cable_does_not_push_but_a_strip_does() -> None:
    told = plate(push_back=[0.0, *[0.1] * 7])
    x = PLATE_M.copy()
    x[:5, 2] += 0.15  # up: tendons to the ceiling are slack
    of_cable, of_strip = (Statics(told.structure, told.mechanics)._tendons(x).tension_n[tendon] for tendon in (0, 1))
    assert of_cable == 0
    assert of_strip < -1
