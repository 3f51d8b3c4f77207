"""The estimators that the network is compared with."""

import numpy as np
import pytest

from strips import T_S
from tensegraph.models.calibration.recordings import Recording
from tensegraph.models.calibration.strip_baselines import PolynomialEstimator, StaticEstimator


class TestBaselines:
    def test_static_curve_is_monotone_and_undoes_a_square(self) -> None:
        strain = 0.1 - 0.1 * np.cos(0.5 * T_S)
        curve = StaticEstimator.fit([Recording("a", T_S, strain, strain**2)], unified=False)
        assert (np.diff(curve.strain) >= 0).all()
        np.testing.assert_allclose(np.interp(0.01, curve.change, curve.strain), 0.1, atol=2e-3)

    def test_polynomial_knows_rates(self) -> None:
        """dR/R = strain + 0.3 d(strain)/dt: a static curve cannot do it, the polynomial can."""
        strain = 0.1 - 0.05 * np.cos(0.7 * T_S) - 0.05 * np.cos(1.9 * T_S)
        r = Recording("a", T_S, strain, strain + 0.3 * np.gradient(strain, T_S))
        static, polynomial = (kind.fit([r], unified=False) for kind in (StaticEstimator, PolynomialEstimator))
        assert polynomial.sigma < 0.2 * static.sigma
        estimate = polynomial.estimate(r.change[:, None], np.full((len(T_S), 1), 0.05))
        settled = r.settled
        assert np.std(estimate.strain[settled, 0] - strain[settled]) == pytest.approx(polynomial.sigma, rel=1e-6)


def test_a_curve_through_all_samples_still_has_a_sigma() -> None:
    """Fewer samples than knots: no error in training, and yet none of sigma zero, which scores are divided by."""
    few = Recording("a", T_S[::10], 0.1 + 0.01 * T_S[::10], 0.2 + 0.02 * T_S[::10])
    assert StaticEstimator.fit([few], unified=False).sigma > 0
    assert PolynomialEstimator.fit([few], unified=False).sigma > 0
