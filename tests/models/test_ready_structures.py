"""Towers of prisms: their forces balance, and their rods share nodes or do not."""

import numpy as np
import pytest

from tensegraph import InputError, Structure, prism_tower, saddle_tower
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.lengths import length_jacobian
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.structure.rigidity import rigidity

K = 400.0
SIZES = [(0.3, 0.15, 0.25), (0.3, 0.12, 0.15), (1.0, 0.6, 0.3)]


def balance(structure: Structure) -> Statics:
    """Weightless, with tendons of one stiffness."""
    return Statics(structure, Mechanics(np.full(len(structure.tendons), K), structure.natural_length_m, 0.0, 0.0))


@pytest.mark.parametrize(("rod_m", "side_m", "overlap"), SIZES)
class TestSaddleTower:
    def test_stands_as_told(self, rod_m: float, side_m: float, overlap: float) -> None:
        structure, x = saddle_tower(rod_m, side_m, overlap=overlap)
        assert sorted(structure.rods.ravel().tolist()) == list(range(12))
        np.testing.assert_allclose(np.linalg.norm(x[structure.rods[:, 1]] - x[structure.rods[:, 0]], axis=1), rod_m)
        np.testing.assert_allclose(structure.tendon_length_m(x)[:6], side_m)
        np.testing.assert_allclose(x[3:6, 2] - x[6:9, 2], overlap * rod_m)
        assert np.bincount(structure.tendons.ravel()).tolist() == [4] * 12

    def test_forces_balance_and_every_tendon_pulls(self, rod_m: float, side_m: float, overlap: float) -> None:
        structure, x = saddle_tower(rod_m, side_m, overlap=overlap)
        tension_n = K * (structure.tendon_length_m(x) - structure.natural_length_m)
        assert tension_n.min() > 0
        np.testing.assert_allclose(balance(structure).residual_n(x), 0, atol=1e-6 * tension_n.max())

    def test_one_self_stress_stiffens_the_only_mechanism(self, rod_m: float, side_m: float, overlap: float) -> None:
        """The energy of a motion that changes no length to first order grows: its second derivative is positive."""
        structure, x = saddle_tower(rod_m, side_m, overlap=overlap)
        facts = rigidity(structure, x)
        assert (facts.mechanisms, facts.self_stresses) == (1, 1)
        motion = facts.mechanism.ravel()
        np.testing.assert_allclose(length_jacobian(x, structure.free_members) @ motion, 0, atol=1e-6)
        _, by_position = balance(structure).residual_and_jacobian(x)
        assert np.linalg.norm(by_position @ motion) > 0.1 * K * side_m * 0.08  # forces see it

    def test_is_the_rest_shape_of_its_tendons(self, rod_m: float, side_m: float, overlap: float) -> None:
        structure, x = saddle_tower(rod_m, side_m, overlap=overlap)
        beside_m = x + np.random.default_rng(0).normal(0, 0.01 * rod_m, x.shape)
        np.testing.assert_allclose(find_rest_shape(structure, beside_m), x, atol=2e-4 * rod_m)


@pytest.mark.parametrize(("side_m", "overlap", "prestrain"), [(0.6, 0.25, 0.08), (0.15, 0.25, 3.0), (0.15, 2.0, 0.08)])
def test_sizes_without_balance_are_refused(side_m: float, overlap: float, prestrain: float) -> None:
    with pytest.raises(InputError, match=r"saddle_tower: no tower of rods of 0\.3 m"):
        saddle_tower(0.3, side_m, overlap=overlap, prestrain=prestrain)


@pytest.mark.parametrize("stages", [0, 201, 10**11])
def test_a_tower_without_stages_or_with_too_many_is_refused(stages) -> None:
    with pytest.raises(InputError, match=rf"prism_tower: expected at (least 1|most 200) stages?.*, got {stages}"):
        prism_tower(stages, 0.3, 0.15)
