"""Tendons: their lengths as the sensors measure them, eqs. (5) and (7)."""

from collections.abc import Sequence
from typing import Literal

import gtsam
import numpy as np

from ..models.structure.structure import Structure
from .noise import WeightedLengths, tendon_noises


def tendon_factors(
    structure: Structure, keys: Sequence[int], measured: WeightedLengths, robust: Literal["none", "huber", "cauchy"]
) -> list[gtsam.NonlinearFactor]:
    """Return (|x_a - x_b| - L_e) / sigma_e for each usable tendon e = a-b of a frame."""
    usable = np.flatnonzero(np.isfinite(measured.sigma_m))
    ends = structure.tendons[usable].tolist()
    length_m = measured.lengths.length_m[usable].tolist()
    models = tendon_noises(measured.sigma_m[usable], robust)
    return [
        gtsam.RangeFactor3(keys[a], keys[b], length, model)
        for (a, b), length, model in zip(ends, length_m, models, strict=True)
    ]
