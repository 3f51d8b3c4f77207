"""The first-order low-pass, m += (y - m) w: running means, smoothed rates, lags."""

import numpy as np
from numpy.typing import NDArray

Floats = float | NDArray[np.float64]


def low_pass_weight(step_s: Floats, time_constant_s: Floats) -> NDArray[np.float64]:
    """Return w = 1 - exp(-dt / tau), the share of the way to its input that a low-pass goes in a step."""
    return np.asarray(1 - np.exp(-np.asarray(step_s) / np.asarray(time_constant_s)))


def smoothed_rate(
    value: NDArray[np.float64], smooth: NDArray[np.float64], step_s: Floats, time_constant_s: float
) -> NDArray[np.float64]:
    """Return the rate of a smoothed value: what the low-pass moves in a step, over the step."""
    return np.asarray((value - smooth) * low_pass_weight(step_s, time_constant_s) / step_s)
