"""What tests of estimators share."""

import numpy as np
import pytest

from tensegraph.models.structure.rest_shape import RestShape


@pytest.fixture(scope="module")
def press(example_structure, true_positions):
    """A press and its release: true shapes of the example trial, 6 to 9 s, and the rest shape as known."""
    t_s, positions = true_positions
    during = (t_s >= 6) & (t_s < 9)
    variance = np.full((12, 3), 0.0003**2)
    variance[example_structure.anchors] = 0
    rest = RestShape(example_structure, positions[during][0], np.diag(variance.ravel()), "measured")
    return t_s[during], positions[during], rest
