"""Statistics over the known values of an array; unknown values are nan."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def of_known(statistic: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]) -> float:
    """Return a statistic of the values that are not nan; nan when there are none."""
    known = values[~np.isnan(values)]
    return float(statistic(known)) if len(known) else np.nan


def share_of_cases(cases: NDArray[np.bool_]) -> float:
    """Return the share of the cases that are true; nan when there are no cases."""
    return float(cases.mean()) if len(cases) else np.nan


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the square root of the mean square of the values that are not nan."""
    return float(np.sqrt(of_known(np.mean, values**2)))
