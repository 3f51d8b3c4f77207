"""The face on which a structure rests, by its shape alone."""

import numpy as np
import pytest
from scipy.stats import norm

from tensegraph.estimator.free_standing.stable_face import CENTRE_M, StableFace
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.readings import TendonLengths

FLOOR = Floor(0.0, UP)
BASE_M = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]])


def shape(top_m: list[list[float]], sigma_m: float = 0.0) -> Shape:
    """Return a shape with three nodes of the base on the floor, and others."""
    x = np.concatenate([BASE_M, top_m])
    none = np.zeros(0)
    lengths = TendonLengths(t_s=0.0, length_m=none, sigma_m=none, mode=none, flags=none)
    return Shape(0.0, x, sigma_m**2 * np.eye(x.size), Status.OK, lengths)


def nodes(stands) -> list[int]:
    return np.flatnonzero(stands.nodes).tolist()


def test_a_structure_stays_where_its_centroid_is_above_the_face() -> None:
    """Centroid at (0.1, 0.1): 0.1 m inside two edges, and 0.1 / sqrt(2) inside the third. All that has no doubt."""
    stands = StableFace(FLOOR).observe(shape([[0.1, 0.1, 0.2]]))
    assert nodes(stands) == [0, 1, 2]
    assert stands.assumed
    assert stands.others == ()
    assert stands.probability == pytest.approx([1, 1, 1, 0], abs=1e-9)


def test_it_tips_over_the_edge_that_its_centroid_leaves_and_does_not_come_back_at_once() -> None:
    """The top goes out over the edge 0 1, which is at y = 0; the centroid leaves it when y of the top is -0.3."""
    face = StableFace(FLOOR)
    assert nodes(face.observe(shape([[0.1, -0.28, 0.2]]))) == [0, 1, 2]
    assert nodes(face.observe(shape([[0.1, -0.32, 0.2]]))) == [0, 1, 3]
    assert nodes(face.observe(shape([[0.1, -0.28, 0.2]]))) == [0, 1, 3]


def test_a_node_that_comes_down_stands_in_place_of_one_that_is_lifted() -> None:
    """A fourth node at (0.2, 0.2) goes below the floor. Its faces are 0 1 3 and 0 2 3, or 1 2 3 with the others."""
    face = StableFace(FLOOR)
    assert nodes(face.observe(shape([[0.2, 0.2, 0.01], [0.05, 0.05, 0.2]]))) == [0, 1, 2]
    assert 3 in nodes(face.observe(shape([[0.2, 0.2, -0.01], [0.05, 0.05, 0.2]])))


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
def test_the_face_beyond_an_edge_is_as_likely_as_the_centre_of_mass_is_outside(sigma_m: float) -> None:
    """Centroid 12.5 mm inside the edge 0 1: the face 0 1 3 has the share of a normal distribution beyond that."""
    stands = StableFace(FLOOR).observe(shape([[0.1, -0.25, 0.2]], sigma_m))
    expected = norm.cdf(-0.0125 / np.hypot(CENTRE_M, sigma_m))
    share, other = next((share, other) for share, other in stands.others if other[3] and other[0] and other[1])
    assert np.flatnonzero(other).tolist() == [0, 1, 3]
    assert share == pytest.approx(expected, rel=1e-6)
    assert stands.probability[3] >= share - 1e-9


def test_a_flat_shape_does_not_stop_it() -> None:
    """An absurd estimate, all nodes on the floor, is no hull; some three nodes are told."""
    assert len(nodes(StableFace(FLOOR).observe(shape([[0.1, 0.1, 0.0], [0.2, 0.2, 0.0]])))) == 3


def test_the_face_that_sensors_have_told_is_kept() -> None:
    """Turned onto the face beyond the edge 0 1 by hand, while its shape stays: it rests there when sensors end."""
    face, upright = StableFace(FLOOR), shape([[0.1, 0.1, 0.2]])
    assert nodes(face.observe(upright)) == [0, 1, 2]
    inward = np.cross([0.3, 0, 0], [0.1, 0.1, 0.2])
    face.turned_to(-inward / np.linalg.norm(inward) * np.sign(inward @ [0, -1, 0]))
    assert nodes(face.observe(upright)) == [0, 1, 3]
