"""Scores of strips: by hand."""

import numpy as np
import pytest

from tensegraph.models.calibration.strip_scores import StripScore, by_speed, correlation_time_s
from tensegraph.models.calibration.strips import StripRun


def a_run(error, sigma=0.01, speed: float = float("nan"), name: str = "a") -> StripRun:
    error = np.asarray(error, dtype=np.float64)
    n = len(error)
    strain, zeros = np.linspace(0, 0.1, n), np.zeros(n)
    sigmas = np.full(n, sigma)
    flags = np.zeros(n, dtype=bool)
    t_s = 0.1 * np.arange(n)
    return StripRun(name, speed, t_s, strain, zeros, strain + error, sigmas, sigmas, zeros, flags)


class TestScores:
    def test_by_hand(self) -> None:
        """Errors 0, 0.01, -0.02, 0.03 at sigma 0.011: RMSE sqrt(0.0014 / 4), two inside one sigma, three in 1.96."""
        score = StripScore.of([a_run([0, 0.01, -0.02, 0.03], 0.011)])
        assert score.rmse == pytest.approx(np.sqrt(0.0014 / 4))
        assert score.coverage_68 == 0.5
        assert score.coverage_95 == 0.75
        assert score.r2 == pytest.approx(1 - (0.0014 / 4) / np.var(np.linspace(0, 0.1, 4)))

    def test_correlation_time_of_a_decaying_error(self) -> None:
        """An AR(1) error of phi = exp(-0.1 / 2) at 0.1 s is down to 1/e after 2 s."""
        rng, error = np.random.default_rng(1), np.zeros(20000)
        for k in range(1, len(error)):
            error[k] = np.exp(-0.05) * error[k - 1] + rng.standard_normal()
        assert correlation_time_s(a_run(error)) == pytest.approx(2.0, rel=0.15)

    def test_an_error_of_one_sample_correlates_with_itself_alone(self) -> None:
        assert correlation_time_s(a_run(np.array([0.01]))) == 0

    def test_groups_go_by_speed(self) -> None:
        runs = [a_run([0.0, 1.0], name="x"), a_run([0.0, 1.0], speed=0.2), a_run([0.0, 1.0], speed=0.0501)]
        assert list(by_speed(runs)) == ["speed 0.05 /s", "speed 0.2 /s", "irregular motion"]
