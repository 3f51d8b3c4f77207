"""The fit of eq. (9)."""

import numpy as np
import pytest

from strips import triangle
from tensegraph import InputError
from tensegraph.models.calibration.bending_fit import fit_bending
from tensegraph.models.calibration.recordings import Recording
from tensegraph.models.sensor.bending import COEFFICIENTS, FoldedPolynomial


class TestBendingFit:
    T_S = np.arange(0, 200, 0.05)

    def recording(self, noise: float = 0.0, seed: int = 0) -> Recording:
        """A static strip that follows eq. (9), less its constant, bent by 0.8 and back."""
        strain = triangle("bend", 0.02, high=-0.8, t_s=self.T_S).strain
        change = np.polyval([*COEFFICIENTS[:-1], 0.0], strain)
        return Recording(
            "bend", self.T_S, strain, change + noise * np.random.default_rng(seed).standard_normal(len(change))
        )

    def test_eq_9_is_found_again(self) -> None:
        """Up to the lag that is undone but was not there, 0.2 s of 0.02 /s: the curve runs between the branches."""
        recording = self.recording()
        fit = fit_bending([recording], [recording])
        assert fit is not None
        strain = np.linspace(-0.8, 0, 50)
        expected = np.polyval([*COEFFICIENTS[:-1], 0.0], strain)
        np.testing.assert_allclose(np.polyval(fit.coefficients, strain), expected, atol=0.005)
        assert fit.r2 > 0.9995
        assert fit.held_out_r2 == pytest.approx(fit.r2, abs=1e-6)
        assert fit.curve().polynomial.x_fold == pytest.approx(FoldedPolynomial().x_fold, abs=0.01)

    def test_a_resistance_that_does_not_change_is_refused(self) -> None:
        """Where it is held out, the fit explains nothing of it."""
        stuck = Recording("stuck", self.T_S, self.recording().strain, np.full(len(self.T_S), 700.0))
        with pytest.raises(InputError, match="a resistance that changes with strain, got one in stuck"):
            fit_bending([stuck], [])
        fit = fit_bending([self.recording()], [stuck])
        assert fit is not None
        assert np.isnan(fit.held_out_r2)

    def test_covariance_is_no_less_than_what_noise_does(self) -> None:
        """Against the spread of the coefficients over 40 noisy recordings."""
        fits = [fit_bending([self.recording(0.01, seed)], []) for seed in range(40)]
        coefficients, covariances = zip(*[(fit.coefficients, fit.covariance) for fit in fits if fit], strict=True)
        spread = np.std(coefficients, axis=0)
        expected = np.mean([np.sqrt(np.diag(covariance)) for covariance in covariances], axis=0)
        assert (expected > 0.8 * spread).all()
        assert (expected < 4 * spread).all()

    def test_without_bending_there_is_none(self) -> None:
        assert fit_bending([triangle("a", 0.05)], []) is None

    def test_samples_that_do_not_determine_it_are_no_fit(self) -> None:
        """A recording that has ended before it is scored has no sample, and one of two strains too few."""
        bent = self.recording()
        short = Recording("short", bent.t_s[:20], bent.strain[:20], bent.change[:20])
        assert fit_bending([short], []) is None
        assert fit_bending([bent, short], [short]) is not None
        strain = np.where(self.T_S < 100, -0.2, -0.1)
        steps = Recording("steps", self.T_S, strain, np.polyval(COEFFICIENTS, strain))
        assert fit_bending([steps], []) is None

    def test_a_curve_without_a_fold_inverts_up_to_zero(self) -> None:
        straight = FoldedPolynomial([0, 0, 0, 0, 2.0, 0])
        assert straight.x_fold == 0
        assert straight.inverse(-0.5) == pytest.approx(-0.25, abs=1e-6)
