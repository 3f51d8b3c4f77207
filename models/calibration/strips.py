"""Strips on the test rig, followed as tendons on a structure are: tared while their strain is known, then estimated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..sensor.front_end import FrontEndSettings
from ..sensor.gauge import StaticGauge
from ..sensor.sensor_model import SensorModel
from ..sensor.stretching import Extrapolation, StrainSpread, StretchingSensors
from .gauge_fit import INDEPENDENT
from .recordings import SETTLING_S, Recording

TARE_TRIES = 6
"""Values of gain and offset tried on a strip."""


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """An estimator's output on several strips side by side."""

    strain: NDArray[np.float64]
    """(samples, strips)"""
    sigma: NDArray[np.float64]
    """(samples, strips) its own, without what the tare leaves."""
    unscaled_sigma: NDArray[np.float64]
    """(samples, strips) before it was calibrated."""
    spread: NDArray[np.float64]
    """(samples, strips) of strain lately, see `StrainSpread`."""
    beyond: NDArray[np.bool_]
    """(samples, strips) whether a sample is beyond training: the flag of a tendon."""


class StrainEstimator(Protocol):
    """Strain from dR/R, causally: the network, and what it is compared with."""

    def follow(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> Followed:
        """Return strain and sigma from (samples, strips) dR/R on the common curve, and the steps before each."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class NetworkEstimator:
    """The sensor model as the front end runs it."""

    model: SensorModel
    """The model."""

    def follow(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> Followed:
        """See `StrainEstimator`."""
        samples, count = change.shape
        sensors, running = StretchingSensors(self.model, count), StrainSpread(count)
        outside = Extrapolation(self.model, count)
        sensors.settle(change[0], np.ones(count, dtype=np.bool_), float(np.median(step_s)))
        rate = np.diff(change, axis=0, prepend=change[:1]) / step_s
        strain, sigma, spread, beyond, factor = (np.empty((samples, count)) for _ in range(5))
        extra = np.empty((samples, count))
        for k in range(samples):
            strain[k], sigma[k] = sensors.step(change[k], rate[k], step_s[k])
            spread[k] = running.step(strain[k], step_s[k])
            factor[k], farther, beyond[k] = outside.step(change[k], rate[k], strain[k], step_s[k])
            extra[k] = np.hypot(farther, sensors.curve_sigma(change[k]))
        scaled = np.hypot(sigma * self.model.sigma_scale.at(spread) * factor, extra)
        return Followed(strain, scaled, sigma, spread, beyond.astype(np.bool_))


@dataclass(frozen=True, slots=True, eq=False)
class Tare:
    """What is known of one strip's own gain and offset: dR/R = offset + gain * common."""

    own: NDArray[np.float64]
    """(2,) gain and offset."""
    covariance: NDArray[np.float64]
    """(2, 2)"""

    def common(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dR/R on the common curve."""
        return np.asarray((change - self.own[1]) / self.own[0])

    def sigma(self, common: NDArray[np.float64], slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain sigma that is left at a dR/R of the common curve, which has this slope there."""
        slopes = np.stack([common, np.ones_like(common)], axis=-1) / (self.own[0] * slope[..., None])
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)))


@dataclass(frozen=True, slots=True, eq=False)
class StripRun:
    """One recording, estimated; only where it counts: stretched, settled, and never trained on."""

    name: str
    speed_per_s: float
    """Nan for irregular motion."""
    t_s: NDArray[np.float64]
    """(samples,)"""
    strain: NDArray[np.float64]
    """(samples,) as the rig measured it."""
    change: NDArray[np.float64]
    """(samples,) dR/R as read."""
    rate_per_s: NDArray[np.float64]
    """(samples,) of the rig's strain."""
    estimate: NDArray[np.float64]
    """(samples,)"""
    sigma: NDArray[np.float64]
    """(samples,) with what the tare leaves."""
    tare_sigma: NDArray[np.float64]
    """(samples,) that alone."""
    unscaled_sigma: NDArray[np.float64]
    """(samples,) of the network alone, before calibration."""
    spread: NDArray[np.float64]
    """(samples,) of strain lately."""
    beyond: NDArray[np.bool_]
    """(samples,) flagged as beyond training."""

    @property
    def error(self) -> NDArray[np.float64]:
        """(samples,) estimate minus strain."""
        return self.estimate - self.strain


def run_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    known: Mapping[str, Tare],
    signed: bool = False,
) -> list[StripRun]:
    """Return an estimator's output on recordings.

    A strip whose recording was trained on keeps the gain and offset found there (`known`); any other is tared on its
    first 10 s, in which the rig tells its strain, as the rest shape tells a tendon's. These do not score.

    Args:
        estimator: the network, or a baseline.
        recordings: of strips.
        gauge: the common curve, and how much strips differ from it.
        known: tares by name.
        signed: whether bent samples count, too.
    """
    if not recordings:
        return []
    fresh = [r for r in recordings if r.name not in known]
    tares = dict(known) | tare_strips(estimator, fresh, gauge, signed)
    change, step_s = _side_by_side(recordings, [tares[r.name] for r in recordings])
    followed = estimator.follow(change, step_s)
    runs = []
    for k, r in enumerate(recordings):
        samples = len(r.t_s)
        counted = r.counted(signed)
        strain, common = followed.strain[:samples, k], change[:samples, k]
        tare_sigma = tares[r.name].sigma(common, gauge.slope(np.maximum(strain, 0)))
        columns = (
            r.t_s,
            r.strain,
            r.change,
            np.gradient(r.strain, r.t_s),
            strain,
            np.hypot(followed.sigma[:samples, k], tare_sigma),
            tare_sigma,
            followed.unscaled_sigma[:samples, k],
            followed.spread[:samples, k],
            followed.beyond[:samples, k],
        )
        runs.append(StripRun(r.name, r.speed_per_s, *(np.asarray(column)[counted] for column in columns)))
    return [run for run in runs if len(run.t_s)]


def tare_strips(
    estimator: StrainEstimator,
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    signed: bool = False,
    seconds: float = SETTLING_S,
    start: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> dict[str, Tare]:
    """Return each strip's gain and offset by Gauss-Newton on its first seconds, with their spread as prior.

    min (own - (1, 0))' P^-1 (own - (1, 0)) + sum_t (estimate_t(own) - strain_t)^2 / (INDEPENDENT sigma_t^2)

    with sigma as it is where the search begins: at `start`, by name, else at (1, 0).
    """
    if not recordings:
        return {}
    starts = [r.part(0, min(1.0, seconds / r.duration_s)) for r in recordings]
    prior, information = np.array([1.0, 0.0]), np.diag([gauge.gain_sigma**-2, gauge.offset_sigma**-2])
    searches = [TareSearch(Tare(start.get(r.name, prior), np.linalg.inv(information))) for r in starts]
    weights: dict[str, NDArray[np.float64]] = {}
    front_end = FrontEndSettings()
    tries = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-4]])
    for _ in range(TARE_TRIES):
        tares = [replace(s.best, own=s.next_own + d) for s in searches for d in tries]
        change, step_s = _side_by_side([r for r in starts for _ in tries], tares)
        followed = estimator.follow(change, step_s)
        for k, r in enumerate(starts):
            strain = followed.strain[: len(r.t_s), 3 * k : 3 * k + 3]
            sigma = followed.sigma[: len(r.t_s), 3 * k]
            warm_up = front_end.warm_up_sigma * np.exp(-(r.t_s - r.t_s[0]) / front_end.warm_up_s)
            variance = INDEPENDENT * (sigma**2 + warm_up**2)  # the strip's past is unknown at first
            weight = weights.setdefault(r.name, np.where(signed | (r.strain >= 0), 1 / variance, 0.0))
            error, away = strain[:, 0] - r.strain, searches[k].next_own - prior
            slopes = (strain[:, 1:] - strain[:, :1]) / np.array([1e-3, 1e-4])
            cost = float(away @ information @ away + weight @ error**2)
            gradient = slopes.T @ (weight * error) + information @ away
            searches[k].take(cost, gradient, information + slopes.T @ (weight[:, None] * slopes))
    return {r.name: search.best for r, search in zip(recordings, searches, strict=True)}


class TareSearch:
    """Gauss-Newton for one strip; a step that makes things worse is halved."""

    def __init__(self, start: Tare) -> None:
        self.best, self.next_own = start, start.own
        self._cost, self._step = np.inf, np.zeros(2)

    def take(self, cost: float, gradient: NDArray[np.float64], precision: NDArray[np.float64]) -> None:
        """Take in what was found at `next_own`, and choose the next."""
        if cost < self._cost:
            self.best, self._cost = Tare(self.next_own, np.asarray(np.linalg.inv(precision), dtype=np.float64)), cost
            self._step = np.clip(self.best.covariance @ gradient, -0.2, 0.2)
        else:
            self._step = self._step / 2
        self.next_own = self.best.own - self._step


def _side_by_side(
    recordings: Sequence[Recording], tares: Sequence[Tare]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (samples, strips) dR/R on the common curve and time steps; shorter recordings stand still at their end."""
    longest = max(len(r.t_s) for r in recordings)
    change, step_s = np.empty((longest, len(recordings))), np.empty((longest, len(recordings)))
    for k, (r, tare) in enumerate(zip(recordings, tares, strict=True)):
        steps = np.diff(r.t_s)
        own_step_s = float(np.median(steps))
        change[:, k] = np.pad(tare.common(r.change), (0, longest - len(r.t_s)), mode="edge")
        step_s[:, k] = np.pad(np.append(own_step_s, steps), (0, longest - len(r.t_s)), constant_values=own_step_s)
    return change, step_s
