"""The benchmark of causes: its own count."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tensegraph.models.evaluation.truth import Fault

CAUSES = Path(__file__).parents[2] / "benchmarks" / "causes.py"


def test_sensors_left_out_for_longer_than_a_second_count() -> None:
    """The benchmark's own count: 0.9 s is a moment, 1.1 s is not; a board that is unplugged excuses its sensors."""
    benchmark = runpy.run_path(str(CAUSES))
    t_s = np.arange(500) * 0.02
    sigma_m = np.full((500, 4), 0.001)
    sigma_m[100:146, 0] = sigma_m[100:156, 1] = sigma_m[300:400, 2] = sigma_m[:, 3] = np.inf
    estimate = SimpleNamespace(t_s=t_s, sigma_m=sigma_m)
    gap = Fault("unplugged", "board 0", np.array([2]), t_s[300], t_s[400])
    dead = Fault("open_circuit", "tendon 3", np.array([3]), 1.0, 2.0)
    assert benchmark["left_out_share"](estimate, [gap, dead]) == pytest.approx(1 / 3)
    assert benchmark["left_out_share"](estimate, []) == pytest.approx(3 / 4)
