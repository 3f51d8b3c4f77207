"""The static gauge curve, fitted to recordings together with the gain and offset of each strip."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ..sensor.bending import BendingCurve
from ..sensor.gauge import StaticGauge, common_change
from ..values.errors import InputError
from .recordings import Recording, correlated_samples

KNOTS = (0.0, 0.03, 0.07, 0.12, 0.2, 0.35, 0.5, 0.8, 1.2, 2.0, 3.0)
"""Strains between which the gauge curve is linear. They are close together at the strains of the tendons of a
tensegrity. The last knot is the largest strain recorded."""
LEAST_SLOPE = 0.3
"""Least slope of the curve as a share of its mean slope: the curve rises everywhere, so that its inverse stays
bounded."""
LEAST_GAIN_SIGMA = 0.01
"""Least standard deviation of the gain over sensors, because a single recording shows no spread."""
LEAST_OFFSET_SIGMA = 0.001
"""Least standard deviation of the offset over sensors, dR/R: recordings that all start at their natural resistance show
none, and a strip at rest drifts by this in 24 s."""
LEAST_RANGE = 0.01
"""Least range of the strain to which a curve is fitted; tendons of a structure are stretched by several times it."""


def fit_gauge(
    recordings: Sequence[Recording], bending: BendingCurve
) -> tuple[StaticGauge, dict[str, NDArray[np.float64]]]:
    """Return the gauge curve that fits all recordings, and (2,) gain and offset of each recording by its name.

    The fit alternates between the curve (non-negative least squares over all samples with strain >= 0) and the gain and
    offset of each recording (least squares with their spread as prior, so that a recording with little motion keeps
    gain 1).

    Raises:
        InputError: when no recording stays stretched, or their strain hardly changes.
    """
    gains = {recording.name: np.array([1.0, 0.0]) for recording in recordings}
    settled = {r.name: (r.strain[r.settled], r.change[r.settled]) for r in recordings}
    stretched = [r.name for r in recordings if (settled[r.name][0] >= 0).mean() > 0.9]
    if not stretched:
        raise InputError("no recording of stretching to fit a gauge curve to: expected one with strain >= 0 throughout")
    strain_range = np.ptp(np.concatenate([settled[name][0] for name in stretched]))
    if strain_range < LEAST_RANGE:
        raise InputError(
            f"recordings of stretching: expected strains over a range of {LEAST_RANGE:g} or more after settling, got "
            f"{strain_range:.3g}: {', '.join(stretched)}"
        )
    at_start = [r.change[0] for r in recordings if abs(r.strain[0]) < 1e-9]
    largest_range = max(float(np.ptp(settled[name][1])) for name in stretched)
    # with too few starts at zero strain the spread is not known: a wide prior leaves the offset to each recording
    offset_sigma = max(
        float(np.std(at_start)) if len(at_start) > 2 else 0.1 * largest_range,
        LEAST_OFFSET_SIGMA,
    )
    largest_strain = max(float(settled[name][0].max()) for name in stretched)
    gain_sigma = 0.05
    knots = np.array([knot for knot in KNOTS if knot < 0.95 * largest_strain] + [largest_strain])
    gauge = StaticGauge(knots, knots.copy(), gain_sigma, offset_sigma)
    for _ in range(20):
        strain = np.concatenate([settled[name][0] for name in stretched])
        change = np.concatenate([common_change(settled[name][1], *gains[name]) for name in stretched])
        gauge = StaticGauge(knots, _rising_curve(strain, change, knots), gain_sigma, offset_sigma)
        gains = {
            r.name: _gain_and_offset(*settled[r.name], correlated_samples(r.t_s), gauge, bending) for r in recordings
        }
        gain_sigma = max(float(np.std([gain for gain, _ in gains.values()])), LEAST_GAIN_SIGMA)
    return StaticGauge(knots, gauge.change_knots, gain_sigma, offset_sigma), gains


def _rising_curve(
    strain: NDArray[np.float64], change: NDArray[np.float64], knots: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (knots,) dR/R of the best fit among the curves that rise everywhere; it is 0 at the first knot."""
    weight = _weight(strain)
    widths = np.diff(knots)
    pieces = np.clip(strain[:, None] - knots[:-1], 0, widths)
    least = LEAST_SLOPE * float(np.polyfit(strain, change, 1)[0])
    if not least > 0:
        raise InputError("the resistance does not rise with strain: expected a sensor whose resistance does")
    triangle = np.linalg.qr(pieces * weight[:, None])
    target = (change - pieces.sum(axis=1) * least) * weight
    slopes = least + nnls(triangle.R, triangle.Q.T @ target)[0]
    return np.concatenate([[0.0], np.cumsum(slopes * widths)])


def _weight(strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 / sigma of the static curve's error, which grows with strain because of hysteresis."""
    return np.asarray(1 / (0.003 + 0.05 * np.abs(strain)))


def _gain_and_offset(
    strain: NDArray[np.float64],
    change: NDArray[np.float64],
    correlated: float,
    gauge: StaticGauge,
    bending: BendingCurve,
) -> NDArray[np.float64]:
    """Return (2,) gain and offset of one recording by least squares, with their spread over strips as prior.

    Args:
        strain: (samples,)
        change: (samples,) dR/R.
        correlated: see `correlated_samples`.
        gauge: the gauge curve.
        bending: the curve of bending.
    """
    weight = _weight(strain) / np.sqrt(correlated)
    expected = gauge.change(strain, bending)
    rows = np.stack([expected * weight, weight], axis=1)
    prior = np.diag([1 / gauge.gain_sigma, 1 / gauge.offset_sigma])
    target = np.concatenate([change * weight, [1 / gauge.gain_sigma, 0.0]])
    return np.asarray(np.linalg.lstsq(np.concatenate([rows, prior]), target, rcond=None)[0])
