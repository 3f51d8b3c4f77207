"""Lengths of members, and their Jacobian."""

import numpy as np

from tensegraph import Structure
from tensegraph.models.structure.lengths import length_and_jacobian, length_jacobian, member_length_m


def test_length_jacobian(structure: Structure, rest, check_jacobian) -> None:
    members = np.concatenate([structure.rods, structure.tendons])
    position = rest.node_position_m + 0.01 * np.random.default_rng(1).standard_normal((12, 3))
    check_jacobian(lambda x: member_length_m(x, members), length_jacobian(position, members), position)


def test_two_nodes_at_one_place_have_no_direction() -> None:
    """Not nan, with a warning of NumPy: such a shape stands in a damaged result."""
    length_m, jacobian = length_and_jacobian(np.zeros((2, 3)), np.array([[0, 1]]))
    assert length_m == 0
    assert not jacobian.any()
