"""The gain and offset of each strip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strips import triangle
from tensegraph.models.calibration.recordings import Recording
from tensegraph.models.calibration.strip_baselines import StaticEstimator
from tensegraph.models.calibration.strip_gains import StripGain, StripGainSearch, tare_strips
from tensegraph.models.calibration.strips import run_strips
from tensegraph.models.sensor.gauge import StaticGauge


class TestTare:
    gauge = StaticGauge(np.array([0.0, 0.2]), np.array([0.0, 0.2]), 0.05, 0.003)

    def test_sigma_left_by_hand(self) -> None:
        """d strain / d (gain, offset) = (y, 1) / slope: with y = 0.1, slope 2, sigmas 0.04 and 0.003: 0.0025."""
        tare = StripGain(np.array([1.0, 0.0]), np.diag([0.04**2, 0.003**2]))
        assert tare.sigma(np.array(0.1), np.array(2.0)) == pytest.approx(np.hypot(0.004, 0.003) / 2)

    @given(st.floats(0.9, 1.1), st.floats(-0.005, 0.005))
    def test_first_seconds_tell_gain_and_offset(self, gain: float, offset: float) -> None:
        """A static strip on its own curve: found to within three sigmas, and sigma is less than before."""
        estimator = StaticEstimator(np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), 0.002)
        tare = tare_strips(estimator, [triangle("a", 0.1, gain=gain, offset=offset)], self.gauge)["a"]
        sigma = np.sqrt(np.diag(tare.covariance))
        assert (sigma < [0.05, 0.003]).all()
        assert (np.abs(tare.gain_and_offset - [gain, offset]) < 3 * sigma).all()

    def test_the_sampling_rate_tells_nothing_of_a_strip(self) -> None:
        """The same motion at 20 and at 200 Hz: its errors last for seconds."""
        estimator = StaticEstimator(np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), 0.002)
        slow = triangle("slow", 0.1)
        t_s = np.arange(slow.t_s[0], slow.t_s[-1], 0.005)
        parts = (np.interp(t_s, slow.t_s, values) for values in (slow.strain, slow.change))
        tares = tare_strips(estimator, [slow, Recording("fast", t_s, *parts)], self.gauge)
        sigma = np.sqrt([np.diag(tares[name].covariance) for name in ("slow", "fast")])
        np.testing.assert_allclose(sigma[1], sigma[0], rtol=0.02)

    def test_a_step_that_makes_things_worse_is_halved(self) -> None:
        """atan(x) = 0 from x = 2: Newton's step leads to -3.5, and on to -13.9, 280, ..."""
        search = StripGainSearch(StripGain(np.array([2.0, 0.0]), np.eye(2)))
        for _ in range(30):
            x, y = 20 * search.next_try  # so that the limit on a step does not hide it
            error, slopes = np.array([np.arctan(x), y]), 20 * np.array([1 / (1 + x**2), 1.0])
            search.take(float(error @ error), slopes * error, np.diag(slopes**2))
        np.testing.assert_allclose(search.best.gain_and_offset, 0, atol=1e-6)

    def test_what_was_trained_on_keeps_its_tare_and_early_samples_do_not_score(self) -> None:
        estimator = StaticEstimator(np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), 0.002)
        r = triangle("a", 0.1, gain=1.2)
        known = {"a": StripGain(np.array([1.2, 0.0]), np.zeros((2, 2)))}
        (run,) = run_strips(estimator, [r], self.gauge, known)
        np.testing.assert_allclose(run.error, 0, atol=1e-12)
        np.testing.assert_allclose(run.sigma, 0.002)
        assert run.t_s[0] == pytest.approx(10.0)
