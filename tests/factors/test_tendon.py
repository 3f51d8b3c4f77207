"""Errors of rods and tendons by hand; missing tendons, and robust kernels."""

import gtsam
import numpy as np
import pytest

from graph_values import KEYS, NOISE, values_of
from tensegraph.factors.keys import factor_on_nodes
from tensegraph.factors.noise import SIGMA_STEP, weigh
from tensegraph.factors.rod import rod_factors
from tensegraph.factors.tendon import correlated_tendon_rows, tendon_factors
from tensegraph.models.estimation import NoiseSettings


def test_rod_and_tendon_errors_by_hand(structure, rest, lengths_of) -> None:
    """A rod 1 mm too long at sigma 0.2 mm costs (1 / 0.2)^2 / 2; a tendon 2 mm off at 0.5 mm with 0.2 mm of its own."""
    lengths = lengths_of(structure, rest.node_position_m)
    values = values_of([rest.node_position_m])
    short = NoiseSettings()
    rod = gtsam.RangeFactor3(0, 3, 0.299, rod_factors(structure, KEYS[0], short)[0].noiseModel())
    assert rod.error(values) == pytest.approx(0.5 * 5**2, rel=1e-2)
    lengths.length_m[3] += 0.002
    tendon = tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust)[3]
    assert tendon.error(values) == pytest.approx(0.5 * 0.002**2 / (0.0005**2 + 0.0002**2), rel=2 * SIGMA_STEP)


def test_missing_tendons_have_no_factor(structure, rest, lengths_of) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[[4, 7]] = np.nan
    assert len(tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust)) == 22


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_robust_kernels_cap_an_outlier(structure, rest, lengths_of, robust) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[3] += 0.05
    values = values_of([rest.node_position_m])
    plain, capped = (
        tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), kernel)[3].error(values)
        for kernel in ("none", robust)
    )
    assert capped < 0.1 * plain


def test_correlated_tendons_are_those_with_one_unknown_more(structure, rest, lengths_of) -> None:
    """The error is the least over b of sum ((e - b u sigma) / own sigma)^2 / 2 + b^2 / 2."""
    lengths = lengths_of(structure, rest.node_position_m, noise=1e-3 * np.random.default_rng(1).standard_normal(24))
    measured = weigh(lengths, NOISE).without(np.arange(24) == 7)
    shared = np.random.default_rng(2).uniform(-0.9, 0.9, 24)
    rows = correlated_tendon_rows(structure, measured, shared)
    factor = factor_on_nodes(KEYS[0], [rows])
    z = (structure.tendon_length_m(rest.node_position_m) - lengths.length_m) / measured.sigma_m
    shared[~structure.is_free_tendon] = 0.0
    z, shared = np.delete(z, 7), np.delete(shared, 7)
    own = np.sqrt(1 - shared**2)
    design, told = np.append(shared / own, 1.0), np.append(z / own, 0.0)
    left = told - design * (design @ told) / (design @ design)
    assert rows.count == 23
    assert factor.error(values_of([rest.node_position_m])) == pytest.approx(0.5 * left @ left, rel=3 * SIGMA_STEP)
