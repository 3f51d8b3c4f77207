"""Linear frames of a few coordinates, by hand."""

import numpy as np

from tensegraph.estimator.linear_frame import LinearFrame


def linear_frame(**told) -> LinearFrame:
    """Return a frame with what is told; drift, forces and factors of one's own that are not told are left out."""
    none, none_moves = np.zeros(0), np.zeros((0, told["length_jacobian"].shape[1]))
    rows = ("force_n", "force_weight_per_n", "force_sigma_n", "own_error", "own_weight")
    left_out = dict.fromkeys(("drift_m2", "shared")) | dict.fromkeys(rows, none)
    left_out |= dict.fromkeys(("force_jacobian", "own_jacobian", "fixed_motions"), none_moves)
    return LinearFrame(**left_out | told)
