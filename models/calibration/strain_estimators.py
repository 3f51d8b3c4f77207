"""Causal estimators of the strain of strips from their dR/R: their interface, and the network as at run time."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..sensor.sensor_model import SensorModel
from ..sensor.stretching import Extrapolation, StrainSpread, StretchingSensors


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedStrain:
    """The output of an estimator on several strips at once."""

    strain: NDArray[np.float64]
    """(samples, strips)"""
    sigma: NDArray[np.float64]
    """(samples, strips) standard deviation of strain, without the uncertainty of gain and offset."""
    unscaled_sigma: NDArray[np.float64]
    """(samples, strips) the sigma of the network before it is scaled."""
    spread: NDArray[np.float64]
    """(samples, strips) recent spread of strain, see `StrainSpread`."""
    beyond: NDArray[np.bool_]
    """(samples, strips) whether a sample is outside the range of the training, which flags a tendon at run time."""


class StrainEstimator(Protocol):
    """A causal estimator of strain from dR/R: the network, or a baseline that it is compared with."""

    def estimate(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> EstimatedStrain:
        """Return strain and sigma.

        Args:
            change: (samples, strips) dR/R on the common curve.
            step_s: (samples, strips) time step before each sample.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class NetworkEstimator:
    """The sensor model as the front end runs it."""

    model: SensorModel

    def estimate(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> EstimatedStrain:
        """Return strain and sigma, see `StrainEstimator`."""
        count = change.shape[1]
        sensors = StretchingSensors(self.model, count)
        sensors.settle(change[0], np.ones(count, dtype=np.bool_), float(np.median(step_s)))
        rate = np.diff(change, axis=0, prepend=change[:1]) / step_s
        network = sensors.run(change, rate, step_s)
        spread = StrainSpread(count).run(network.strain, step_s)
        growth = Extrapolation(self.model, count).run(change, rate, network.strain, step_s)
        scaled = network.sigma * self.model.sigma_scale.at(spread) * growth.factor
        sigma = np.hypot(scaled, np.hypot(growth.added, network.curve_sigma))
        return EstimatedStrain(network.strain, sigma, network.sigma, spread, growth.is_beyond)
