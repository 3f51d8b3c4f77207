"""The first-order low-pass filter, m += (y - m) w, which serves for running means, smoothed rates and lags."""

import numpy as np
from numpy.typing import NDArray

Floats = float | NDArray[np.float64]


def low_pass_weight(step_s: Floats, time_constant_s: Floats) -> NDArray[np.float64]:
    """Return w = 1 - exp(-dt / tau), the share of the distance to its input by which the filter moves in one step."""
    return np.asarray(1 - np.exp(-np.asarray(step_s) / np.asarray(time_constant_s)))


def smoothed_rate(
    value: NDArray[np.float64], smooth: NDArray[np.float64], step_s: Floats, time_constant_s: float
) -> NDArray[np.float64]:
    """Return the rate of a smoothed value: the filter's change in one step, divided by the step."""
    return np.asarray((value - smooth) * low_pass_weight(step_s, time_constant_s) / step_s)
