"""What the network is compared with: a static monotone curve, and a polynomial in resistance and filtered rates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from .recordings import Recording
from .stretching import running_means
from .strips import Followed

FILTERS_S = (0.3, 2.0, 10.0)
"""Time constants of the filters: the sensor's lag, and its relaxation over seconds."""
DEGREE = 3
RIDGE = 1e-4
"""Of the mean square of a term: keeps terms apart that are nearly the same on a slow recording."""


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
        """Fit to recordings on the common curve, by ridge regression."""
        inputs, targets = [], []
        for r in recordings:
            step_s = np.diff(r.t_s, prepend=2 * r.t_s[0] - r.t_s[1])
            counted = _counted(r, signed)
            inputs.append(_filtered(r.change[:, None], step_s[:, None])[counted, 0])
            targets.append(r.strain[counted])
        x, strain = np.concatenate(inputs), np.concatenate(targets)
        scale: NDArray[np.float64] = np.maximum(x.std(axis=0), 1e-9)
        terms = _products(x / scale)
        damping = RIDGE * len(terms) * np.diag(np.mean(terms**2, axis=0))
        coefficients = np.asarray(np.linalg.solve(terms.T @ terms + damping, terms.T @ strain), dtype=np.float64)
        return cls(scale, coefficients, float(np.std(strain - terms @ coefficients)))

    def follow(self, change: NDArray[np.float64], step_s: NDArray[np.float64]) -> Followed:
        """See `StrainEstimator`."""
        terms = _products(_filtered(change, step_s) / self.scale)
        return _followed(terms @ self.coefficients, self.sigma)


def on_common_curve(recordings: Sequence[Recording], own: Mapping[str, NDArray[np.float64]]) -> list[Recording]:
    """Return recordings with each one's own gain and offset undone."""
    return [
        Recording(r.name, r.t_s, r.strain, (r.change - own[r.name][1]) / own[r.name][0], r.scored_from_s)
        for r in recordings
    ]


def _counted(recording: Recording, signed: bool) -> NDArray[np.bool_]:
    return recording.settled & (signed | (recording.strain >= 0))


def _samples(recordings: Sequence[Recording], signed: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pairs = [(r.change[_counted(r, signed)], r.strain[_counted(r, signed)]) for r in recordings]
    change, strain = (np.concatenate(column) for column in zip(*pairs, strict=True))
    return change, strain


def _filtered(change: NDArray[np.float64], step_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (samples, strips, 4): dR/R, and its distance from its running mean over each of `FILTERS_S`."""
    away = change[..., None] - running_means(change, step_s, np.array(FILTERS_S))
    return np.concatenate([change[..., None], away], axis=-1)


def _products(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., terms): all products of up to `DEGREE` of the last axis's columns, 1 included."""
    columns = np.concatenate([np.ones((*x.shape[:-1], 1)), x], axis=-1)
    chosen = np.array(list(combinations_with_replacement(range(columns.shape[-1]), DEGREE)))
    return np.asarray(np.prod(columns[..., chosen], axis=-1))


def _followed(strain: NDArray[np.float64], sigma: float) -> Followed:
    sigmas, zeros = np.full(strain.shape, sigma), np.zeros(strain.shape)
    return Followed(strain, sigmas, sigmas, zeros, zeros.astype(np.bool_))
