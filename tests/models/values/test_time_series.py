"""Filters by hand and in pieces; regimes; the time for which errors stay alike, against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph.models.values.time_series import (
    Regimes,
    SmoothedRate,
    any_before,
    autocorrelation_of,
    correlation_samples,
    last_seen,
    low_passed,
    start_or_first,
    value_before,
)


def test_what_holds_soon_by_hand() -> None:
    """Of the second signal the last sample holds, which only the last two ends are behind."""
    holds = np.array([[True, False], [False, False], [False, False], [False, True]])
    expected = [[True, False], [False, False], [False, True], [False, True]]
    np.testing.assert_array_equal(any_before(holds, np.array([2, 3, 4, 4])), expected)


def test_filters_by_hand() -> None:
    value, start = np.array([[1.0, 5.0], [3.0, 5.0]]), np.array([0.0, np.nan])
    np.testing.assert_array_equal(start_or_first(start, value), [0, 5])
    np.testing.assert_allclose(
        low_passed(value, np.array([[0.5], [0.25]]), start_or_first(start, value)), [[0.5, 5], [1.125, 5]]
    )
    np.testing.assert_array_equal(value_before(value, start), [[0, np.nan], [1, 5]])
    seen = np.array([[False, True], [True, False]])
    np.testing.assert_array_equal(last_seen(value, seen, np.array([7.0, 8.0])), [[7, 5], [3, 5]])


@settings(max_examples=30, deadline=None)
@given(cut=st.integers(1, 39), seed=st.integers(0, 2**32 - 1))
def test_a_smoothed_rate_is_the_same_in_pieces(cut: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    step_s = rng.uniform(0.01, 0.1, (40, 1))
    value = rng.standard_normal((40, 2))
    whole = SmoothedRate(2, 0.05).run(value, step_s)
    pieces = SmoothedRate(2, 0.05)
    np.testing.assert_array_equal(
        np.concatenate([pieces.run(value[:cut], step_s[:cut]), pieces.run(value[cut:], step_s[cut:])]), whole
    )


def test_a_smoothed_rate_of_a_line_is_its_slope() -> None:
    value = 4.0 + 3.0 * 0.02 * np.arange(40)[:, None]
    rate = SmoothedRate(1, 0.05).run(value, np.full((40, 1), 0.02))
    assert rate[0, 0] == 0
    assert rate[-1, 0] == pytest.approx(3.0, rel=1e-5)


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


class TestRegimes:
    def test_by_hand(self) -> None:
        """After ln 2 of the memory half of 1 : 0 is forgotten for 3 : 1; evidence of 3 then gives 21 : 3."""
        regimes = Regimes(np.array([0.75, 0.25]), 10.0)
        regimes.probability = np.array([1.0, 0.0])
        regimes.predict(10 * np.log(2))
        np.testing.assert_allclose(regimes.probability, [0.875, 0.125])
        regimes.update(np.log([3.0, 1.0]))
        np.testing.assert_allclose(regimes.probability, np.array([2.625, 0.125]) / 2.75)

    def test_smoothed_is_the_sum_over_all_paths(self) -> None:
        prior = np.array([0.8, 0.2])
        evidence = np.array([[1.0, 2.0], [1.0, 0.5], [1.0, 7.0], [1.0, 9.0]])
        t_s = np.arange(4.0)
        regimes = Regimes(prior, 2.0)
        filtered = []
        for k in range(4):
            regimes.predict(1.0 if k else 0.0)
            regimes.update(np.log(evidence[k]))
            filtered.append(regimes.probability)
        stay = np.exp(-0.5)
        transition = stay * np.eye(2) + (1 - stay) * prior
        expected = np.zeros((4, 2))
        for path in np.ndindex(2, 2, 2, 2):
            weight = prior[path[0]] * np.prod([evidence[k, path[k]] for k in range(4)])
            weight *= np.prod([transition[path[k], path[k + 1]] for k in range(3)])
            expected[np.arange(4), path] += weight
        expected /= expected.sum(axis=1, keepdims=True)
        np.testing.assert_allclose(regimes.smoothed(t_s, np.array(filtered)), expected)
