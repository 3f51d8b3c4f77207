"""Whether a robot stands on a face of its hull."""

from dataclasses import replace

import numpy as np
import pytest

from poses import any_state
from tensegraph.estimator.free_standing.watches.stand_watch import nearest_face
from tensegraph.models.pose.placed import PlacedShape
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.values.rotations import rotation


@pytest.mark.parametrize("sigmas", [0.5, 5.0])
def test_how_far_a_structure_is_from_lying_flat(sigmas: float) -> None:
    """By hand: turned about x by some of its standard deviations of 0.01 rad, e = (0, 0.3 rad) m, S = (0.3 sigma)^2."""
    body_m = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.1, 0.1, 0.2]])
    turn = rotation(np.array([0.01 * sigmas, 0.0, 0.0]))
    state = replace(any_state(0, 0), turn=turn, position_m=np.zeros(3))
    placed = PlacedShape(state, body_m, 1e-12 * np.eye(12))
    covariance = np.zeros((state.layout.size, state.layout.size))
    covariance[:3, :3] = 0.01**2 * np.eye(3)
    face, squared = nearest_face(placed, covariance, Floor(0.0, UP))
    assert np.flatnonzero(face).tolist() == [0, 1, 2]
    assert squared == pytest.approx(sigmas**2, rel=0.01)
