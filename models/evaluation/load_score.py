"""The comparison of estimated loads with true loads."""

import numpy as np

from .evaluation import ComparedFrames, LoadScore
from .statistics import root_mean_square, share_of_cases

CLEAR_LOAD_N = 0.3
"""True load above which a frame is used to compare the most loaded node with the estimate."""


def score_loads(compared: ComparedFrames, threshold_n: float) -> LoadScore | None:
    """Return the errors of the estimated loads; None unless both estimated and true loads are known."""
    if compared.estimated_load_n is None or compared.true_load_n is None:
        return None
    error_n = np.linalg.norm(compared.estimated_load_n - compared.true_load_n, axis=-1)
    true_n = np.linalg.norm(compared.true_load_n, axis=-1)
    estimated_n = np.linalg.norm(compared.estimated_load_n, axis=-1)
    known = np.isfinite(error_n)
    loaded = known & (true_n > threshold_n)
    detected = known & (estimated_n > threshold_n)
    quiet = known & ~loaded.any(axis=1)[:, None]
    clear = np.where(known, true_n, 0.0).max(axis=1) > CLEAR_LOAD_N
    clear_true_n = np.where(known, true_n, -np.inf)[clear]
    clear_estimated_n = np.where(known, estimated_n, -np.inf)[clear]
    return LoadScore(
        threshold_n=threshold_n,
        loaded_rmse_n=root_mean_square(error_n[loaded]),
        unloaded_rmse_n=root_mean_square(error_n[known & ~loaded]),
        recall=share_of_cases(detected[loaded]),
        precision=share_of_cases(loaded[detected]),
        false_alarm_share=share_of_cases(detected[known & ~loaded]),
        quiet_false_alarm_share=share_of_cases(detected[quiet]),
        clear_frames=int(clear.sum()),
        most_loaded_share=share_of_cases(clear_true_n.argmax(axis=1) == clear_estimated_n.argmax(axis=1)),
    )
