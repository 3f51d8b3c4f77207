"""Recordings of a sensor behind a first-order lag."""

import numpy as np

from tensegraph.models.calibration.recordings import Recording


def lagging_sensor(
    name: str, seed: int, *, gain=1.0, offset=0.0, lag_s=0.3, seconds=60.0, low=0.0, high=0.2, rate_hz=20.0
):
    """Random motion of a sensor y = offset + gain 1.3 strain behind a first-order lag."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 1 / rate_hz)
    corners = np.cumsum(rng.uniform(0.2, 1.5, int(2 * seconds)))
    strain = np.interp(t_s, np.concatenate([[0], corners]), np.append(0, rng.uniform(low, high, len(corners))))
    lagged = np.empty_like(strain)
    lagged[0] = strain[0]
    for k in range(1, len(strain)):
        lagged[k] = strain[k] + (lagged[k - 1] - strain[k]) * np.exp(-1 / (rate_hz * lag_s))
    return Recording(name, t_s, strain, offset + gain * 1.3 * lagged + 5e-4 * rng.standard_normal(len(t_s)))
