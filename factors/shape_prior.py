"""The shape prior: nodes stay somewhere about the rest shape, so that what lengths do not see stays finite."""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from .noise import isotropic


def shape_prior_factors(
    nodes: Sequence[int], keys: Sequence[int], rest_position_m: NDArray[np.float64], sigma_m: float
) -> list[gtsam.NonlinearFactor]:
    """Return |x_n - rest_n| / sigma for some nodes of a frame; none for an infinite sigma."""
    if not np.isfinite(sigma_m):
        return []
    model = isotropic(3, sigma_m)
    return [gtsam.PriorFactorPoint3(keys[n], rest_position_m[n], model) for n in nodes]
