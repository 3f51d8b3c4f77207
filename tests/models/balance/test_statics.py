"""The balance of forces at nodes: by hand, its Jacobians, its symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from balance import K, nominal
from tensegraph import Structure, six_strut, three_strut
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2
from tensegraph.models.structure.form_finding import find_rest_shape


class TestStatics:
    def test_a_node_between_two_tendons_by_hand(self) -> None:
        """Node 3 hangs from three anchors 0.3 m above: each pulls 400 N/m times 0.1 m, up by 0.8 of it; 96 N in all."""
        structure = Structure(
            np.array([[3, 4]]),
            np.array([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4]]),
            np.array(0.5),
            np.array(0.4),
            np.arange(3),
            np.array([[0.3, 0, 0], [-0.15, 0.15 * np.sqrt(3), 0], [-0.15, -0.15 * np.sqrt(3), 0]]),
        )
        position = np.concatenate([structure.anchor_position_m, [[0, 0, -0.4], [0, 0, 0.1]]])
        force = Statics(structure, nominal(structure, 0.2)).node_force_n(position)
        assert force[3] == pytest.approx([0, 0, 3 * K * 0.1 * 0.8 - 0.1 * GRAVITY_M_PER_S2])
        bent = 0.02 * K * (np.sqrt(0.1) - 0.4)  # shorter than 0.4 m: it pushes back a little
        assert force[4] == pytest.approx([0, 0, -3 * bent * 0.1 / np.sqrt(0.1) - 0.1 * GRAVITY_M_PER_S2])
        residual = Statics(structure, nominal(structure, 0.2)).residual_n(position)
        assert residual[:6] == pytest.approx(0, abs=1e-12)  # both forces are along the rod
        assert residual[6] == pytest.approx(force[3, 2] + force[4, 2])  # from node 3 up to node 4

    @pytest.mark.parametrize("structure", [six_strut(0.3), three_strut(0.3, 0.18)])
    def test_jacobian(self, structure, check_jacobian) -> None:
        rng = np.random.default_rng(0)
        statics = Statics(structure, nominal(structure))
        position = find_rest_shape(structure) + 0.004 * rng.standard_normal((structure.node_count, 3))
        residual, jacobian = statics.residual_and_jacobian(position)
        np.testing.assert_allclose(residual, statics.residual_n(position), atol=1e-12)
        check_jacobian(statics.residual_n, jacobian, position, step=1e-7, tolerance=1e-5)

    def test_jacobian_by_mechanics(self, structure, check_jacobian) -> None:
        position = find_rest_shape(structure) + 0.004 * np.random.default_rng(1).standard_normal((12, 3))
        base = nominal(structure)
        by_log_stiffness, by_natural_length = Statics(structure, base).mechanics_jacobian(position)

        def stiffer(x):
            return Statics(structure, replace(base, stiffness_n_per_m=K * np.exp(x))).residual_n(position)

        def longer(x):
            return Statics(structure, replace(base, natural_length_m=base.natural_length_m + x)).residual_n(position)

        check_jacobian(stiffer, by_log_stiffness, np.zeros(24))
        check_jacobian(longer, by_natural_length, np.zeros(24), step=1e-7, tolerance=1e-5)

    def test_a_tendon_that_is_wound_in_pulls_more(self, structure, check_jacobian) -> None:
        """By 400 N/m times 5 mm, along itself, at both of its ends; derivatives are those of the wound balance."""
        base = nominal(structure)
        position = find_rest_shape(structure) + 0.001 * np.random.default_rng(3).standard_normal((12, 3))
        natural_m = base.natural_length_m - 0.02
        statics = Statics(structure, replace(base, natural_length_m=natural_m))
        change_m = np.zeros(24)
        change_m[15] = -0.005
        wound = statics.wound(natural_m + change_m)
        a, b = structure.tendons[15]
        along = (position[b] - position[a]) / np.linalg.norm(position[b] - position[a])
        more_n = np.zeros((12, 3))
        more_n[a], more_n[b] = K * 0.005 * along, -K * 0.005 * along
        np.testing.assert_allclose(wound.node_force_n(position) - statics.node_force_n(position), more_n, atol=1e-9)
        check_jacobian(wound.residual_n, wound.residual_and_jacobian(position)[1], position, step=1e-7, tolerance=1e-5)
        np.testing.assert_array_equal(statics.mechanics.natural_length_m, natural_m)

    def test_many_frames_are_as_one_by_one(self, structure) -> None:
        positions = find_rest_shape(structure) + 0.003 * np.random.default_rng(2).standard_normal((5, 12, 3))
        statics = Statics(structure, nominal(structure))
        together = statics.residual_and_jacobian(positions)
        for k in range(5):
            for whole, one in zip(together, statics.residual_and_jacobian(positions[k]), strict=True):
                np.testing.assert_allclose(whole[k], one, atol=1e-9)

    @given(st.floats(0, 2 * np.pi), st.integers(0, 1000))
    def test_turning_all_about_the_vertical_turns_the_forces(self, structure, balanced, angle, seed) -> None:
        """Gravity and springs do not care where north is."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        position = balanced.node_position_m + 0.01 * np.random.default_rng(seed).standard_normal((12, 3))
        statics = Statics(structure, nominal(structure))
        np.testing.assert_allclose(
            statics.node_force_n(position @ turn.T), statics.node_force_n(position) @ turn.T, atol=1e-9
        )
