"""The sigma of a tendon in one place, and what errors of several tendons have in common."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graph_values import NOISE
from tensegraph import Flag, Mode, TendonLengths
from tensegraph.factors.noise import (
    MOST_SHARED,
    WeightedLengths,
    independent_rows,
    tendon_noises,
    tendon_sigma_m,
    weigh,
)
from tensegraph.models.estimation import NoiseSettings
from tensegraph.models.values.readings import ModelError


def test_sigma_of_a_tendon_in_one_place() -> None:
    lengths = TendonLengths(
        0.0,
        np.array([0.1, 0.1, 0.1, np.nan, 0.1]),
        np.array([0.0003, 0.0003, 0.0003, np.inf, np.inf]),
        np.array([Mode.STRETCHING, Mode.BENDING, Mode.BENDING, Mode.STRETCHING, Mode.STRETCHING]),
        np.array([0, 0, Flag.AMBIGUOUS, Flag.MISSING, 0]),
    )
    own = np.array([NOISE.stretching_m, NOISE.bending_m, NOISE.ambiguous_m])
    expected = [*np.hypot(own, 0.0003), np.inf, np.inf]
    np.testing.assert_allclose(tendon_sigma_m(lengths, NOISE), expected)


def test_noise_models_are_kept() -> None:
    first, second = tendon_noises(np.array([0.0005, 0.000501]), "none")
    assert first is second
    assert tendon_noises(np.array([0.0005]), "huber")[0] is not first


@given(st.lists(st.floats(-MOST_SHARED, MOST_SHARED), min_size=1, max_size=24))
def test_rows_become_independent(shared: list[float]) -> None:
    """R C R^T = 1 for the correlation C of errors that share the part u."""
    u = np.array(shared)
    correlation = np.outer(u, u)
    np.fill_diagonal(correlation, 1.0)
    root = independent_rows(np.eye(len(u)), u)
    np.testing.assert_allclose(root @ correlation @ root.T, np.eye(len(u)), atol=1e-9)


def measured(length_m, error: ModelError) -> WeightedLengths:
    count = len(length_m)
    zero = np.zeros(count, dtype=np.int64)
    lengths = TendonLengths(0.0, np.array(length_m), np.full(count, 0.001), zero, zero, model_error=error)
    return weigh(lengths, NOISE)


def test_what_errors_share_by_hand() -> None:
    """Nothing at the tared length; the model's part times tanh(1) a reach away, with its sign; all of it untared."""
    error = ModelError(np.full(5, 0.0006), np.array([0.18, 0.18, 0.18, np.nan, 0.18]), np.full(5, 0.01), np.zeros(5))
    lengths = measured([0.18, 0.19, 0.17, 0.18, np.nan], error)
    own = 0.0006 / np.hypot(0.001, NOISE.stretching_m)
    expected = own * np.array([0, np.tanh(1), -np.tanh(1), 1, 0])
    assert lengths.shared == pytest.approx(expected)
    assert lengths.scaled(3.0).shared == pytest.approx(expected)
    assert (
        measured([0.3], ModelError(np.array([1.0]), np.array([0.18]), np.array([0.01]), np.zeros(1))).shared
        == MOST_SHARED
    )
    left_out = lengths.without(np.arange(5) == 1)
    assert left_out.shared == pytest.approx(np.where(np.arange(5) == 1, 0, expected))


def test_what_errors_share_after_motion_by_hand() -> None:
    """A third at the tared length, all of it a reach away on the one side and less on the other; never beyond sigma."""
    count = 5
    error = ModelError(
        np.full(count, 0.0006),
        np.array([0.18, 0.18, 0.18, np.nan, 0.18]),
        np.full(count, 0.01),
        after_motion=np.array([1, 1, 1, 1, 4.5]) / 3,
    )
    length_m = np.array([0.18, 0.19, 0.17, 0.18, 0.18])
    away = 0.0006 * np.tanh(1)
    assert error.shared_m(length_m) == pytest.approx([0.0002, 0.0006, 0.0002 - away, 0.0006, 0.0006])


def test_a_robust_kernel_takes_errors_one_by_one() -> None:
    lengths = measured([0.19], ModelError(np.array([0.0006]), np.array([0.18]), np.array([0.01]), np.zeros(1))).lengths
    assert weigh(lengths, replace(NOISE, robust="cauchy")).shared is None
    assert weigh(replace(lengths, model_error=None), NoiseSettings()).shared is None
