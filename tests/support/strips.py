"""Recordings of strips whose law is known."""

import numpy as np

from tensegraph.models.calibration.recordings import Recording

T_S = np.arange(0, 60, 0.05)


def triangle(name: str, speed: float, high: float = 0.2, t_s=T_S, gain: float = 1.0, offset: float = 0.0) -> Recording:
    """Strain up and down at one speed; dR/R = offset + gain strain."""
    strain = np.sign(high) * np.abs((speed * t_s + abs(high)) % (2 * abs(high)) - abs(high))
    return Recording(name, t_s, strain, offset + gain * strain)
