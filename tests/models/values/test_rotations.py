"""Rotations and rotation vectors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tensegraph.models.values.rotations import (
    across,
    best_rotation,
    cross,
    cross_matrix,
    rotation,
    rotation_vector,
    shortest_rotation,
)

VECTORS = arrays(np.float64, 3, elements=st.floats(-1.7, 1.7, allow_subnormal=False))


def test_a_quarter_turn_about_z_turns_x_into_y() -> None:
    turn = rotation(np.array([0, 0, np.pi / 2]))
    assert turn @ [1.0, 0, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert rotation_vector(turn) == pytest.approx([0, 0, np.pi / 2])


@given(VECTORS)
def test_the_vector_of_a_rotation_is_the_vector_it_was_made_of(w) -> None:
    turn = rotation(w)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
    assert rotation_vector(turn) == pytest.approx(w, abs=1e-7)


@given(VECTORS, VECTORS)
def test_the_cross_product_is_that_of_numpy(v, u) -> None:
    assert cross_matrix(v) @ u == pytest.approx(np.cross(v, u), abs=1e-12)
    assert cross(v, np.stack([u, v])) == pytest.approx(np.stack([np.cross(v, u), np.zeros(3)]), abs=1e-12)


@given(VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_two_vectors_across_a_vector_are_across_each_other(v) -> None:
    u = v / np.linalg.norm(v)
    frame = np.vstack([u, across(u)])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)


def test_across_an_axis_are_the_other_axes() -> None:
    """By hand; the sign of zero tells on which side the reflection is, and both are across."""
    x = np.array([[1.0, 0, 0], [0.0, 0, 1], [-0.0, 0, 1]])
    assert across(x) == pytest.approx(
        np.array([[[0, 1, 0], [0, 0, 1]], [[0, 1, 0], [-1, 0, 0]], [[0, 1, 0], [1, 0, 0]]])
    )


@given(VECTORS)
def test_the_best_rotation_is_found_again(w) -> None:
    points = np.random.default_rng(1).standard_normal((5, 3))
    points -= points.mean(axis=0)
    assert best_rotation(points, points @ rotation(w).T) == pytest.approx(rotation(w), abs=1e-9)


def test_the_shortest_rotation_turns_by_the_angle_between() -> None:
    u, v = np.array([0, 0, 1.0]), np.array([0.6, 0, 0.8])
    turn = shortest_rotation(u, v)
    assert turn @ u == pytest.approx(v)
    assert np.linalg.norm(rotation_vector(turn)) == pytest.approx(np.arccos(0.8))
    assert shortest_rotation(u, -u) @ u == pytest.approx(-u)
    assert shortest_rotation(u, u) == pytest.approx(np.eye(3))
