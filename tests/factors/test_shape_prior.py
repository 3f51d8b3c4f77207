"""The prior about the rest shape."""

import numpy as np

from graph_values import KEYS
from tensegraph.factors.shape_prior import shape_prior_factors


def test_no_shape_prior_when_it_is_infinite(rest) -> None:
    assert shape_prior_factors(range(3, 12), KEYS[0], rest.node_position_m, np.inf) == []
