"""Estimated loads against true ones."""

import numpy as np

from .evaluation import ComparedFrames, LoadScore
from .statistics import root_mean_square, share_of_cases

CLEAR_LOAD_N = 0.3
"""A true load above it is large enough to ask which node carries it."""


def score_loads(compared: ComparedFrames, threshold_n: float) -> LoadScore | None:
    """Return how far the estimated loads are from the true ones, if both are there."""
    if compared.estimated_load_n is None or compared.true_load_n is None:
        return None
    error_n = np.linalg.norm(compared.estimated_load_n - compared.true_load_n, axis=-1)
    true_n = np.linalg.norm(compared.true_load_n, axis=-1)
    estimated_n = np.linalg.norm(compared.estimated_load_n, axis=-1)
    known = np.isfinite(error_n)
    loaded = known & (true_n > threshold_n)
    called = known & (estimated_n > threshold_n)
    quiet = known & ~loaded.any(axis=1)[:, None]
    clear = np.where(known, true_n, 0.0).max(axis=1) > CLEAR_LOAD_N
    true_n, estimated_n = (np.where(known, n, -np.inf)[clear] for n in (true_n, estimated_n))
    return LoadScore(
        threshold_n,
        loaded_rmse_n=root_mean_square(error_n[loaded]),
        unloaded_rmse_n=root_mean_square(error_n[known & ~loaded]),
        recall=share_of_cases(called[loaded]),
        precision=share_of_cases(loaded[called]),
        false_alarm_share=share_of_cases(called[known & ~loaded]),
        quiet_false_alarm_share=share_of_cases(called[quiet]),
        clear_frames=int(clear.sum()),
        most_loaded_share=share_of_cases(true_n.argmax(axis=1) == estimated_n.argmax(axis=1)),
    )
