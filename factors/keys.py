"""The gtsam keys of nodes, and factors on all nodes of a frame.

Keys are frame-major integers, so that values sorted by key have the shape (frames, nodes, 3).
"""

from collections.abc import Callable, Iterable, Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from .noise import unit


def frame_keys(frame: int, node_count: int) -> range:
    """Return the keys of all nodes of a frame, in the order of the nodes."""
    return range(node_count * frame, node_count * (frame + 1))


def key_list(keys: Iterable[int]) -> gtsam.KeyList:
    """Return keys as gtsam's list type."""
    result = gtsam.KeyList()
    for key in keys:
        result.push_back(key)
    return result


def factor_on_nodes(
    keys: Sequence[int],
    rows: int,
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    linearised: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> gtsam.CustomFactor:
    """Return a factor on all nodes of a frame, whose residuals have a standard deviation of 1.

    Args:
        keys: of the nodes.
        rows: number of residuals.
        residual: returns (rows,) the residuals at (nodes, 3) positions, whose half sum of squares is the error.
        linearised: returns (rows,) the residuals and (rows, 3 nodes) the Jacobian of the linearisation at them; with a
            robust kernel both are weighted, and these residuals differ from those of `residual`.
    """
    keys = list(keys)

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[NDArray[np.float64]] | None
    ) -> NDArray[np.float64]:
        position = np.array([values.atPoint3(key) for key in keys])
        if jacobians is None:
            return residual(position)
        weighted, jacobian = linearised(position)
        for n in range(len(keys)):
            jacobians[n] = jacobian[:, 3 * n : 3 * n + 3]
        return weighted

    return gtsam.CustomFactor(unit(rows), keys, error)
