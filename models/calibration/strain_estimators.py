"""Strain of strips from their dR/R, causally: the network as the front end runs it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..sensor.sensor_model import SensorModel
from ..sensor.stretching import Extrapolation, StrainSpread, StretchingSensors


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """An estimator's output on several strips side by side."""

    strain: NDArray[np.float64]
    """(samples, strips)"""
    sigma: NDArray[np.float64]
    """(samples, strips) its gain_and_offset, without what the tare leaves."""
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
        sensors = StretchingSensors(self.model, count)
        running = StrainSpread(count)
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
