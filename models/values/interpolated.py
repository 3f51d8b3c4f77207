"""Linear interpolation of arrays in time."""

import numpy as np
from numpy.typing import NDArray


def interpolated(
    t_s: NDArray[np.float64], known_s: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (times, ...) values at t_s, of those that are (known, ...) at known_s; beyond these, the nearest value."""
    columns = values.reshape(len(known_s), -1).T
    at_times = np.stack([np.interp(t_s, known_s, column) for column in columns], axis=1)
    return at_times.reshape(len(t_s), *values.shape[1:])
