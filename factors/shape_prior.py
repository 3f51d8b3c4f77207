"""The shape prior: nodes stay near the rest shape, so that motions that lengths do not observe keep finite variance."""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from .noise import isotropic


def shape_prior_factors(
    nodes: Sequence[int], keys: Sequence[int], rest_position_m: NDArray[np.float64], sigma_m: float
) -> list[gtsam.NonlinearFactor]:
    """Return (x_n - rest_n) / sigma, three rows for each of the nodes in one frame; nothing for an infinite sigma."""
    if not np.isfinite(sigma_m):
        return []
    model = isotropic(3, sigma_m)
    return [gtsam.PriorFactorPoint3(keys[n], rest_position_m[n], model) for n in nodes]
