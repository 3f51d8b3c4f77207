"""The figures of a comparison, where methods have no numbers."""

import numpy as np
import pytest

from tensegraph.io.figures.comparison_figure import write_comparison_figure, write_spread_figure
from tensegraph.models.evaluation.comparison import Measured
from tensegraph.scoring.method_scores import by_method, comparison_rows


@pytest.mark.parametrize("write", [write_comparison_figure, write_spread_figure])
def test_methods_that_were_not_run_leave_empty_panels(write, tmp_path) -> None:
    """A logarithmic axis needs a number."""
    not_run = [Measured(trial, "UKF", 4, np.nan, None, "not run") for trial in ("one", "two")]
    write(comparison_rows(by_method(not_run)), {}, tmp_path / "comparison.png")
    assert (tmp_path / "comparison.png").stat().st_size > 1000
