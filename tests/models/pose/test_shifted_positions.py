"""Positions of a structure that hangs are told apart from its anchors where their frame has jumped."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import six_strut
from tensegraph.models.pose.position_gate import are_shifted
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.structure import Structure
from tensegraph.models.values.aids import OwnFrame, PositionReading
from tensegraph.models.values.rotations import rotation

SEEN = (4, 5, 8, 11)
SIGMA_M = 5e-4
SHAPE_M2 = 1e-6 * np.eye(36)
REST_M = find_rest_shape(six_strut(0.3))


def hung(anchors: int) -> Structure:
    six = six_strut(0.3)
    return replace(six, anchors=np.arange(anchors), anchor_position_m=REST_M[:anchors])


def readings(position_m: np.ndarray, frame: OwnFrame | None = None) -> list[PositionReading]:
    return [PositionReading(0.0, node, position_m[node], 0, frame) for node in SEEN]


def swung(structure: Structure, angle_rad: float) -> np.ndarray:
    """The rest shape, turned about the line of the anchors, or about x through the one."""
    pivot_m = structure.anchor_position_m[0]
    return pivot_m + (REST_M - pivot_m) @ rotation(np.array([angle_rad, 0.0, 0.0])).T


@pytest.mark.parametrize("anchors", [1, 2])
@pytest.mark.parametrize("angle_rad", [0.0, 1.0])
def test_a_swing_is_no_shift_and_a_jump_of_the_frame_is_one(anchors, angle_rad) -> None:
    structure = hung(anchors)
    true_m = swung(structure, angle_rad)
    for expected_m in (true_m, REST_M):  # whatever the pose is taken for
        assert not are_shifted(readings(true_m), structure, expected_m, SHAPE_M2, SIGMA_M)
        for axis in np.eye(3):
            told = readings(true_m + 0.03 * axis)
            assert are_shifted(told, structure, expected_m, SHAPE_M2, SIGMA_M)


def test_what_the_shape_or_the_frame_leaves_open_is_no_shift() -> None:
    structure = hung(1)
    told = readings(REST_M + 0.03 * np.eye(3)[0])
    assert not are_shifted(told, structure, REST_M, 1e-3 * np.eye(36), SIGMA_M)
    frame = OwnFrame(0, np.eye(3), np.zeros(3), REST_M[0], 0.01 * np.eye(6))
    assert not are_shifted(readings(REST_M + 0.03 * np.eye(3)[0], frame), structure, REST_M, SHAPE_M2, SIGMA_M)


def test_without_anchors_or_other_nodes_than_these_nothing_is_told() -> None:
    told = readings(REST_M + 0.03 * np.eye(3)[0])
    assert not are_shifted(told, hung(0), REST_M, SHAPE_M2, SIGMA_M)
    at_anchor = [PositionReading(0.0, 0, REST_M[0] + 0.03, 0)]
    assert not are_shifted(at_anchor, hung(1), REST_M, SHAPE_M2, SIGMA_M)
