"""Anchors: base nodes of known position."""

from collections.abc import Sequence

import gtsam

from ..models.estimation import NoiseSettings
from ..models.structure.structure import Structure
from .noise import isotropic


def anchor_factors(structure: Structure, keys: Sequence[int], noise: NoiseSettings) -> list[gtsam.NonlinearFactor]:
    """Return |x_a - p_a| / sigma for each anchor a of a frame."""
    model = isotropic(3, noise.anchor_m)
    anchors = zip(structure.anchors, structure.anchor_position_m, strict=True)
    return [gtsam.PriorFactorPoint3(keys[node], position, model) for node, position in anchors]
