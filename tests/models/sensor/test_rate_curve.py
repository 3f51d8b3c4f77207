"""The curve that knows rates, as fitted and as evaluated."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strips import T_S
from tensegraph.models.calibration.rate_curve_fit import fit_rate_curve
from tensegraph.models.calibration.recordings import Recording
from tensegraph.models.sensor.gauge import StaticGauge
from tensegraph.models.sensor.rate_curve import RateCurve, product_indices


class TestRateCurve:
    gauge = StaticGauge(np.array([0.0, 0.1, 0.4]), np.array([0.0, 0.1, 0.3]), 0.05, 0.003)

    def fitted(self) -> tuple[Recording, RateCurve]:
        strain = 0.1 - 0.05 * np.cos(0.7 * T_S) - 0.05 * np.cos(1.9 * T_S)
        r = Recording("a", T_S, strain, strain + 0.3 * np.gradient(strain, T_S))
        return r, fit_rate_curve([r], self.gauge, np.array([0.3, 2.0]), unified=False)

    def test_knows_rates(self) -> None:
        r, curve = self.fitted()
        error = (curve.estimate(r.change, r.running_means(curve.memory_s))[0] - r.strain)[r.settled]
        assert np.std(error) < 0.2 * np.std((self.gauge.stretched_strain(r.change) - r.strain)[r.settled])

    def test_its_sigma_does_not_depend_on_the_sampling_rate(self) -> None:
        """The same motion, with errors that last, at 20 and at 200 Hz."""
        sigma = []
        for t_s in (T_S, np.arange(T_S[0], T_S[-1], 0.1 * (T_S[1] - T_S[0]))):
            strain = 0.1 - 0.05 * np.cos(0.7 * t_s) - 0.05 * np.cos(1.9 * t_s)
            r = Recording("a", t_s, strain, strain + 0.3 * np.gradient(strain, t_s) + 0.003 * np.sin(0.3 * t_s))
            curve = fit_rate_curve([r], self.gauge, np.array([0.3, 2.0]), unified=False)
            sigma.append(np.median(curve.estimate(r.change, r.running_means(curve.memory_s))[1][r.settled]))
        assert sigma[1] == pytest.approx(sigma[0], rel=0.1)

    def test_one_coefficient_by_hand(self) -> None:
        """Of the products of 1, y and y - m, only the one of y - m counts: 0.5 (y - m) / 0.2; w = 1."""
        products = product_indices(2).tolist()
        coefficients = np.zeros(len(products) + 1)
        coefficients[products.index([0, 0, 2])], coefficients[-1] = 0.5, 1.0
        curve = RateCurve(
            self.gauge,
            np.array([2.0]),
            np.array([1.0, 0.2]),
            np.array([[0.0, -1.0], [0.3, 1.0]]),
            coefficients,
            np.diag(0.01 * (coefficients > 0)),
        )
        strain, sigma = curve.estimate(np.array(0.2), np.array([0.16]))
        assert sigma == pytest.approx(np.hypot(0.01 * 0.2, 0.01 * 0.25))
        assert strain == pytest.approx(0.25 + 0.1)

    def test_is_unsure_where_no_recording_reached(self) -> None:
        r, curve = self.fitted()
        means = r.running_means(curve.memory_s)
        inside = curve.estimate(r.change, means)[1][r.settled]
        assert curve.estimate(np.array(0.1), np.array([0.4, 0.4]))[1] > 10 * np.median(inside)

    @given(st.floats(0.01, 0.2))
    def test_goes_on_as_the_static_curve_does_beyond_its_range(self, farther: float) -> None:
        _, curve = self.fitted()
        end = curve.range[1, 0]
        means = np.full(2, end)
        beyond = curve.estimate(np.array(end + farther), means + farther)[0] - curve.estimate(np.array(end), means)[0]
        static = self.gauge.stretched_strain(end + farther) - self.gauge.stretched_strain(end)
        assert beyond == pytest.approx(static, abs=1e-9)
