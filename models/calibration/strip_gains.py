"""Each strip's own gain and offset, tared while its strain is known, as a tendon is while the structure rests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..sensor.front_end import FrontEndSettings
from ..sensor.gauge import StaticGauge, common_change
from ..sensor.stretching import SETTLING_S
from .gauge_fit import INDEPENDENT
from .recordings import Recording
from .strain_estimators import StrainEstimator

GAIN_TRIES = 6
"""Values of gain and offset tried on a strip."""


@dataclass(frozen=True, slots=True, eq=False)
class StripGain:
    """What is known of one strip's gain_and_offset gain and offset: dR/R = offset + gain * common."""

    gain_and_offset: NDArray[np.float64]
    """(2,) gain and offset."""
    covariance: NDArray[np.float64]
    """(2, 2)"""

    def common(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dR/R on the common curve."""
        return common_change(change, *self.gain_and_offset)

    def sigma(self, common: NDArray[np.float64], slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain sigma that is left at a dR/R of the common curve, which has this slope there."""
        slopes = np.stack([common, np.ones_like(common)], axis=-1) / (self.gain_and_offset[0] * slope[..., None])
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)))


def tare_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    signed: bool = False,
    seconds: float = SETTLING_S,
    start: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> dict[str, StripGain]:
    """Return each strip's gain and offset by Gauss-Newton on its first seconds, with their spread as prior.

    With p = (gain, offset) and P their covariance over strips, the sum

        (p - (1, 0))' P^-1 (p - (1, 0)) + sum_t (estimate_t(p) - strain_t)^2 / (INDEPENDENT sigma_t^2)

    is least,    with sigma as it is where the search begins: at `start`, by name, else at (1, 0).
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
        tares = [replace(s.best, gain_and_offset=s.next_try + d) for s in searches for d in tries]
        change, step_s = side_by_side([r for r in starts for _ in tries], tares)
        followed = estimator.follow(change, step_s)
        for k, r in enumerate(starts):
            strain = followed.strain[: len(r.t_s), 3 * k : 3 * k + 3]
            sigma = followed.sigma[: len(r.t_s), 3 * k]
            warm_up = front_end.warm_up_sigma * np.exp(-(r.t_s - r.t_s[0]) / front_end.warm_up_s)
            variance = INDEPENDENT * (sigma**2 + warm_up**2)  # the strip's past is unknown at first
            weight = weights.setdefault(r.name, np.where(signed | (r.strain >= 0), 1 / variance, 0.0))
            error = strain[:, 0] - r.strain
            away = searches[k].next_try - prior
            slopes = (strain[:, 1:] - strain[:, :1]) / np.array([1e-3, 1e-4])
            cost = float(away @ information @ away + weight @ error**2)
            gradient = slopes.T @ (weight * error) + information @ away
            searches[k].take(cost, gradient, information + slopes.T @ (weight[:, None] * slopes))
    return {r.name: search.best for r, search in zip(recordings, searches, strict=True)}


class StripGainSearch:
    """Gauss-Newton for one strip; a step that makes things worse is halved."""

    def __init__(self, start: StripGain) -> None:
        self.best = start
        self.next_try = start.gain_and_offset
        self._cost = np.inf
        self._step = np.zeros(2)

    def take(self, cost: float, gradient: NDArray[np.float64], precision: NDArray[np.float64]) -> None:
        """Take in what was found at `next_try`, and choose the next."""
        if cost < self._cost:
            self.best = StripGain(self.next_try, np.asarray(np.linalg.inv(precision), dtype=np.float64))
            self._cost = cost
            self._step = np.clip(self.best.covariance @ gradient, -0.2, 0.2)
        else:
            self._step = self._step / 2
        self.next_try = self.best.gain_and_offset - self._step


def side_by_side(
    recordings: Sequence[Recording], tares: Sequence[StripGain]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (samples, strips) dR/R on the common curve and time steps; shorter recordings stand still at their end."""
    longest = max(len(r.t_s) for r in recordings)
    change = np.empty((longest, len(recordings)))
    step_s = np.empty((longest, len(recordings)))
    for k, (r, tare) in enumerate(zip(recordings, tares, strict=True)):
        steps = np.diff(r.t_s)
        own_step_s = float(np.median(steps))
        change[:, k] = np.pad(tare.common(r.change), (0, longest - len(r.t_s)), mode="edge")
        step_s[:, k] = np.pad(np.append(own_step_s, steps), (0, longest - len(r.t_s)), constant_values=own_step_s)
    return change, step_s
