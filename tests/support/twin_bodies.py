"""Structures as the twin's engine takes them."""

import functools

import numpy as np
from numpy.typing import NDArray

from tensegraph import Structure, six_strut, three_strut
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.twin.mjcf import Body


@functools.cache
def resting(nodes: int) -> tuple[Structure, NDArray[np.float64]]:
    """The six-strut or the prism, by its number of nodes, and its (nodes, 3) rest shape."""
    structure = {12: six_strut(0.3), 6: three_strut(0.3, 0.15)}[nodes]
    return structure, find_rest_shape(structure)


def body(structure: Structure, **constants) -> Body:
    """A structure with ordinary constants, but for those given."""
    ordinary = {
        "rod_mass_kg": 0.03,
        "rod_radius_m": 0.003,
        "rod_drag_n_s_per_m": 0.2,
        "stiffness_n_per_m": np.full(len(structure.tendons), 400.0),
        "damping_n_s_per_m": 1.0,
        "push_back": 0.1,
        "gravity_m_per_s2": 9.81,
        "ground_friction": None,
        "rigid": (),
        "own_rods": len(structure.rods),
        "knot_mass_kg": 0.0,
    }
    return Body(structure, **(ordinary | constants))
