"""Figures of a calibration."""

from pathlib import Path

import numpy as np
import pytest

from tensegraph.io.figures.calibration_figures import write_errors_figure
from tensegraph.models.calibration.strips import StripRun


@pytest.mark.parametrize(("mean", "spread"), [(0.1, 0.01), (0.1, 0.0), (0.0, 0.0)])
def test_errors_that_are_far_from_zero_or_all_alike_are_drawn(tmp_path: Path, mean: float, spread: float) -> None:
    """They are ten of their own standard deviations off, as of another unit, or those of a strip that is stuck."""
    t_s = np.arange(0, 60, 0.02)
    strain = 0.1 + 0.05 * np.sin(t_s)
    error = mean + spread * np.random.default_rng(3).normal(size=t_s.size)
    sigma = np.full(t_s.size, 0.01)
    rate_per_s = 0.05 * np.cos(t_s)
    beyond = np.zeros(t_s.size, bool)
    run = StripRun("far", 0.05, t_s, strain, rate_per_s, strain + error, sigma, sigma, sigma, beyond)
    write_errors_figure({"LSTM": [run]}, tmp_path / "errors.png")
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")
