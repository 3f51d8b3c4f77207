"""Errors of rods and tendons by hand; missing tendons, and robust kernels."""

import gtsam
import numpy as np
import pytest

from graph_values import KEYS, NOISE, values_of
from tensegraph.factors.noise import SIGMA_STEP, weigh
from tensegraph.factors.rod import rod_factors
from tensegraph.factors.tendon import tendon_factors
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
