"""What tests of evaluation share."""

import numpy as np
import pytest

from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph.models.evaluation.metrics import evaluate


@pytest.fixture(scope="session")
def result():
    """Three frames with errors of 5, 0 and 13 mm."""
    structure = four_nodes()
    estimate = estimate_of(structure, moved([[3, 0, 4], [0, 0, 0], [0, 12, -5]]))
    rest = TRUE_M + np.array([[0, 0, 0]] * 3 + [[0, 0, 0.001]])
    return evaluate(rest, estimate, truth_of(3, rest_seconds=0.03))
