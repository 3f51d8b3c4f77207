"""The strain of a bent tendon, eq. (9)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import InputError
from tensegraph.models.sensor.bending import COEFFICIENTS, BendingCurve, FoldedPolynomial


class TestBending:
    def test_fold_by_hand(self) -> None:
        """x_c solves f' = 0 and y_c = f(x_c): -0.0300747 and 0.0063545, less f(0) = -0.0016."""
        polynomial = FoldedPolynomial()
        assert polynomial.x_fold == pytest.approx(-0.0300747283, abs=1e-9)
        assert polynomial.y_fold - 0.0016 == pytest.approx(0.0063544826, abs=1e-9)

    @given(st.floats(-1.0, -0.0301))
    def test_inverse_undoes_it(self, x: float) -> None:
        polynomial = FoldedPolynomial()
        assert polynomial.inverse(polynomial.value(x)) == pytest.approx(x, abs=1e-9)

    def test_slope(self, check_jacobian) -> None:
        polynomial, x = FoldedPolynomial(), np.linspace(-0.95, -0.05, 9)
        check_jacobian(polynomial.value, np.diag(polynomial.slope(x)), x)

    def test_sigma_is_finite_at_the_fold_and_linear_away_from_it(self) -> None:
        curve = BendingCurve()
        _, sigma = curve.strain(np.array([-0.5, curve.polynomial.y_fold]), 0.004)
        assert sigma[0] == pytest.approx(0.004 / curve.polynomial.slope(curve.polynomial.inverse(-0.5)), rel=1e-6)
        assert sigma[1] == pytest.approx(np.sqrt(0.004 / 8.23), rel=1e-3)

    @pytest.mark.parametrize("abscissa", ["strain", "resistance"])
    def test_both_readings_go_there_and_back(self, abscissa) -> None:
        curve, strain = BendingCurve(abscissa), np.array([-0.8, -0.4, -0.1])
        np.testing.assert_allclose(curve.strain(curve.change(strain), 0.001)[0], strain, atol=1e-6)

    def test_the_two_readings_differ(self) -> None:
        """At dR/R = -0.5: strain -0.434 (x = strain) and -0.574 (x = dR/R), up to the constant term."""
        assert BendingCurve("strain").strain(-0.5, 0.01)[0] == pytest.approx(-0.434, abs=2e-3)
        assert BendingCurve("resistance").strain(-0.5, 0.01)[0] == pytest.approx(-0.574, abs=2e-3)

    def test_a_minimum_before_the_fold_is_where_it_begins(self) -> None:
        """By hand: f' = -(x + 0.7)(x + 0.05), a minimum at -0.7 and the fold at -0.05."""
        polynomial = FoldedPolynomial([-1 / 3, -0.375, -0.035, 0.0])
        assert (polynomial.x_min, polynomial.x_fold) == pytest.approx((-0.7, -0.05))
        assert polynomial.inverse(polynomial.value(-0.5)) == pytest.approx(-0.5, abs=1e-9)
        assert polynomial.inverse(-9.0) == pytest.approx(-0.7)

    @pytest.mark.parametrize(
        "coefficients",
        [-np.array(COEFFICIENTS), np.zeros(6), [-1.0, 0.0], [-1.0, -1.8, 0.0]],
        ids=["rises from -0.03 on", "flat", "falls", "folds at -0.9"],
    )
    def test_what_does_not_rise_is_refused(self, coefficients) -> None:
        with pytest.raises(InputError, match=r"bending curve: expected a polynomial that rises about -0\.1, got -"):
            FoldedPolynomial(coefficients)

    def test_range(self) -> None:
        assert BendingCurve().in_range([-0.94, -0.95]).tolist() == [True, False]
