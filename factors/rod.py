"""Rods: their lengths cannot change, eq. (6)."""

from collections.abc import Sequence

import gtsam

from ..models.estimation import NoiseSettings
from ..models.structure.structure import Structure
from .noise import isotropic


def rod_factors(structure: Structure, keys: Sequence[int], noise: NoiseSettings) -> list[gtsam.NonlinearFactor]:
    """Return (|x_i - x_j| - L_r) / sigma for each rod i-j of a frame."""
    model = isotropic(1, noise.rod_m)
    members = zip(structure.rods.tolist(), structure.rod_length_m.tolist(), strict=True)
    return [gtsam.RangeFactor3(keys[i], keys[j], length, model) for (i, j), length in members]
