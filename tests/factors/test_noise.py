"""The sigma of a tendon in one place."""

import numpy as np

from graph_values import NOISE
from tensegraph import Flag, Mode, TendonLengths
from tensegraph.factors.noise import tendon_noises, tendon_sigma_m


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
