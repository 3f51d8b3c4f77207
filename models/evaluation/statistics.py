"""Statistics over what is known, where nan is not."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def mean_over_frames(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over the first axis of what is not nan; nan of nothing."""
    known = ~np.isnan(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def of_known(statistic: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]) -> float:
    """Return a statistic of what is not nan; nan of nothing."""
    known = values[~np.isnan(values)]
    return float(statistic(known)) if len(known) else np.nan


def share_of_cases(cases: NDArray[np.bool_]) -> float:
    """Return the share of the cases that are true; nan of none."""
    return float(cases.mean()) if len(cases) else np.nan


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the root of the mean of the squares of what is not nan."""
    return float(np.sqrt(of_known(np.mean, values**2)))
