"""Honesty, measured on estimates that are honest by construction."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from four_nodes import TRUE_M, estimate_of, four_nodes, truth_of
from tensegraph.models.evaluation.consistency import (
    coverage,
    independent_count,
    mean_band,
    normalised_error_squared,
    whitened,
)
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.structure.shape import Covariances


class TestConsistency:
    def toy(self, structure, count=600, correlation=0.0, scale=1.0, seed=0, lasting=0.0):
        """Errors drawn from the covariance, each `correlation` times the one before and a fresh part.

        The share `lasting` of the variance is that of an error that never changes.
        """
        rng = np.random.default_rng(seed)
        root = 1e-3 * np.array([[1.0, 0, 0], [0.5, 2.0, 0], [-0.3, 0.2, 0.7]])
        fresh, error = rng.standard_normal((count, 3)), np.empty((count, 3))
        error[0] = fresh[0]
        for k in range(1, count):
            error[k] = correlation * error[k - 1] + np.sqrt(1 - correlation**2) * fresh[k]
        error = np.sqrt(lasting) * rng.standard_normal(3) + np.sqrt(1 - lasting) * error
        position = np.repeat(TRUE_M[None], count, axis=0)
        position[:, 3] += error @ root.T
        estimate = estimate_of(structure, position)
        covariance = np.broadcast_to(scale * root @ root.T, (count, 4, 3, 3))
        told = replace(estimate, covariances=Covariances.of_nodes(covariance))
        return evaluate(TRUE_M, told, truth_of(count)).consistency

    def inside(self, **toy) -> float:
        """The share of 40 toys whose NEES is in its band."""
        scores = [self.toy(four_nodes(), seed=seed, **toy) for seed in range(40)]
        return float(np.mean([c.nees_band[0, 0] <= c.nees[0] <= c.nees_band[0, 1] for c in scores]))

    @pytest.mark.parametrize("correlation", [0.0, 0.95])
    def test_nees_of_a_linear_gaussian_toy_is_in_its_band(self, correlation) -> None:
        assert self.inside(correlation=correlation) > 0.8  # 0.95 of 40, less four of its sigmas

    @pytest.mark.parametrize("lasting", [0.5, 0.9, 1.0])
    def test_an_error_that_lasts_makes_the_band_wide(self, lasting) -> None:
        """Of many toys 0.8 are in it, and 0.95 of those in which all lasts: where a lasting error is small by chance,
        NEES seems too small. With the autocorrelation of NEES about its own mean it was 0.1 of those with a lasting
        half.
        """
        assert self.inside(lasting=lasting) > 0.65  # 0.8 of 40, less two and a half of its sigmas

    @pytest.mark.parametrize("correlation", [0.0, 0.95])
    def test_ellipsoids_half_as_large_are_out_of_their_band_however_errors_are_correlated(self, correlation) -> None:
        assert self.inside(correlation=correlation, scale=0.25) == 0

    def test_overconfidence_is_out_of_its_band(self) -> None:
        c = self.toy(four_nodes(), scale=0.5)
        assert c.nees[0] > c.nees_band[0, 1]
        assert c.coverage_95 < 0.85

    def test_coverage_of_an_honest_toy(self) -> None:
        c = self.toy(four_nodes(), count=4000)
        assert (c.coverage_50, c.coverage_68, c.coverage_95) == pytest.approx((0.5, 0.68, 0.95), abs=0.03)

    def test_band_of_one_hundred_by_table(self) -> None:
        """Chi-square with 300 degrees: 2.5 % below 253.91, 97.5 % below 349.87."""
        assert mean_band(3, 100) == pytest.approx((2.5391, 3.4987), abs=1e-4)

    def test_the_square_of_a_whitened_error_is_nees(self) -> None:
        """It is not known where the covariance is singular."""
        rng = np.random.default_rng(2)
        root, error = rng.standard_normal((50, 3, 3)), rng.standard_normal((50, 3))
        covariance = root @ np.swapaxes(root, 1, 2)
        nees = normalised_error_squared(error, covariance)
        np.testing.assert_allclose((whitened(error, covariance) ** 2).sum(axis=1), nees, rtol=1e-6)
        assert np.isnan(whitened(error[:1], np.diag([1.0, 1.0, 0.0])[None])).all()

    def test_independent_count(self) -> None:
        """White noise counts in full; squares of AR(1) have rho^2k, which sums to n (1 - rho^2) / (1 + rho^2).

        Errors that never change count once, and those of which half the variance never changes, 4 times: r^2 = 1 / 4.
        """
        rng = np.random.default_rng(1)
        white = rng.standard_normal((4000, 3))
        assert independent_count(white) == pytest.approx(4000, rel=0.05)
        x = np.zeros(40_000)
        for k in range(1, len(x)):
            x[k] = 0.9 * x[k - 1] + rng.standard_normal()
        assert independent_count(x[:, None]) == pytest.approx(len(x) * (1 - 0.81) / (1 + 0.81), rel=0.3)
        assert independent_count(np.ones((5, 3))) == pytest.approx(1)
        assert independent_count(white + np.array([1, -1, 1])) == pytest.approx(4, rel=0.1)
        assert independent_count(np.array([[np.nan, 1.0]])) == 0

    @given(st.lists(st.floats(0, 50), min_size=1), st.floats(0.01, 0.98), st.floats(0.01, 0.98))
    def test_a_larger_ellipsoid_holds_no_less(self, nees, one, other) -> None:
        low, high = sorted((one, other))
        assert 0 <= coverage(np.array(nees), low) <= coverage(np.array(nees), high) <= 1
