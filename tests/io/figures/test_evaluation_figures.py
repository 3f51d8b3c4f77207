"""Figures of an evaluation where an axis would have no extent."""

import numpy as np
import pytest

from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph.io.figures.evaluation_figures import write_errors_figure, write_heights_figure
from tensegraph.models.evaluation.metrics import evaluate


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("errors", [[[0, 0, 0]] * 3, [[0, 0, 0]], [[3, 0, 0]]], ids=["exact", "one, exact", "one"])
def test_no_warning_of_matplotlib(errors, tmp_path) -> None:
    structure = four_nodes()
    evaluation = evaluate(TRUE_M, estimate_of(structure, moved(errors)), truth_of(3))
    assert len(evaluation.compared.t_s) == np.shape(errors)[0]
    for write in (write_errors_figure, write_heights_figure):
        write(evaluation, "trial", tmp_path / "figure.png")
        assert (tmp_path / "figure.png").stat().st_size > 10_000
