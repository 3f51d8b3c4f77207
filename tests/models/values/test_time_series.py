"""The time for which errors stay alike, against its definition."""

import numpy as np
import pytest

from tensegraph.models.values.time_series import autocorrelation_of, correlation_samples


def test_autocorrelation_against_its_definition() -> None:
    x = np.random.default_rng(2).standard_normal(50)
    expected = [np.sum(x[: 50 - k] * x[k:]) / np.sum(x**2) for k in range(50)]
    np.testing.assert_allclose(autocorrelation_of(x), expected, atol=1e-12)
    assert correlation_samples(np.ones(100)) == pytest.approx(100)


def test_autocorrelation_of_errors_of_any_size() -> None:
    """Zeros are as noise, and squares neither vanish nor overflow."""
    np.testing.assert_array_equal(autocorrelation_of(np.zeros(4)), [1, 0, 0, 0])
    for size in (1e-200, 1e200):
        np.testing.assert_allclose(autocorrelation_of(size * np.ones(3)), [1, 2 / 3, 1 / 3])
