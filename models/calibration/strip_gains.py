"""The gain and offset of each strip, tared while its strain is known, as a tendon is tared at the rest shape."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..sensor.front_end import FrontEndSettings
from ..sensor.gauge import StaticGauge, common_change
from ..sensor.stretching import SETTLING_S
from ..values.chi_squared import squared_distance
from .recordings import Recording, correlated_samples
from .strain_estimators import StrainEstimator

GAIN_TRIES = 6
"""Largest number of Gauss-Newton iterations for the gain and offset of a strip."""
SMALLEST_STEP_SIGMA = 1e-3
"""Length of a step, in sigmas of gain and offset, below which a search ends."""


@dataclass(frozen=True, slots=True, eq=False)
class StripGain:
    """The estimated gain and offset of one strip: dR/R = offset + gain * (dR/R on the common curve)."""

    gain_and_offset: NDArray[np.float64]
    """(2,) gain and offset."""
    covariance: NDArray[np.float64]
    """(2, 2)"""

    def common(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dR/R on the common curve."""
        return common_change(change, *self.gain_and_offset)

    def sigma(self, common: NDArray[np.float64], slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain sigma due to the covariance of gain and offset.

        Args:
            common: (...) dR/R on the common curve.
            slope: (...) slope d(dR/R) / d(strain) of the common curve there.
        """
        slopes = np.stack([common, np.ones_like(common)], axis=-1) / (self.gain_and_offset[0] * slope[..., None])
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)))


def tare_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    unified: bool = False,
    seconds: float = SETTLING_S,
    start: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> dict[str, StripGain]:
    """Return the gain and offset of each strip by Gauss-Newton on its first seconds, with their spread as prior.

    With p = (gain, offset) and P their covariance over strips, they minimise

        (p - (1, 0))' P^-1 (p - (1, 0)) + sum_t (estimate_t(p) - strain_t)^2 / (n sigma_t^2)

    where sigma is that at the start of the search, and n samples have the same error.

    Args:
        estimator: the estimator of strain.
        recordings: of strips.
        gauge: contains the spread of gain and offset over strips.
        unified: whether bent samples count, too.
        seconds: length of the first part of each recording that is used.
        start: (2,) gain and offset at which the search starts, by name of recording; (1, 0) for other recordings.
    """
    if not recordings:
        return {}
    starts = [r.part(0, min(1.0, seconds / r.duration_s)) for r in recordings]
    prior = np.array([1.0, 0.0])
    information = np.diag([gauge.gain_sigma**-2, gauge.offset_sigma**-2])
    searches = [StripGainSearch(StripGain(start.get(r.name, prior), np.linalg.inv(information))) for r in starts]
    weights: dict[str, NDArray[np.float64]] = {}
    front_end = FrontEndSettings()
    tries = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-4]])
    for _ in range(GAIN_TRIES):
        tares = [replace(s.best, gain_and_offset=s.next_try + step) for s in searches for step in tries]
        change, step_s = side_by_side([r for r in starts for _ in tries], tares)
        estimate = estimator.estimate(change, step_s)
        for k, r in enumerate(starts):
            strain = estimate.strain[: len(r.t_s), 3 * k : 3 * k + 3]
            sigma = estimate.sigma[: len(r.t_s), 3 * k]
            warm_up = front_end.warm_up_sigma * np.exp(-(r.t_s - r.t_s[0]) / front_end.warm_up_s)
            variance = correlated_samples(r.t_s) * (sigma**2 + warm_up**2)  # the strip's past is unknown at first
            weight = weights.setdefault(r.name, np.where(unified | (r.strain >= 0), 1 / variance, 0.0))
            error = strain[:, 0] - r.strain
            deviation = searches[k].next_try - prior
            slopes = (strain[:, 1:] - strain[:, :1]) / np.array([1e-3, 1e-4])
            cost = float(deviation @ information @ deviation + weight @ error**2)
            gradient = slopes.T @ (weight * error) + information @ deviation
            searches[k].take(cost, gradient, information + slopes.T @ (weight[:, None] * slopes))
        if all(search.step_sigma < SMALLEST_STEP_SIGMA for search in searches):
            break
    return {r.name: search.best for r, search in zip(recordings, searches, strict=True)}


class StripGainSearch:
    """Gauss-Newton for one strip; a step that increases the cost is halved."""

    def __init__(self, start: StripGain) -> None:
        self.best = start
        self.next_try = start.gain_and_offset
        self._cost = np.inf
        self._step = np.zeros(2)

    def take(self, cost: float, gradient: NDArray[np.float64], precision: NDArray[np.float64]) -> None:
        """Use the cost and its derivatives at `next_try`, and choose the next values to try."""
        if cost < self._cost:
            self.best = StripGain(self.next_try, np.asarray(np.linalg.inv(precision), dtype=np.float64))
            self._cost = cost
            self._step = np.clip(self.best.covariance @ gradient, -0.2, 0.2)
        else:
            self._step = self._step / 2
        self.next_try = self.best.gain_and_offset - self._step

    @property
    def step_sigma(self) -> float:
        """Length of the next step in sigmas, those of the best values."""
        return float(np.sqrt(squared_distance(self._step, self.best.covariance)))


def side_by_side(
    recordings: Sequence[Recording], tares: Sequence[StripGain]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (samples, strips) dR/R on the common curve, and (samples, strips) time steps.

    Recordings that are shorter than the longest one are continued with their last value.
    """
    longest = max(len(r.t_s) for r in recordings)
    change = np.empty((longest, len(recordings)))
    step_s = np.empty((longest, len(recordings)))
    for k, (r, tare) in enumerate(zip(recordings, tares, strict=True)):
        steps = np.diff(r.t_s)
        median_step_s = float(np.median(steps))
        padding = (0, longest - len(r.t_s))
        change[:, k] = np.pad(tare.common(r.change), padding, mode="edge")
        step_s[:, k] = np.pad(np.append(median_step_s, steps), padding, constant_values=median_step_s)
    return change, step_s
