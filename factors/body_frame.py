"""The body frame: where anchors leave rigid motions, the shape is described where it fits the rest shape best.

One or two anchors are where they are at rest. With the rigid motions G of the rest shape x_0 that anchors leave,
(3 nodes, motions) with orthonormal columns,

    G^T (x - x_0) = 0

The factor fixes the coordinate frame; of lengths and forces it says nothing.
"""

import numpy as np
from numpy.typing import NDArray

from .keys import NodeRows

BODY_FRAME_M = 1e-5
"""Standard deviation of a rigid motion: nothing beside the errors of any sensor, and enough for the arithmetic."""


def body_frame_rows(motions: NDArray[np.float64], rest_position_m: NDArray[np.float64]) -> NodeRows:
    """Return the rigid motions of one frame from the rest shape, with (3 nodes, motions) orthonormal rigid motions."""
    weighted = motions.T / BODY_FRAME_M

    def residual(position: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(weighted @ (position - rest_position_m).ravel())

    return NodeRows(len(weighted), residual, lambda position: (residual(position), weighted))
