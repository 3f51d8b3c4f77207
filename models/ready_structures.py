"""Structures that are ready: the paper's, a prism, and towers of prisms.

Towers of prisms that stand on one another share nodes between rods (class 2); the rods of a saddle tower do not
(class 1).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from .structure.lengths import member_length_m
from .structure.structure import Structure
from .values.errors import InputError

SIX_STRUT_RODS = ((0, 3), (4, 5), (1, 6), (7, 8), (2, 9), (10, 11))
"""The paper's eq. (6)."""

SIX_STRUT_TENDONS = (
    *((0, 1), (1, 2), (0, 2), (0, 7), (0, 9), (1, 3), (1, 10), (2, 4), (2, 6), (3, 7), (3, 10), (3, 11)),
    *((4, 6), (4, 8), (4, 9), (5, 6), (5, 8), (5, 10), (5, 11), (6, 10), (7, 9), (7, 11), (8, 9), (8, 11)),
)
"""The paper prints seven of its 24 tendons (0-2 in eq. (5), 3, 4, 22, 23 in eq. (7)). This list is deduced from three
conditions: it is the graph of the six-strut tensegrity, it has those seven tendons at their places, and it is sorted.
Only one other list meets them; it swaps nodes 4 and 5."""

SIX_STRUT_TENDON_PER_ROD = np.sqrt(3 / 8)
"""Tendon length over rod length of the regular six-strut tensegrity (parallel rods half a rod apart)."""


MOST_STAGES = 200
"""Largest number of stages of a tower: to find whether it is rigid takes seconds, and grows with their cube."""
TWIST_RAD = np.deg2rad(150.0)
"""Turn of the upper triangle of a prism against the lower one, at which its tendons balance (Kenner, 1976)."""


def six_strut(rod_length_m: float, *, prestrain: float = 0.08) -> Structure:
    """Return the paper's structure: six equal rods and 24 equal tendons, anchored at the triangle of nodes 0, 1, 2.

    Args:
        rod_length_m: length of each rod.
        prestrain: strain of each tendon at rest; the natural length follows from it.
    """
    side_m = float(SIX_STRUT_TENDON_PER_ROD * rod_length_m)
    return Structure(
        rods=np.array(SIX_STRUT_RODS),
        tendons=np.array(SIX_STRUT_TENDONS),
        rod_length_m=np.array(rod_length_m),
        natural_length_m=np.array(side_m / (1 + prestrain)),
        anchors=np.arange(3),
        anchor_position_m=base_triangle_m(side_m),
    )


def three_strut(rod_length_m: float, base_side_m: float, *, prestrain: float = 0.08) -> Structure:
    """Return the three-strut prism: base triangle 0, 1, 2 (the anchors), top triangle 3, 4, 5, three side tendons.

    It is a `prism_tower` of one stage, whose node 0 is at the origin and whose node 1 is on the x axis.

    Args:
        rod_length_m: length of each rod.
        base_side_m: side of both triangles.
        prestrain: strain of the triangles' tendons at rest; that of the side tendons follows for equal stiffness.

    Raises:
        InputError: when the rods are too short for the triangle.
    """
    prism, _ = prism_tower(1, rod_length_m, base_side_m, prestrain=prestrain)
    return replace(prism, anchor_position_m=base_triangle_m(base_side_m))


def base_triangle_m(side_m: float) -> NDArray[np.float64]:
    """Return (3, 3) the corners of an equilateral triangle on z = 0: at the origin, on the x axis, and at y > 0."""
    return side_m * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(3) / 2, 0.0]])


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
        InputError: when the rods are too short for the triangle, or there is no stage, or more than `MOST_STAGES`.
    """
    radius_m = base_side_m / np.sqrt(3)
    height_squared = rod_length_m**2 - 2 * radius_m**2 * (1 - np.cos(TWIST_RAD))
    if stages > MOST_STAGES:
        raise InputError(f"prism_tower: expected at most {MOST_STAGES} stages, got {stages}")
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


SADDLE_RODS = [(k, 3 + k) for k in range(3)] + [(6 + k, 9 + k) for k in range(3)]
SADDLE_TENDONS = np.array(
    [
        *((0, 1), (1, 2), (0, 2), (9, 10), (10, 11), (9, 11)),
        *((3 + k, 6 + j % 3) for k in range(3) for j in (k, k + 2)),
        *((k, 6 + (k + 1) % 3) for k in range(3)),
        *((3 + (k + 2) % 3, 9 + k) for k in range(3)),
        *((k, 3 + (k + 2) % 3) for k in range(3)),
        *((6 + (k + 2) % 3, 9 + k) for k in range(3)),
    ]
)
"""Six tendons of each kind: base and top, the saddle, those from base or top to the saddle's far side, and to its near
side."""
SADDLE_START = (np.deg2rad(165.0), 0.82, 0.6, 1.8, 0.8, 0.45)
"""Where the search for its shape starts: turn of the rods, height of their upper ends, and q of each kind."""


def saddle_tower(
    rod_length_m: float, base_side_m: float, *, overlap: float = 0.25, prestrain: float = 0.08
) -> tuple[Structure, NDArray[np.float64]]:
    """Return a tower of two three-strut prisms whose rods share no node, anchored at 0, 1, 2, and its shape at rest.

    Nodes 0 to 2 are the base, 3 to 5 the upper ends of the lower rods, 6 to 8 the lower ends of the upper rods, and 9
    to 11 the top; all are equally far from the axis. The upper prism hangs in a saddle: its lower ends are below the
    upper ends of the lower prism. Upside down and turned by 60 degrees the tower is itself, so that it is in balance
    where the forces at nodes 0 and 3 are: with -1 per length of a rod, and q_e of a tendon,

        sum_e q_e (x_n - x_m) = x_n - x_r,    e = n-m the tendons at node n, and r the other end of its rod

    Its shape has one state of self-stress, which stiffens the one motion that changes no length to first order.

    Args:
        rod_length_m: length of each rod.
        base_side_m: side of base and top.
        overlap: height of the saddle, as a share of the rods' length.
        prestrain: strain at rest of the tendons of base and top, for equal stiffness; those of the saddle have most.

    Raises:
        InputError: for sizes with which no such tower is in balance.
    """
    side = base_side_m / rod_length_m
    found = least_squares(_unbalanced, SADDLE_START, method="lm", max_nfev=500, args=(side, overlap))
    density = found.x[2:] / found.x[2]
    stretched = prestrain / (1 + prestrain) * np.repeat(density, 6)
    if not (found.cost < 1e-16 and density.min() > 0 and stretched.min() > 0 and stretched.max() < 1):
        raise InputError(
            f"saddle_tower: no tower of rods of {rod_length_m} m on a triangle of side {base_side_m} m, with an "
            f"overlap of {overlap} and a prestrain of {prestrain}, is in balance: expected a side of about half a rod"
        )
    position_m = rod_length_m * _saddle_shape(side, overlap, *found.x[:2])
    structure = Structure(
        rods=np.array(SADDLE_RODS),
        tendons=SADDLE_TENDONS,
        rod_length_m=np.array(rod_length_m),
        natural_length_m=member_length_m(position_m, SADDLE_TENDONS) * (1 - stretched),
        anchors=np.arange(3),
        anchor_position_m=position_m[:3],
    )
    return structure, position_m


def _unbalanced(z: NDArray[np.float64], side: float, overlap: float) -> NDArray[np.float64]:
    """Return (7,) the forces at nodes 0 and 3, and the error of a rod's length; z is as `SADDLE_START`."""
    x = _saddle_shape(side, overlap, *z[:2])
    force = np.zeros_like(x)
    for members, q in ((np.array(SADDLE_RODS), np.full(6, -1.0)), (SADDLE_TENDONS, np.repeat(z[2:], 6))):
        pull = q[:, None] * (x[members[:, 1]] - x[members[:, 0]])
        np.add.at(force, members[:, 0], pull)
        np.add.at(force, members[:, 1], -pull)
    return np.append(force[[0, 3]].ravel(), np.linalg.norm(x[3] - x[0]) - 1)


def _saddle_shape(side: float, overlap: float, turn_rad: float, height: float) -> NDArray[np.float64]:
    """Return (12, 3) the nodes, with rods of length 1 where turn and height of their upper ends are right."""
    turns_rad = np.array([0.0, turn_rad, turn_rad + np.pi / 3, np.pi / 3])
    angle = turns_rad[:, None] + np.deg2rad(120.0) * np.arange(3)
    level = np.array([0.0, height, height - overlap, 2 * height - overlap])
    x, y = side / np.sqrt(3) * np.stack([np.cos(angle), np.sin(angle)])
    return np.stack([x, y, np.broadcast_to(level[:, None], angle.shape)], axis=-1).reshape(-1, 3)
