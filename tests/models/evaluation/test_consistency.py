"""Honesty, measured on estimates that are honest by construction."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from four_nodes import TRUE_M, estimate_of, four_nodes, truth_of
from tensegraph.models.evaluation.consistency import coverage, independent_count, mean_band
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.structure.shape import Covariances


class TestConsistency:
    def toy(self, structure, count=600, correlation=0.0, scale=1.0, seed=0):
        """Errors drawn from the covariance, each `correlation` times the one before and a fresh part."""
        rng = np.random.default_rng(seed)
        root = 1e-3 * np.array([[1.0, 0, 0], [0.5, 2.0, 0], [-0.3, 0.2, 0.7]])
        fresh, error = rng.standard_normal((count, 3)), np.empty((count, 3))
        error[0] = fresh[0]
        for k in range(1, count):
            error[k] = correlation * error[k - 1] + np.sqrt(1 - correlation**2) * fresh[k]
        position = np.repeat(TRUE_M[None], count, axis=0)
        position[:, 3] += error @ root.T
        estimate = estimate_of(structure, position)
        covariance = np.broadcast_to(scale * root @ root.T, (count, 4, 3, 3))
        told = replace(estimate, covariances=Covariances.of_nodes(covariance))
        return evaluate(TRUE_M, told, truth_of(count)).consistency

    @pytest.mark.parametrize("correlation", [0.0, 0.95])
    def test_nees_of_a_linear_gaussian_toy_is_in_its_band(self, correlation) -> None:
        structure = four_nodes()
        inside = [
            band[0] <= nees <= band[1]
            for c in (self.toy(structure, correlation=correlation, seed=seed) for seed in range(40))
            for nees, band in zip(c.nees, c.nees_band, strict=True)
        ]
        assert np.mean(inside) > 0.8  # 0.95 of 40, less four of its sigmas

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

    def test_independent_count(self) -> None:
        """White noise counts in full; squares of AR(1) have rho^2k, which sums to n (1 - rho^2) / (1 + rho^2)."""
        rng = np.random.default_rng(1)
        assert independent_count(rng.standard_normal(4000)) == pytest.approx(4000, rel=0.25)
        x = np.zeros(40_000)
        for k in range(1, len(x)):
            x[k] = 0.9 * x[k - 1] + rng.standard_normal()
        assert independent_count(x**2) == pytest.approx(len(x) * (1 - 0.81) / (1 + 0.81), rel=0.3)
        assert independent_count(np.ones(5)) == 1
        assert independent_count(np.array([])) == 0

    @given(st.lists(st.floats(0, 50), min_size=1), st.floats(0.01, 0.98), st.floats(0.01, 0.98))
    def test_a_larger_ellipsoid_holds_no_less(self, nees, one, other) -> None:
        low, high = sorted((one, other))
        assert 0 <= coverage(np.array(nees), low) <= coverage(np.array(nees), high) <= 1
