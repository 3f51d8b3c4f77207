"""The fit of the static gauge curve."""

import numpy as np
import pytest

from lagging_sensor import lagging_sensor
from tensegraph import InputError
from tensegraph.models.calibration.gauge_fit import LEAST_OFFSET_SIGMA, fit_gauge
from tensegraph.models.calibration.recordings import Recording
from tensegraph.models.sensor.bending import BendingCurve


def test_gauge_of_a_static_sensor_is_recovered() -> None:
    """Gains of 0.9 and 1.1 about one straight line, without lag."""
    recordings = [lagging_sensor(f"r{k}", k, gain=gain, lag_s=1e-3) for k, gain in enumerate([0.9, 1.0, 1.1])]
    gauge, own = fit_gauge(recordings, BendingCurve())
    strain = np.array([0.05, 0.1, 0.15])
    np.testing.assert_allclose(gauge.change(strain, BendingCurve()), 1.3 * strain, rtol=0.02)
    gains = np.array([own[f"r{k}"][0] for k in range(3)])
    np.testing.assert_allclose(gains / gains.mean(), [0.9, 1.0, 1.1], rtol=0.02)


def test_gauge_rises_even_where_the_readings_do_not() -> None:
    """A reading that stays level above 0.1 strain: the curve keeps a slope, so that it can be inverted."""
    t_s = np.arange(0, 60, 0.05)
    strain = 0.1 - 0.1 * np.cos(t_s)
    gauge, _ = fit_gauge([Recording("level", t_s, strain, np.minimum(strain, 0.1))], BendingCurve())
    assert (np.diff(gauge.change_knots) > 0).all()


def test_a_sensor_whose_resistance_falls_is_refused() -> None:
    t_s = np.arange(0, 60, 0.05)
    strain = 0.1 - 0.1 * np.cos(t_s)
    with pytest.raises(InputError, match="does not rise with strain"):
        fit_gauge([Recording("falls", t_s, strain, -strain)], BendingCurve())


def test_a_strip_that_hardly_moves_is_refused() -> None:
    t_s = np.arange(0, 60, 0.05)
    still = Recording("still", t_s, np.full(len(t_s), 0.1), 1e-3 * t_s)
    with pytest.raises(InputError, match=r"strains over a range of 0\.01 or more after settling, got 0: still"):
        fit_gauge([still], BendingCurve())


def test_recordings_that_start_at_their_natural_resistance_have_an_offset_still() -> None:
    """Three that show no spread at all."""
    t_s = np.arange(0, 60, 0.05)
    strain = 0.1 - 0.1 * np.cos(t_s)
    gauge, own = fit_gauge([Recording(f"r{k}", t_s, strain, strain) for k in range(3)], BendingCurve())
    assert gauge.offset_sigma == LEAST_OFFSET_SIGMA
    np.testing.assert_allclose(own["r1"], [1.0, 0.0], atol=0.02)


def test_the_sampling_rate_tells_nothing_of_a_gain() -> None:
    """Of a strip that hardly moves, beside others: its gain stays as near to theirs at 200 Hz as at 20 Hz."""
    found = []
    for step_s in (0.05, 0.005):
        t_s = np.arange(0, 60, step_s)
        strain = 0.1 - 0.1 * np.cos(t_s)
        recordings = [Recording(f"r{k}", t_s, strain, gain * strain) for k, gain in enumerate((0.95, 1.0, 1.05))]
        recordings.append(Recording("still", t_s, 0.02 * strain, 1.3 * 0.02 * strain))
        found.append(fit_gauge(recordings, BendingCurve())[1]["still"][0])
    assert found[1] == pytest.approx(found[0], abs=0.003)
