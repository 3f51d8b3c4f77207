"""Slips, and the slides that they are pieces of."""

import numpy as np
import pytest

from tensegraph.models.values.slip import Slip, slides


def test_pieces_of_one_slide_add_up() -> None:
    """By hand: node 2 goes 3 mm along x and then 4 mm along y, 5 mm in all; a second later it slides anew."""
    x, y = np.array([0.003, 0, 0]), np.array([0, 0.004, 0])
    slips = [Slip(1.0, 2, x, 0.001), Slip(1.1, 5, x, 0.001), Slip(1.2, 2, y, 0.001), Slip(2.2, 2, x, 0.001)]
    found = slides(slips)
    assert [(slip.t_s, slip.node) for slip in found] == [(1.0, 2), (1.1, 5), (2.2, 2)]
    assert found[0].distance_m == pytest.approx(0.005)
    assert found[0].sigma_m == pytest.approx(np.sqrt(2) * 0.001)
    assert found[2].distance_m == pytest.approx(0.003)


def test_a_foot_that_has_hardly_moved_has_not_slipped() -> None:
    """5 mm with a sigma of 6 mm is none, and 5 mm with 2 mm is one."""
    way_m = np.array([0.003, 0.004, 0])
    assert [slip.node for slip in slides([Slip(1.0, 2, way_m, 0.006), Slip(1.0, 4, way_m, 0.002)])] == [4]
