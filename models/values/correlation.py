"""The autocorrelation of a series, and over how many samples its values are correlated."""

import numpy as np
from numpy.typing import NDArray


def correlation_samples(residual: NDArray[np.float64]) -> float:
    """Return the correlation time of a series in samples: 1 + 2 sum of the autocorrelation up to its first zero."""
    autocorrelation = autocorrelation_of(residual)
    negative = np.flatnonzero(autocorrelation <= 0)
    end = int(negative[0]) if len(negative) else len(autocorrelation)
    return float(1 + 2 * autocorrelation[1:end].sum())


def autocorrelation_of(residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (lags,) the autocorrelation at lags of 0, 1, ... samples.

    It is taken about zero, not about the mean, because a constant error is correlated, too.
    """
    padded = np.fft.rfft(residual, 2 * len(residual))
    power = np.fft.irfft(np.abs(padded) ** 2)[: len(residual)]
    return np.asarray(power / power[0])
