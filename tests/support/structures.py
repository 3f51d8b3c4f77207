"""Structures of more kinds than disjoint rods, a tower of class 2, a guyed mast, a plate on cables, and their files."""

from itertools import combinations
from pathlib import Path

import numpy as np

from tensegraph import Structure, prism_tower
from tensegraph.models.structure.lengths import member_length_m
from tensegraph.models.structure_description import describe_structure

TOWER, TOWER_M = prism_tower(2, 0.3, 0.15)

CORNERS_M = np.array([[-0.1, -0.1, 0.25], [0.1, -0.1, 0.25], [0.1, 0.1, 0.25], [-0.1, 0.1, 0.25], [0, 0, 0.31]])
CEILING_M = np.array([[-0.2, -0.2, 0.5], [0.2, -0.2, 0.5], [0.2, 0.2, 0.5], [-0.2, 0.2, 0.5]])
FLOOR_M = np.array([[-0.2, 0.2, 0], [-0.2, -0.2, 0], [0.2, -0.2, 0], [0.2, 0.2, 0]])
PLATE_M = np.concatenate([CORNERS_M, CEILING_M, FLOOR_M])
"""Four corners and the top of a stem, which are rigid; each corner has a tendon up, and one down and aside."""

YAML = """
nodes:
  foot: [0, 0, 0]
  top: [0, 10, 0]
  left: [6, 2, 0]
  right: [6, 2, 8]
pair_groups:
  my_rod:
    - [foot, top]
    - [left, right]
  my_string:
    - [foot, left]
    - named: [top, left]
    - [foot, right]
    - [top, right]
builders:
  my_rod: {class: tgRodInfo, parameters: {density: 0.5, radius: 0.2}}
  my_string: {class: tgBasicActuatorInfo, parameters: {stiffness: 100, pretension: 50}}
"""
"""Two rods and four strings, in the words of NTRT."""


def plate_tables(**mechanics) -> dict:
    """The plate as a file tells it."""
    tendons = [(k, 5 + k) for k in range(4)] + [(k, 9 + k) for k in range(4)]
    told = {"tendon_stiffness_n_per_m": 400.0, "rod_mass_kg": 0.0, "push_back": 0.02}
    return {
        "structure": {
            "rods": [],
            "tendons": tendons,
            "rod_length_m": 0.2,
            "natural_length_m": (0.9 * member_length_m(PLATE_M, np.array(tendons))).tolist(),
            "anchors": list(range(5, 13)),
            "anchor_position_m": PLATE_M[5:].tolist(),
            "node_position_m": PLATE_M.tolist(),
        },
        "body": [{"nodes": [0, 1, 2, 3, 4], "mass_kg": 0.2}],
        "mechanics": told | mechanics,
    }


def plate(**mechanics):
    return describe_structure(plate_tables(**mechanics), "plate")


def mixed() -> Structure:
    """A rigid body, two rods that continue it, one of which ends on an anchor's rod, and a node on no rod."""
    body = (3, 4, 5, 6, 7)
    return Structure(
        rods=np.array([*combinations(body, 2), (7, 8), (8, 9), (0, 9)]),
        tendons=np.array([(0, 3), (1, 4), (2, 5), (0, 4), (1, 8), (2, 8), (1, 9), (2, 10), (9, 10), (6, 10)]),
        rod_length_m=np.array(0.3),
        natural_length_m=np.array(0.2),
        anchors=np.arange(3),
        anchor_position_m=np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]),
    )


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    """Write a structure file, whose name may begin with folders, and return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path
