"""Anchors: nodes of known position, x_a = p_a.

A structure that three or more of them hold has a prior on each; one that hangs has rows on its pose.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..models.estimation import NoiseSettings
from ..models.pose.placed import PlacedShape, Rows
from ..models.structure.structure import Structure
from .noise import isotropic


def anchor_factors(structure: Structure, keys: Sequence[int], noise: NoiseSettings) -> list[gtsam.NonlinearFactor]:
    """Return (x_a - p_a) / sigma, three rows for each anchor a of a frame."""
    model = isotropic(3, noise.anchor_m)
    anchors = zip(structure.anchors, structure.anchor_position_m, strict=True)
    return [gtsam.PriorFactorPoint3(keys[node], position, model) for node, position in anchors]


def anchor_rows(
    placed: PlacedShape, anchors: NDArray[np.int64], anchor_position_m: NDArray[np.float64], sigma_m: float
) -> Rows:
    """Return three rows for each anchor.

    Args:
        placed: the shape in the world.
        anchors: (anchors,) their nodes.
        anchor_position_m: (anchors, 3) where they are.
        sigma_m: standard deviation of their positions, per axis.
    """
    error = (anchor_position_m - placed.node_position_m[anchors]).ravel()
    jacobian = placed.jacobian[anchors].reshape(-1, placed.state.layout.size)
    return Rows(error, jacobian, np.full(len(error), sigma_m**2))
