"""What a structure is, what is refused, and its rest shape and rigidity."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph import InputError, Structure, six_strut, three_strut
from tensegraph.estimator.rest_step import rest_step
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestSettings
from tensegraph.models.structure.rigidity import find_rest_shape, free_length_jacobian, rigidity
from tensegraph.models.structure.structure import SIX_STRUT_RODS, SIX_STRUT_TENDONS


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
    "is also rod 0": {"tendons": [*SIX_STRUT_TENDONS, (3, 0)]},
    "node out of range": {"tendons": [*SIX_STRUT_TENDONS, (3, 12)]},
    "is on 2 rods": {"rods": [*SIX_STRUT_RODS[:-1], (10, 11), (10, 5)]},
    "no tendon holds it": {"tendons": [pair for pair in SIX_STRUT_TENDONS if 8 not in pair]},
    "at least 3 nodes": {"anchors": [0, 1], "anchor_position_m": [[0, 0, 0], [0.18, 0, 0]]},
    "lie on one line": {"anchor_position_m": [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]]},
    r"rod_length_m\[2\]": {"rod_length_m": [0.3, 0.3, -0.3, 0.3, 0.3, 0.3]},
    r"natural_length_m\[0\]": {"natural_length_m": np.inf},
    "expected one number or 6": {"rod_length_m": [0.3, 0.3]},
    "two different nodes": {"tendons": [*SIX_STRUT_TENDONS, (4, 4)]},
    "named twice": {"anchors": [0, 1, 1]},
    "expected 3 finite rows": {"anchor_position_m": [[0, 0, 0], [0.18, 0, np.nan], [0.09, 0.16, 0]]},
    "pairs of node": {"rods": [0, 1, 2]},
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


def test_rest_shape_of_six_strut_by_hand(structure: Structure, rest) -> None:
    """Parallel rods half a rod apart: all tendons sqrt(3/8) of a rod, the top triangle sqrt(3)/2 of a rod up."""
    position = find_rest_shape(structure)
    np.testing.assert_allclose(structure.tendon_length_m(position), 0.3 * np.sqrt(3 / 8), atol=1e-5)
    np.testing.assert_allclose(member_length_m(position, structure.rods), 0.3, atol=1e-5)
    np.testing.assert_allclose(position[[5, 8, 11], 2], 0.3 * np.sqrt(3) / 2, atol=1e-4)


def test_rest_shape_of_prism_turns_by_150_degrees() -> None:
    prism = three_strut(0.3, 0.18)
    position = find_rest_shape(prism)
    centre = position[:3].mean(axis=0)
    angle = np.rad2deg(np.arctan2(*(position[3] - centre)[[1, 0]]) - np.arctan2(*(position[0] - centre)[[1, 0]]))
    assert angle % 360 == pytest.approx(150, abs=0.1)
    np.testing.assert_allclose(member_length_m(position, prism.rods), 0.3, atol=1e-5)


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


def test_length_jacobian(structure: Structure, rest, check_jacobian) -> None:
    members = np.concatenate([structure.rods, structure.tendons])
    position = rest.node_position_m + 0.01 * np.random.default_rng(1).standard_normal((12, 3))
    check_jacobian(lambda x: member_length_m(x, members), length_jacobian(position, members), position)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 3.0), st.floats(0.01, 0.3))
def test_any_six_strut_rests_on_its_base(rod_m: float, prestrain: float) -> None:
    structure = six_strut(rod_m, prestrain=prestrain)
    assert structure.natural_length_m[0] * (1 + prestrain) == pytest.approx(rod_m * np.sqrt(3 / 8))
    base = structure.anchor_position_m
    assert member_length_m(base, np.array([[0, 1], [1, 2], [0, 2]])) == pytest.approx(rod_m * np.sqrt(3 / 8))


def test_impossible_prism_is_refused() -> None:
    with pytest.raises(InputError, match="can not stand"):
        three_strut(0.1, 0.3)


def test_measured_rest_shape_keeps_rods_and_anchors(structure: Structure, rest) -> None:
    """Rods and anchors are exact, so the measured nodes move onto them, and their uncertainty shrinks alike."""
    noise = 0.0003 * np.random.default_rng(2).standard_normal((12, 3))
    found = rest_step(structure, None, rest.node_position_m + noise, RestSettings())
    assert found.source == "measured"
    np.testing.assert_allclose(member_length_m(found.node_position_m, structure.rods), 0.3, atol=2e-6)
    np.testing.assert_array_equal(found.node_position_m[:3], structure.anchor_position_m)
    along_rod = length_jacobian(found.node_position_m, structure.rods).reshape(6, -1)
    assert np.abs(np.diag(along_rod @ found.covariance_m2 @ along_rod.T)).max() < 1.1e-10
    error = np.linalg.norm(found.node_position_m - rest.node_position_m)
    assert error < np.linalg.norm(noise)


def test_found_rest_shape_says_so(structure: Structure) -> None:
    found = rest_step(structure, None, None, RestSettings())
    assert found.source == "found"
    lengths = found.lengths(structure, 2.0)
    assert lengths.sigma_m[5] > 0.001
