"""The body frame: where no node is anchored, the shape is described in the frame in which it fits the rest shape best.

With the six rigid motions G of the rest shape x_0, (3 nodes, 6) with orthonormal columns,

    G^T (x - x_0) = 0

The factor fixes the coordinate frame; of lengths and forces it says nothing.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from .noise import unit

BODY_FRAME_M = 1e-5
"""Standard deviation of a rigid motion: nothing beside the errors of any sensor, and enough for the arithmetic."""


def body_frame_factor(
    keys: Sequence[int], motions: NDArray[np.float64], rest_position_m: NDArray[np.float64]
) -> gtsam.CustomFactor:
    """Return the factor of one frame, with (3 nodes, 6) orthonormal rigid motions."""
    keys = list(keys)
    weighted = motions.T / BODY_FRAME_M
    by_node = [weighted[:, 3 * n : 3 * n + 3].copy() for n in range(len(keys))]

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[NDArray[np.float64]] | None
    ) -> NDArray[np.float64]:
        position = np.array([values.atPoint3(key) for key in keys])
        if jacobians is not None:
            for n, jacobian in enumerate(by_node):
                jacobians[n] = jacobian
        return np.asarray(weighted @ (position - rest_position_m).ravel())

    return gtsam.CustomFactor(unit(6), keys, error)
