"""Loads from what the balance of forces leaves over: which are observable, and which node they are given to."""

import numpy as np
import pytest

from four_nodes import TRUE_M, four_nodes
from structures import PLATE_M, plate
from tensegraph.models.balance.observable_loads import Observable, external_loads, observable_loads, observable_part
from tensegraph.models.balance.statics import Statics


class TestLoads:
    def test_what_is_observable(self, structure) -> None:
        seen = observable_loads(structure)
        assert [seen[n] for n in (0, 3, 4, 5)] == [Observable.NONE, Observable.ACROSS_ROD, *[Observable.ALL] * 2]

    def test_along_a_floating_rod_by_hand(self, structure, balanced) -> None:
        """The axial sum goes to the end that is pushed more across."""
        statics = Statics(structure, balanced.mechanics)
        r = np.zeros(len(statics.group))
        nodes = statics.nodes.tolist()
        r[3 * nodes.index(4)] = 0.5
        r[27 + statics.floating_rods.tolist().index([4, 5])] = 2.0
        loads = external_loads(statics, balanced.node_position_m, r, np.full(len(r), 0.01))
        w = balanced.node_position_m[5] - balanced.node_position_m[4]
        np.testing.assert_allclose(loads.force_n[4], [-0.5, 0, 0] - 2 * w / np.linalg.norm(w))
        np.testing.assert_allclose(loads.force_n[5], 0, atol=1e-15)
        assert loads.sigma_n[4] == pytest.approx(np.sqrt(0.04 / 3))


class TestObservablePart:
    def test_of_a_rod_whose_ends_are_at_one_place_all_is_seen(self) -> None:
        """As where a cell of the truth was written twice; no direction is divided by zero."""
        position_m = np.zeros((4, 3))
        force = np.ones((4, 3))
        part = observable_part(four_nodes(), force, position_m)
        np.testing.assert_array_equal(part[3], force[3])

    def test_the_observable_part_by_hand(self) -> None:
        """Of (6, 0, 0), w w^T F = 6 / 6 (1, 1, 2): (5, -1, -2) is left; anchors show nothing."""
        force = np.tile([6.0, 0, 0], (4, 1))
        part = observable_part(four_nodes(), force, TRUE_M)
        np.testing.assert_allclose(part[3], [5, -1, -2], atol=1e-12)
        assert np.isnan(part[:3]).all()
        np.testing.assert_array_equal(force[3], [6, 0, 0])

    def test_all_of_it_on_a_floating_rod(self, structure, rest) -> None:
        """Of the six-strut, rods 4-5, 7-8 and 10-11 float."""
        force = np.random.default_rng(0).standard_normal((12, 3))
        part = observable_part(structure, force, rest.node_position_m)
        np.testing.assert_array_equal(part[[4, 5, 7, 8, 10, 11]], force[[4, 5, 7, 8, 10, 11]])
        for anchor, node in ((0, 3), (1, 6), (2, 9)):
            along = rest.node_position_m[node] - rest.node_position_m[anchor]
            assert part[node] @ along == pytest.approx(0, abs=1e-12)

    def test_of_rods_that_meet_nothing_is_known_while_one_of_their_nodes_is_hidden(self) -> None:
        """Three times: seen, one node of the body hidden, seen."""
        plate_structure = plate().structure
        position_m = np.repeat(PLATE_M[None], 3, axis=0)
        force = np.random.default_rng(0).standard_normal(position_m.shape)
        seen = observable_part(plate_structure, force, position_m)
        position_m[1, 2] = np.nan
        part = observable_part(plate_structure, force, position_m)
        np.testing.assert_array_equal(part[[0, 2]], seen[[0, 2]])
        assert np.isnan(part[1, :5]).all()
        np.testing.assert_array_equal(observable_part(plate_structure, force[0], position_m[0]), seen[0])
