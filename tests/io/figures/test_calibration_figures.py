"""Figures of a calibration."""

from pathlib import Path

import numpy as np

from tensegraph.io.figures.calibration_figures import write_errors_figure
from tensegraph.models.calibration.strips import StripRun


def test_errors_that_are_far_from_zero_are_drawn(tmp_path: Path) -> None:
    """All errors are ten of their own standard deviations off, as of a recording with another unit."""
    t_s = np.arange(0, 60, 0.02)
    strain = 0.1 + 0.05 * np.sin(t_s)
    error = 0.1 + 0.01 * np.random.default_rng(3).normal(size=t_s.size)
    sigma = np.full(t_s.size, 0.01)
    rate_per_s = 0.05 * np.cos(t_s)
    beyond = np.zeros(t_s.size, bool)
    run = StripRun("far", 0.05, t_s, strain, rate_per_s, strain + error, sigma, sigma, sigma, beyond)
    write_errors_figure({"LSTM": [run]}, tmp_path / "errors.png")
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")
