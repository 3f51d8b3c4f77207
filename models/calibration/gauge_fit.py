"""The static gauge curve, fitted to recordings together with each strip's own gain and offset."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ..sensor.bending import BendingCurve
from ..sensor.gauge import StaticGauge, common_change
from ..values.errors import InputError
from .recordings import Recording

KNOTS = (0.0, 0.03, 0.07, 0.12, 0.2, 0.35, 0.5, 0.8, 1.2, 2.0, 3.0)
"""Strains between which the gauge curve is straight: close where tendons of a tensegrity work. The last knot is the
largest strain recorded."""
LEAST_SLOPE = 0.3
"""The curve rises everywhere, by at least this share of its mean slope: its inverse must not run away."""
LEAST_GAIN_SIGMA = 0.01
"""One recording alone shows no spread; sensors have one."""
INDEPENDENT = 100
"""About one sample in so many tells something new: the static curve's errors last for seconds."""


def fit_gauge(
    recordings: Sequence[Recording], bending: BendingCurve
) -> tuple[StaticGauge, dict[str, tuple[float, float]]]:
    """Return the gauge curve of all recordings together, and each one's own (gain, offset) against it.

    Alternates between the curve (non-negative least squares over all samples with strain >= 0) and each recording's
    gain and offset (least squares with their own spread as prior, so that a recording of little motion keeps gain 1).

    Raises:
        InputError: when no recording stays stretched.
    """
    own = {recording.name: (1.0, 0.0) for recording in recordings}
    settled = {r.name: (r.strain[r.settled], r.change[r.settled]) for r in recordings}
    stretched = [r.name for r in recordings if (settled[r.name][0] >= 0).mean() > 0.9]
    if not stretched:
        raise InputError("no recording of stretching to fit a gauge curve to: expected one with strain >= 0 throughout")
    at_start = [r.change[0] for r in recordings if abs(r.strain[0]) < 1e-9]
    widest = max(float(np.ptp(settled[name][1])) for name in stretched)
    offset_sigma = float(np.std(at_start)) if len(at_start) > 2 else 0.1 * widest  # too few to say: left to each
    high = max(float(settled[name][0].max()) for name in stretched)
    gain_sigma = 0.05
    knots = np.array([knot for knot in KNOTS if knot < 0.95 * high] + [high])
    gauge = StaticGauge(knots, knots.copy(), gain_sigma, offset_sigma)
    for _ in range(20):
        strain = np.concatenate([settled[name][0] for name in stretched])
        change = np.concatenate([common_change(settled[name][1], *own[name]) for name in stretched])
        gauge = StaticGauge(knots, _rising_curve(strain, change, knots), gain_sigma, offset_sigma)
        own = {name: _own_gain_and_offset(*settled[name], gauge, bending) for name in settled}
        gain_sigma = max(float(np.std([gain for gain, _ in own.values()])), LEAST_GAIN_SIGMA)
    return StaticGauge(knots, gauge.change_knots, gain_sigma, offset_sigma), own


def _rising_curve(
    strain: NDArray[np.float64], change: NDArray[np.float64], knots: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return dR/R at the knots, 0 at the first, that fits best among the curves that rise everywhere."""
    weight = _weight(strain)
    widths = np.diff(knots)
    pieces = np.clip(strain[:, None] - knots[:-1], 0, widths)
    least = LEAST_SLOPE * float(np.polyfit(strain, change, 1)[0])
    if not least > 0:
        raise InputError("the resistance does not rise with strain: expected a sensor whose resistance does")
    triangle = np.linalg.qr(pieces * weight[:, None])
    right = (change - pieces.sum(axis=1) * least) * weight
    slopes = least + nnls(triangle.R, triangle.Q.T @ right)[0]
    return np.concatenate([[0.0], np.cumsum(slopes * widths)])


def _weight(strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one over the static curve's own error: hysteresis grows with strain."""
    return np.asarray(1 / (0.003 + 0.05 * np.abs(strain)))


def _own_gain_and_offset(
    strain: NDArray[np.float64], change: NDArray[np.float64], gauge: StaticGauge, bending: BendingCurve
) -> tuple[float, float]:
    weight = _weight(strain) / np.sqrt(INDEPENDENT)
    expected = gauge.change(strain, bending)
    rows = np.stack([expected * weight, weight], axis=1)
    prior = np.diag([1 / gauge.gain_sigma, 1 / gauge.offset_sigma])
    right = np.concatenate([change * weight, [1 / gauge.gain_sigma, 0.0]])
    gain, offset = np.linalg.lstsq(np.concatenate([rows, prior]), right, rcond=None)[0]
    return float(gain), float(offset)
