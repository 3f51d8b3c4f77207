"""Distances in standard deviations, and how probable they are."""

import numpy as np
import pytest
from scipy.stats import chi2

from tensegraph.models.values.chi_squared import IMPROBABLE, are_improbable, chi_squared_quantile, squared_distance


def test_a_distance_worked_by_hand() -> None:
    """S^-1 of ((2, 1), (1, 2)) is ((2, -1), (-1, 2)) / 3; e = (1, 2): (2 - 4 + 8) / 3 = 2; of twice e four times it."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    e = np.array([[1.0, 2.0], [2.0, 4.0]])
    assert squared_distance(e, S) == pytest.approx([2.0, 8.0])
    assert squared_distance(e[0], S) == pytest.approx(2.0)


def test_distances_of_errors_as_told_are_distributed_as_chi_squared() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 3))
    squared = squared_distance(rng.normal(size=(20_000, 3)) @ A.T, A @ A.T)
    for probability in (0.5, 0.95):
        assert np.mean(squared < chi_squared_quantile(probability, 3)) == pytest.approx(probability, abs=0.01)


def test_quantiles_are_those_of_scipy() -> None:
    assert chi_squared_quantile([0.5, 0.999], 3) == pytest.approx(chi2.ppf([0.5, 0.999], 3))


@pytest.mark.parametrize("faulty", [0, 2])
def test_values_of_a_standard_normal_variable_are_seldom_improbable(faulty) -> None:
    rng = np.random.default_rng(1)
    called = [are_improbable(rng.standard_normal(24), faulty) for _ in range(5000)]
    assert np.mean(called) == pytest.approx(IMPROBABLE, abs=1.5e-3)
    assert are_improbable(rng.standard_normal(24) * 2, faulty)


def test_faulty_values_do_not_count() -> None:
    apart = np.array([0.1, -0.2, 40.0, 0.3])
    assert are_improbable(apart, 0)
    assert not are_improbable(apart, 1)
    assert not are_improbable(apart[2:3], 1)
