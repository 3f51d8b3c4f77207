"""Sensors that drift slowly, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph.models.twin.slow_drift import DriftPlan

WARM = DriftPlan(
    from_s=5.0,
    until_s=65.0,
    of="resistance",
    common_share=0.03,
    common_course="ramp",
    own_sigma=0.0,
    own_course="ramp",
)


def test_a_common_ramp_is_3_percent_when_it_ends_and_half_of_that_half_way() -> None:
    t_s = np.array([0.0, 5.0, 35.0, 65.0, 80.0])
    common = WARM.drift(t_s, 2, np.random.default_rng(0))
    np.testing.assert_allclose(common, np.outer([0, 0, 0.015, 0.03, 0.03], [1, 1]), atol=1e-15)


def test_warming_up_slows_down_and_ends_where_it_is_told() -> None:
    """1 - exp(-1) = 0.632 of what tau = 20 s would reach in the end, of which 60 s see 1 - exp(-3)."""
    warm = replace(WARM, common_course="warm_up", time_constant_s=20.0)
    common = warm.drift(np.array([5.0, 25.0, 65.0, 90.0]), 1, np.random.default_rng(0))[:, 0]
    np.testing.assert_allclose(common, [0, 0.03 * 0.63212 / 0.95021, 0.03, 0.03], rtol=1e-4)


@pytest.mark.parametrize(("course", "half_way"), [("ramp", 0.5), ("walk", np.sqrt(0.5))])
def test_each_sensor_s_own_drift_has_the_sigma_told(course, half_way) -> None:
    """A ramp is half way at half its time; the variance of a random walk grows with time."""
    own = replace(WARM, common_share=0.0, own_sigma=0.02, own_course=course)
    d = own.drift(np.arange(0.0, 70.0, 0.5), 4000, np.random.default_rng(1))
    assert not d[:11].any()
    assert d[130].std() == pytest.approx(0.02, rel=0.05)
    assert d[70].std() == pytest.approx(half_way * 0.02, rel=0.05)
    np.testing.assert_array_equal(d[130], d[-1])
    later = np.corrcoef(d[70], d[130] - d[70])[0, 1]
    assert later == pytest.approx(1.0 if course == "ramp" else 0.0, abs=0.05)
