"""The twin's sensors: their rheology, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph.models.sensor.bending import BendingCurve
from tensegraph.models.twin.specimens import HysteresisPlan, SensorPhysics, Sensors, Specimens, drift

PLAIN = SensorPhysics(
    natural_resistance_ohm=5e6,
    natural_resistance_spread=0.0,
    natural_resistance_error=0.0,
    gain_spread=0.0,
    gauge_factor=[1.0],
    gauge_corner_strain=[],
    gauge_corner_width=0.01,
    overstress_gain=[],
    overstress_time_s=[],
    hysteresis_gain=[],
    hysteresis_strain=[],
    hysteresis_at_rest=0.0,
    softening=0.0,
    softening_strain=1.0,
    stretching_time_s=(1e-6, 1e-6),
    bending_time_s=(1e-6, 1e-6),
    drift_sigma=0.0,
    drift_time_s=1.0,
    noise_sigma=0.0,
    noise_share=0.0,
)
"""A sensor that does nothing but dR/R = strain, at once."""


def response(physics: SensorPhysics, strain, step_s: float = 0.01) -> np.ndarray:
    strain = np.array(strain, dtype=np.float64)[:, None]
    return np.array(list(Sensors(physics, np.ones(1), strain[0]).changes(strain, step_s)))[:, 0]


def test_the_gauge_curve_has_its_slopes_and_starts_at_zero() -> None:
    physics = replace(PLAIN, gauge_factor=[1.0, 3.0], gauge_corner_strain=[0.2], gauge_corner_width=0.01)
    strain = np.array([0.0, 0.1, 0.3, 0.4])
    np.testing.assert_allclose(physics.gauge(strain), [0, 0.1, 0.2 + 3 * 0.1, 0.2 + 3 * 0.2], atol=1e-5)


def test_the_lag_reaches_90_percent_at_2_303_time_constants() -> None:
    physics = replace(PLAIN, stretching_time_s=(0.122, 0.402))
    up = response(physics, np.r_[np.zeros(1), np.full(1000, 0.1)], 0.001)
    down = response(physics, np.r_[np.full(1, 0.1), np.zeros(2000)], 0.001)
    assert up[281] == pytest.approx(0.09, rel=1e-3)
    assert down[926] == pytest.approx(0.01, rel=1e-2)


def test_the_overstress_of_steady_stretching_is_rate_times_time() -> None:
    """q -> rate tau (1 - exp(-t / tau)) and relaxes when it stops."""
    physics = replace(PLAIN, overstress_gain=[0.5], overstress_time_s=[2.0])
    t = np.arange(0, 3, 0.01)
    y = response(physics, np.r_[0.1 * t, np.full(1000, 0.3)])
    np.testing.assert_allclose(y[299], 0.299 + 0.5 * 0.1 * 2 * (1 - np.exp(-299 * 0.01 / 2)), rtol=2e-3)
    np.testing.assert_allclose(y[-1], 0.3, atol=0.5 * 0.2 * np.exp(-9.9 / 2) + 1e-4)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.005, 0.05), st.floats(0.0, 0.4), st.floats(0.5, 200))
def test_the_hysteresis_loop_is_2_w_r_wide_at_any_rate(width, gain, speed) -> None:
    physics = replace(PLAIN, hysteresis_gain=[gain], hysteresis_strain=[width])
    up = np.linspace(0.0, 0.4, 401)
    y = response(physics, np.r_[up, up[::-1], up], 0.1 / speed)
    middle = 200
    assert y[401 + 200] - y[802 + middle] == pytest.approx(2 * gain * width, abs=1e-9)


@pytest.mark.parametrize("factor", [0.0, 1.0, 3.0])
def test_hysteresis_times_three_is_a_loop_three_times_as_wide(factor) -> None:
    """A loop much longer than the stop is 2 w r high: 2 x 0.2 x 0.01; creep leaves a s exp(-t / tau) of a step s."""
    physics = replace(PLAIN, hysteresis_gain=[0.2], hysteresis_strain=[0.01])
    back_and_forth = np.concatenate([np.linspace(0.05, 0.1, 501), np.linspace(0.1, 0.05, 501)])
    loop = response(HysteresisPlan(factor, 1.0).applied(physics), np.tile(back_and_forth, 2))
    up, down = loop[1002 + 250], loop[1002 + 501 + 250]
    assert down - up == pytest.approx(factor * 2 * 0.2 * 0.01, abs=1e-9)
    physics = replace(PLAIN, overstress_gain=[0.5], overstress_time_s=[2.0])
    step = response(HysteresisPlan(1.0, factor).applied(physics), np.r_[0.0, np.full(400, 0.1)])
    assert step[201] - 0.1 == pytest.approx(factor * 0.5 * 0.1 * np.exp(-1), rel=0.01)


def test_hysteresis_at_rest_is_the_first_stretch() -> None:
    physics = replace(PLAIN, hysteresis_gain=[0.2], hysteresis_strain=[0.01], hysteresis_at_rest=1.0)
    brought = response(replace(physics, hysteresis_at_rest=0.0), np.linspace(0, 0.1, 101))[-1]
    assert response(physics, [0.1, 0.1])[-1] == pytest.approx(brought, abs=1e-12)
    assert response(replace(physics, hysteresis_at_rest=0.0), [0.1, 0.1])[-1] == pytest.approx(0.1)


def test_a_worked_strip_is_softer() -> None:
    physics = replace(PLAIN, softening=0.2, softening_strain=2.0)
    strain = 0.1 + 0.1 * np.sin(np.linspace(0, 2 * np.pi * 5, 5001))
    y = response(physics, strain)
    travelled = 0.1 + np.abs(np.diff(strain)).sum()
    assert y[-1] == pytest.approx(0.1 * (1 - 0.2 * (1 - np.exp(-travelled / 2))), rel=1e-9)


def test_a_bent_strip_follows_equation_9() -> None:
    strain = -np.linspace(0, 0.8, 50)
    np.testing.assert_allclose(response(PLAIN, strain), BendingCurve().change(strain), atol=1e-12)


def test_drift_and_spread_are_as_large_as_said() -> None:
    physics = replace(
        PLAIN,
        drift_sigma=0.01,
        drift_time_s=5.0,
        gain_spread=0.07,
        natural_resistance_spread=0.1,
        natural_resistance_error=0.003,
    )
    walk = drift(physics, 2000, 500, 0.1, np.random.default_rng(0))
    assert walk.std() == pytest.approx(0.01, rel=0.05)
    assert (walk[:-50] * walk[50:]).mean() == pytest.approx(0.01**2 * np.exp(-1), rel=0.15)
    drawn = Specimens.draw(physics, 5000, np.random.default_rng(1))
    assert drawn.gain.std() == pytest.approx(0.07, rel=0.1)
    assert (drawn.natural_resistance_ohm / 5e6).std() == pytest.approx(0.1, rel=0.1)
    assert (drawn.measured_resistance_ohm / drawn.natural_resistance_ohm).std() == pytest.approx(0.003, rel=0.1)
