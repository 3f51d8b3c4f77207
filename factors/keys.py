"""The gtsam keys of nodes, and factors on all nodes of a frame.

Keys are frame-major integers, so that values sorted by key have the shape (frames, nodes, 3).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True)
class NodeRows:
    """Residuals of all nodes of a frame, whose standard deviation is 1."""

    count: int
    """Number of residuals."""
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Returns (rows,) the residuals at (nodes, 3) positions, whose half sum of squares is the error."""
    linearised: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
    """Returns (rows,) the residuals and (rows, 3 nodes) the Jacobian of the linearisation at such positions; with a
    robust kernel both are weighted, and these residuals differ from those of `residual`."""


def factor_on_nodes(keys: Sequence[int], parts: Sequence[NodeRows]) -> gtsam.CustomFactor:
    """Return all rows of some nodes as one factor, because gtsam calls each that is written in Python by itself."""
    keys = list(keys)

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[NDArray[np.float64]] | None
    ) -> NDArray[np.float64]:
        position = np.array([values.atPoint3(key) for key in keys])
        if jacobians is None:
            return np.concatenate([part.residual(position) for part in parts])
        linear = [part.linearised(position) for part in parts]
        jacobian = np.concatenate([by_position for _, by_position in linear])
        for n in range(len(keys)):
            jacobians[n] = jacobian[:, 3 * n : 3 * n + 3]
        return np.concatenate([weighted for weighted, _ in linear])

    return gtsam.CustomFactor(unit(sum(part.count for part in parts)), keys, error)
