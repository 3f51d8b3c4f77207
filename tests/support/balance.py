"""A structure in balance, and shapes of it that loads press."""

import numpy as np
from scipy.optimize import root

from tensegraph import Structure
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.mechanics import Mechanics

K = 400.0


def nominal(structure: Structure, rod_mass_kg: float = 0.03) -> Mechanics:
    return Mechanics(np.full(len(structure.tendons), K), structure.natural_length_m, rod_mass_kg, 0.02)


def pressed(structure: Structure, rest, load_n: np.ndarray):
    """The shape under loads at the nodes: all forces balance, rods push as they must and keep their lengths."""
    statics, free = Statics(structure, rest.mechanics), structure.free_nodes

    def place(x):
        position = rest.node_position_m.copy()
        position[free] = x[: 3 * len(free)].reshape(-1, 3)
        return position

    def unbalanced(x, share):
        position = place(x)
        force = statics.node_force_n(position) + share * load_n
        d = position[structure.rods[:, 1]] - position[structure.rods[:, 0]]
        length = np.linalg.norm(d, axis=1)
        along = x[3 * len(free) :, None] * d / length[:, None]
        np.add.at(force, structure.rods[:, 1], along)
        np.add.at(force, structure.rods[:, 0], -along)
        return np.concatenate([force[free].ravel(), K * (length - structure.rod_length_m)])

    start = np.concatenate([rest.node_position_m[free].ravel(), np.full(len(structure.rods), 10.0)])
    for share in (0.25, 0.5, 0.75, 1.0):
        solution = root(unbalanced, start, (share,), method="lm", options={"xtol": 1e-14, "ftol": 1e-14})
        start = solution.x
    assert np.abs(solution.fun).max() < 1e-6
    return place(solution.x)
