"""One mechanism and one self-stress at the rest shape, none under load."""

import numpy as np
import pytest

from tensegraph import Structure, six_strut, three_strut
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.rigidity import free_length_jacobian, rigidity


@pytest.mark.parametrize("make", [lambda: six_strut(0.3), lambda: three_strut(0.3, 0.18)], ids=["six", "three"])
def test_one_mechanism_and_one_self_stress_at_rest(make) -> None:
    """Both are prestressed with one infinitesimal mechanism, the fact that decides this project (Pellegrino, 1986)."""
    structure = make()
    facts = rigidity(structure, find_rest_shape(structure))
    assert (facts.mechanisms, facts.self_stresses) == (1, 1)
    assert facts.rank == 3 * len(structure.free_nodes) - 1
    assert facts.smallest_singular_value < 1e-4
    jacobian = free_length_jacobian(structure, find_rest_shape(structure))
    assert np.linalg.norm(jacobian @ facts.mechanism[structure.free_nodes].ravel()) < 1e-4


def test_loaded_shape_is_stiff(example_structure: Structure, true_positions) -> None:
    pressed = true_positions[1][np.argmax(np.abs(true_positions[1] - true_positions[1][0]).sum(axis=(1, 2)))]
    facts = rigidity(example_structure, pressed)
    assert facts.mechanisms == 0
    assert 1e-3 < facts.smallest_singular_value < 0.1
