"""How long the values of a series tell the same."""

import numpy as np
from numpy.typing import NDArray


def correlation_samples(residual: NDArray[np.float64]) -> float:
    """Return how many samples in a row tell about the same: 1 + 2 sum of the autocorrelation while it is positive."""
    autocorrelation = autocorrelation_of(residual)
    negative = np.flatnonzero(autocorrelation <= 0)
    end = int(negative[0]) if len(negative) else len(autocorrelation)
    return float(1 + 2 * autocorrelation[1:end].sum())


def autocorrelation_of(residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the autocorrelation at lags of 0, 1, ... samples, about zero: a constant error is correlated, too."""
    padded = np.fft.rfft(residual, 2 * len(residual))
    power = np.fft.irfft(np.abs(padded) ** 2)[: len(residual)]
    return np.asarray(power / power[0])
