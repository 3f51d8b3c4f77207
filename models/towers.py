"""Towers of three-strut prisms that stand on one another, whose rods share nodes (class 2)."""

import numpy as np
from numpy.typing import NDArray

from .structure.lengths import member_length_m
from .structure.structure import Structure
from .values.errors import InputError

TWIST_RAD = np.deg2rad(150.0)
"""Turn of the upper triangle of a prism against the lower one, at which its tendons balance (Kenner, 1976)."""


def prism_tower(
    stages: int, rod_length_m: float, base_side_m: float, *, prestrain: float = 0.08
) -> tuple[Structure, NDArray[np.float64]]:
    """Return a tower of three-strut prisms, anchored at nodes 0, 1, 2, and (nodes, 3) its shape at rest.

    Nodes 3 s, 3 s + 1, 3 s + 2 are the triangle above stage s - 1 and below stage s; neighbouring stages twist in
    opposite directions. Each prism is in balance by itself: the force per length q of the tendons of its triangles, and
    sqrt(3) q of its side tendons; a triangle between two prisms has 2 q.

    Args:
        stages: number of prisms.
        rod_length_m: length of each rod.
        base_side_m: side of all triangles.
        prestrain: strain at rest of the tendons of the lowest and the highest triangle, for equal stiffness.

    Raises:
        InputError: when the rods are too short for the triangle, or there is no stage.
    """
    radius_m = base_side_m / np.sqrt(3)
    height_squared = rod_length_m**2 - 2 * radius_m**2 * (1 - np.cos(TWIST_RAD))
    if stages < 1 or height_squared <= 0:
        shortest_m = radius_m * np.sqrt(2 * (1 - np.cos(TWIST_RAD)))
        raise InputError(
            f"prism_tower: expected at least 1 stage of rods longer than {shortest_m:.4g} m for triangles of side "
            f"{base_side_m} m, got {stages} of {rod_length_m} m"
        )
    turn = np.concatenate([[0.0], np.cumsum(TWIST_RAD * (-1.0) ** np.arange(stages))])
    angle = turn[:, None] + np.deg2rad(120.0) * np.arange(3)
    level_m = np.sqrt(height_squared) * np.arange(stages + 1)
    position_m = np.stack(
        [radius_m * np.cos(angle), radius_m * np.sin(angle), np.broadcast_to(level_m[:, None], angle.shape)], axis=-1
    ).reshape(-1, 3)
    rods = [(3 * s + k, 3 * s + 3 + k) for s in range(stages) for k in range(3)]
    triangles = [(3 * s + a, 3 * s + b) for s in range(stages + 1) for a, b in ((0, 1), (1, 2), (0, 2))]
    sides = [(3 * s + k, 3 * s + 3 + (k - (-1) ** s) % 3) for s in range(stages) for k in range(3)]
    density = np.array([1.0 if s in (0, stages) else 2.0 for s in range(stages + 1) for _ in range(3)])
    density = np.append(density, np.full(len(sides), np.sqrt(3)))
    tendons = np.array(triangles + sides)
    structure = Structure(
        rods=np.array(rods),
        tendons=tendons,
        rod_length_m=np.array(rod_length_m),
        natural_length_m=member_length_m(position_m, tendons) * (1 - prestrain / (1 + prestrain) * density),
        anchors=np.arange(3),
        anchor_position_m=position_m[:3],
    )
    return structure, position_m
