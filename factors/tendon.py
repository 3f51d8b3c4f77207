"""Tendons: what the sensors say of their lengths, eqs. (5) and (7)."""

from collections.abc import Sequence

import gtsam
import numpy as np

from ..models.estimation import NoiseSettings
from ..models.structure.structure import Structure
from ..models.values.readings import TendonLengths
from .noise import tendon_noises, tendon_sigma_m


def tendon_factors(
    structure: Structure, keys: Sequence[int], lengths: TendonLengths, noise: NoiseSettings
) -> list[gtsam.NonlinearFactor]:
    """Return (|x_a - x_b| - L_e) / sigma_e for each usable tendon e = a-b of a frame."""
    sigma_m = tendon_sigma_m(lengths, noise)
    usable = np.flatnonzero(np.isfinite(sigma_m))
    ends, length_m = structure.tendons[usable].tolist(), lengths.length_m[usable].tolist()
    models = tendon_noises(sigma_m[usable], noise.robust)
    return [
        gtsam.RangeFactor3(keys[a], keys[b], length, model)
        for (a, b), length, model in zip(ends, length_m, models, strict=True)
    ]
