"""The time for which errors stay alike, against its definition."""

import numpy as np
import pytest

from tensegraph.models.values.time_series import autocorrelation_of, correlation_samples


def test_autocorrelation_against_its_definition() -> None:
    x = np.random.default_rng(2).standard_normal(50)
    expected = [np.sum(x[: 50 - k] * x[k:]) / np.sum(x**2) for k in range(50)]
    np.testing.assert_allclose(autocorrelation_of(x), expected, atol=1e-12)
    assert correlation_samples(np.ones(100)) == pytest.approx(100)
