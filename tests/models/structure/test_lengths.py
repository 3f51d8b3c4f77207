"""Lengths of members, and their Jacobian."""

import numpy as np

from tensegraph import Structure
from tensegraph.models.structure.lengths import length_jacobian, member_length_m


def test_length_jacobian(structure: Structure, rest, check_jacobian) -> None:
    members = np.concatenate([structure.rods, structure.tendons])
    position = rest.node_position_m + 0.01 * np.random.default_rng(1).standard_normal((12, 3))
    check_jacobian(lambda x: member_length_m(x, members), length_jacobian(position, members), position)
