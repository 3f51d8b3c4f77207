"""The rest shape by form finding."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph import IndeterminateError, InputError, Structure, six_strut, three_strut
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.lengths import member_length_m
from tensegraph.models.values.rotations import rotation


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


@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 3.0), st.floats(0.01, 0.3))
def test_any_six_strut_rests_on_its_base(rod_m: float, prestrain: float) -> None:
    structure = six_strut(rod_m, prestrain=prestrain)
    assert structure.natural_length_m[0] * (1 + prestrain) == pytest.approx(rod_m * np.sqrt(3 / 8))
    base = structure.anchor_position_m
    assert member_length_m(base, np.array([[0, 1], [1, 2], [0, 2]])) == pytest.approx(rod_m * np.sqrt(3 / 8))


def test_on_which_side_of_a_wall_a_structure_is_has_to_be_told(structure: Structure, rest) -> None:
    """Anchors turned by 60 degrees about x, and by 30, which is a slope."""
    for degrees, is_wall in ((60.0, True), (30.0, False)):
        turn = rotation(np.deg2rad(degrees) * np.array([1.0, 0.0, 0.0]))
        turned = replace(structure, anchor_position_m=structure.anchor_position_m @ turn.T)
        if is_wall:
            with pytest.raises(IndeterminateError, match=r"on a wall, .*: expected structure\.node_position_m"):
                find_rest_shape(turned)
        near_m = rest.node_position_m @ turn.T if is_wall else None
        np.testing.assert_allclose(find_rest_shape(turned, near_m), rest.node_position_m @ turn.T, atol=1e-4)


def test_impossible_prism_is_refused() -> None:
    with pytest.raises(InputError, match="expected at least 1 stage of rods longer"):
        three_strut(0.1, 0.3)


def test_joined_nodes_at_one_place_are_refused(structure: Structure, rest) -> None:
    """A tendon without length has no direction along which it pulls."""
    a, b = next(pair for pair in structure.tendons.tolist() if not set(pair) & set(structure.anchors))
    near_m = rest.node_position_m.copy()
    near_m[b] = near_m[a]
    with pytest.raises(IndeterminateError, match=f"nodes {a} and {b} are joined and at one place"):
        find_rest_shape(structure, near_m)


def test_three_nodes_without_anchors_have_no_face_to_stand_on() -> None:
    triangle = Structure(
        rods=np.array([[0, 1]]),
        tendons=np.array([[1, 2], [0, 2]]),
        rod_length_m=np.array([0.3]),
        natural_length_m=np.array([0.18, 0.18]),
        anchors=np.zeros(0, dtype=np.int64),
        anchor_position_m=np.zeros((0, 3)),
    )
    with pytest.raises(IndeterminateError, match="3 nodes have no hull"):
        find_rest_shape(triangle)
