"""Shapes that no structure can have never reach a user as estimates."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Shape, Status
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.possible import PossibleShapes
from tensegraph.models.values.slip import Slip


@pytest.fixture
def shape(rest, structure, lengths_of) -> Shape:
    lengths = lengths_of(structure, rest.node_position_m)
    return Shape(0.0, rest.node_position_m, 1e-6 * np.eye(36), Status.OK, lengths)


def test_a_possible_shape_passes_unchanged(rest, shape: Shape) -> None:
    assert PossibleShapes(rest).check(shape) is shape


def moved(shape: Shape, node: int, by_m: float) -> Shape:
    position_m = shape.node_position_m.copy()
    position_m[node] += by_m
    return replace(shape, node_position_m=position_m)


@pytest.mark.parametrize(
    "change",
    [
        lambda shape: moved(shape, 5, np.nan),
        lambda shape: moved(shape, 5, 0.4),
        lambda shape: moved(shape, 5, 0.05),
        lambda shape: replace(shape, node_position_m=shape.node_position_m + 4000.0),
        lambda shape: replace(shape, covariance_m2=-shape.covariance_m2),
        lambda shape: replace(shape, covariance_m2=np.full((36, 36), np.inf)),
    ],
    ids=["not finite", "rod too long", "rod bent", "far away", "negative", "infinite"],
)
def test_an_impossible_shape_is_replaced_and_says_so(rest, shape: Shape, change) -> None:
    checked = PossibleShapes(rest).check(change(shape))
    assert checked.status == Status.FAILED
    np.testing.assert_array_equal(checked.node_position_m, rest.node_position_m)
    assert (checked.node_sigma_m >= rest.structure.rod_length_m.sum()).all()


def test_nothing_that_follows_from_an_impossible_shape_is_kept(rest, shape: Shape) -> None:
    told = ExternalLoads(np.ones((12, 3)), np.ones(12))
    slip = Slip(0.0, 3, np.array([0.1, 0.0, 0.0]), 0.01)
    checked = PossibleShapes(rest).check(replace(moved(shape, 5, 0.4), loads=told, slips=(slip,)))
    assert checked.loads is not None
    assert np.isnan(checked.loads.force_n).all()
    assert np.isinf(checked.loads.sigma_n).all()
    assert checked.slips == ()
    assert PossibleShapes(rest).check(moved(shape, 5, 0.4)).loads is None
