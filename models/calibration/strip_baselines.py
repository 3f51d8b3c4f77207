"""What the network is compared with: a static monotone curve, and a polynomial in resistance and filtered rates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from ..sensor.gauge import common_change
from ..sensor.lstm import running_means
from ..sensor.rate_curve import products, rate_inputs
from .rate_curve_fit import ridge
from .recordings import Recording
from .strain_estimators import Followed

FILTERS_S = np.array([0.3, 2.0, 10.0])
"""Time constants of the filters: the sensor's lag, and its relaxation over seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class StaticEstimator:
    """strain = s(dR/R), s monotone (isotonic regression): no memory."""

    change: NDArray[np.float64]
    """(knots,)"""
    strain: NDArray[np.float64]
    """(knots,)"""
    sigma: float
    """Of its error in training."""

    @classmethod
    def fit(cls, recordings: Sequence[Recording], signed: bool) -> "StaticEstimator":
        """Fit to recordings on the common curve."""
        change, strain = _samples(recordings, signed)
        order = np.argsort(change, kind="stable")
        fitted = isotonic_regression(strain[order]).x
        knots = np.unique(np.linspace(0, len(order) - 1, 400).astype(np.int64))
        curve_change, first = np.unique(change[order][knots], return_index=True)
        curve_strain = fitted[knots][first]
        sigma = float(np.std(strain - np.interp(change, curve_change, curve_strain)))
        return cls(curve_change, curve_strain, sigma)

    def follow(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> Followed:
        """See `StrainEstimator`."""
        return _followed(np.interp(change, self.change, self.strain), self.sigma)


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialEstimator:
    """Strain as a cubic in dR/R and in how far it is from its running means over three times: filtered rates."""

    scale: NDArray[np.float64]
    """(4,) of the four inputs."""
    coefficients: NDArray[np.float64]
    """(35,) of all products of up to three inputs."""
    sigma: float
    """Of its error in training."""

    @classmethod
    def fit(cls, recordings: Sequence[Recording], signed: bool) -> "PolynomialEstimator":
        """Fit to recordings on the common curve."""
        parts = [(r.counted(signed), rate_inputs(r.change, r.running_means(FILTERS_S)), r.strain) for r in recordings]
        inputs = np.concatenate([x[counted] for counted, x, _ in parts])
        strain = np.concatenate([strain[counted] for counted, _, strain in parts])
        scale: NDArray[np.float64] = np.maximum(inputs.std(axis=0), 1e-9)
        terms = products(inputs / scale)
        coefficients, _ = ridge(terms, strain)
        return cls(scale, coefficients, float(np.std(strain - terms @ coefficients)))

    def follow(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> Followed:
        """See `StrainEstimator`."""
        inputs = rate_inputs(change, running_means(change, step_s, FILTERS_S))
        return _followed(products(inputs / self.scale) @ self.coefficients, self.sigma)


def on_common_curve(recordings: Sequence[Recording], own: Mapping[str, NDArray[np.float64]]) -> list[Recording]:
    """Return recordings with each one's own gain and offset undone."""
    return [
        Recording(r.name, r.t_s, r.strain, common_change(r.change, *own[r.name]), r.scored_from_s) for r in recordings
    ]


def _samples(recordings: Sequence[Recording], signed: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pairs = [(r.change[r.counted(signed)], r.strain[r.counted(signed)]) for r in recordings]
    change, strain = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return change, strain


def _followed(strain: NDArray[np.float64], sigma: float) -> Followed:
    sigmas, zeros = np.full(strain.shape, sigma), np.zeros(strain.shape)
    return Followed(strain, sigmas, sigmas, zeros, zeros.astype(np.bool_))
