"""The scale of the network's sigma, from runs on recordings of strips."""

import numpy as np
import pytest

from tensegraph.models.calibration.calibrated_model import fit_sigma_scale
from tensegraph.models.calibration.recordings import CORRELATED_S
from tensegraph.models.calibration.strips import StripRun

SAMPLES = 500


def run(error: np.ndarray, spread: np.ndarray, correlated: float = 1.0) -> StripRun:
    """Return a run with these errors, so many of which count as one, and an unscaled sigma of 0.001."""
    same = np.zeros(SAMPLES)
    sigma = np.full(SAMPLES, 0.001)
    t_s = CORRELATED_S * np.arange(SAMPLES) / correlated
    return StripRun("s0", np.nan, t_s, same, same, error, sigma, sigma, spread, same > 0)


def test_the_scale_follows_the_spread() -> None:
    """Errors of 0.002 where a strip was moved little, and of 0.004 where it was moved four times as far: 10 s^0.5."""
    spread = np.where(np.arange(SAMPLES) < 250, 0.04, 0.16)
    rng = np.random.default_rng(3)
    error = 0.01 * np.sqrt(spread) * rng.permutation(np.repeat([-1.0, 1.0], 250))
    scale = fit_sigma_scale([run(error, spread)])
    np.testing.assert_allclose([scale.factor, scale.power], [10.0, 0.5], rtol=0.01)


def test_few_independent_errors_tell_little_of_the_power() -> None:
    """Two errors weigh the slope of log sigma by 2 n ln(8)^2 / 4 = 4.3 against 1 of the prior: 0.81."""
    spread = np.where(np.arange(SAMPLES) < 250, 0.02, 0.16)
    rng = np.random.default_rng(3)
    error = 0.01 * spread * rng.permutation(np.repeat([-1.0, 1.0], 250))
    assert fit_sigma_scale([run(error, spread)]).power == pytest.approx(1.0, abs=0.01)
    assert fit_sigma_scale([run(error, spread, correlated=250)]).power == pytest.approx(0.81, abs=0.02)


def test_the_scale_does_not_grow_where_a_strip_rests() -> None:
    """Errors of 0.004 at a spread of 0.04, and of 0.001 at one of 0.16: p would be -1, and sigma 0.05 at rest."""
    spread = np.where(np.arange(SAMPLES) < 250, 0.04, 0.16)
    rng = np.random.default_rng(3)
    error = 0.00016 / spread * rng.permutation(np.repeat([-1.0, 1.0], 250))
    scale = fit_sigma_scale([run(error, spread)])
    assert scale.power == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(scale.factor, 1e3 * np.sqrt(np.mean(error**2)), rtol=0.01)


def test_strips_moved_alike_tell_nothing_of_the_power() -> None:
    """A spread that is the same within a hundredth: b s^p was 2.7e21 s^30 on a triangle wave."""
    rng = np.random.default_rng(3)
    spread = 0.1 * (1 + 0.01 * rng.standard_normal(SAMPLES))
    scale = fit_sigma_scale([run(0.003 * rng.standard_normal(SAMPLES) * (spread / 0.1) ** 8, spread)])
    assert abs(scale.power) < 2
    np.testing.assert_allclose(scale.at(spread), 3.0, rtol=0.15)
