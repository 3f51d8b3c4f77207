"""How far estimates are from the truth. Only the root may import this: an estimator never sees truth."""

import numpy as np
from numpy.typing import NDArray

from ..models.reconstruction import Reconstruction


def node_rmse_m(
    reconstruction: Reconstruction, truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> float:
    """Return the root of the mean of |error|^2 (3-D) over the free nodes and all frames that the truth covers.

    Args:
        reconstruction: the estimate.
        truth_s: (times,) increasing.
        truth_position_m: (times, nodes, 3) in the anchors' frame.
    """
    covered = (reconstruction.t_s >= truth_s[0]) & (reconstruction.t_s <= truth_s[-1])
    true = interpolated(reconstruction.t_s[covered], truth_s, truth_position_m)
    error = (reconstruction.node_position_m[covered] - true)[:, reconstruction.structure.free_nodes]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


def interpolated(
    t_s: NDArray[np.float64], truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (frames, nodes, 3) true positions at some times, on straight lines between the given ones."""
    after = np.clip(np.searchsorted(truth_s, t_s), 1, len(truth_s) - 1)
    share = ((t_s - truth_s[after - 1]) / (truth_s[after] - truth_s[after - 1]))[:, None, None]
    return np.asarray((1 - share) * truth_position_m[after - 1] + share * truth_position_m[after])
