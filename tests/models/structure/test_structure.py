"""What a structure is, and what is refused."""

import numpy as np
import pytest

from four_nodes import four_nodes
from tensegraph import InputError, Structure, six_strut, three_strut
from tensegraph.models.ready_structures import SIX_STRUT_RODS, SIX_STRUT_TENDONS


def changed(**changes):
    """The six-strut's arguments, some replaced."""
    values = {
        "rods": SIX_STRUT_RODS,
        "tendons": SIX_STRUT_TENDONS,
        "rod_length_m": 0.3,
        "natural_length_m": 0.17,
        "anchors": [0, 1, 2],
        "anchor_position_m": [[0, 0, 0], [0.18, 0, 0], [0.09, 0.16, 0]],
    }
    return Structure(**(values | changes))


REFUSED = {
    "joins the same nodes as tendon 0": {"tendons": [*SIX_STRUT_TENDONS, (1, 0)], "natural_length_m": 0.17},
    "joins the same nodes as rod 0": {"tendons": [*SIX_STRUT_TENDONS, (3, 0)]},
    "joins the same nodes as rod 5": {"rods": [*SIX_STRUT_RODS, (11, 10)]},
    "node out of range": {"tendons": [*SIX_STRUT_TENDONS, (3, 900)]},
    "node 12: no rod and no tendon ends there": {"tendons": [*SIX_STRUT_TENDONS, (3, 13), (4, 13)]},
    "node 12: is on no rod, and one tendon alone holds it": {"tendons": [*SIX_STRUT_TENDONS, (3, 12)]},
    "nodes 12, 13, 14: no rod and no tendon joins them to the others: expected three anchors": {
        "rods": [(0, 3), (4, 5), (1, 6), (7, 8), (2, 9), (10, 11), (12, 13)],
        "tendons": [*SIX_STRUT_TENDONS, (12, 14), (13, 14)],
    },
    "tendon 24 out of range": {"unsensed": [24]},
    "tendon 5 is named twice": {"unsensed": [5, 5]},
    "no tendon holds it": {"tendons": [pair for pair in SIX_STRUT_TENDONS if 8 not in pair]},
    "both anchors are at one place": {"anchors": [0, 1], "anchor_position_m": [[0, 0, 0], [0, 0, 0]]},
    "lie on one line": {"anchor_position_m": [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]]},
    r"rod_length_m\[2\]": {"rod_length_m": [0.3, 0.3, -0.3, 0.3, 0.3, 0.3]},
    r"natural_length_m\[0\]": {"natural_length_m": np.inf},
    "expected one number or 6": {"rod_length_m": [0.3, 0.3]},
    "two different nodes": {"tendons": [*SIX_STRUT_TENDONS, (4, 4)]},
    "named twice": {"anchors": [0, 1, 1]},
    "expected node numbers": {"anchors": [0.5, 1, 2]},
    "expected 3 finite rows": {"anchor_position_m": [[0, 0, 0], [0.18, 0, np.nan], [0.09, 0.16, 0]]},
    "tendon 0 is 0.17 m long and joins two anchors 1.8 m apart: expected at most 4 times": {
        "anchor_position_m": [[0, 0, 0], [1.8, 0, 0], [0.9, 1.6, 0]]
    },
    "anchors: every node is one": {"anchors": range(12), "anchor_position_m": np.eye(12)[:, :3] + np.eye(12)[:, 1:4]},
    "pairs of node numbers, got an array": {"rods": [0, 1, 2]},
    "rods: expected pairs of node numbers, got none": {"rods": []},
    "rows of unequal length": {"rods": [[0, 1], [2]]},
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_no_tensegrity_is_refused(message: str) -> None:
    with pytest.raises(InputError, match=message):
        changed(**REFUSED[message])


def test_values_are_frozen() -> None:
    structure = six_strut(0.3)
    with pytest.raises(ValueError, match="read-only"):
        structure.rod_length_m[0] = 1.0


def test_six_strut_is_the_paper_s(structure: Structure) -> None:
    """The printed tendons stand at their places, in the six-strut's graph: each node in four, eight triangles."""
    printed = {0: (0, 1), 1: (1, 2), 2: (0, 2), 3: (0, 7), 4: (0, 9), 22: (8, 9), 23: (8, 11)}
    assert {e: tuple(structure.tendons[e]) for e in printed} == printed
    assert (np.bincount(structure.tendons.ravel()) == 4).all()
    neighbours = [set(structure.tendons[(structure.tendons == n).any(axis=1)].ravel()) - {n} for n in range(12)]
    triangles = sum(len(neighbours[a] & neighbours[b]) for a, b in structure.tendons) / 3
    assert triangles == 8


def test_faces() -> None:
    """The paper's structure has eight closed triangles, one of them the base; the prism has its top."""
    assert six_strut(0.3).faces.tolist() == [
        [0, 7, 9], [1, 3, 10], [2, 4, 6], [3, 7, 11], [4, 8, 9], [5, 6, 10], [5, 8, 11]
    ]  # fmt: skip
    assert three_strut(0.3, 0.15).faces.tolist() == [[3, 4, 5]]
    assert four_nodes().faces.tolist() == [[1, 2, 3]]
