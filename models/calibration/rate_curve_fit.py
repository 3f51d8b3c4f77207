"""The rate curve, fitted to recordings by ridge regression."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from ..sensor.rate_curve import RateCurve, curve_terms, rate_inputs
from .recordings import Recording, correlated_samples

RIDGE = 1e-4
"""Damping as a share of the mean square of a term, because some terms are nearly equal on a slow recording."""


def fit_rate_curve(
    recordings: Sequence[Recording], gauge: StaticGauge, memory_s: NDArray[np.float64], unified: bool
) -> RateCurve:
    """Return the rate curve fitted by ridge regression to recordings on the common curve.

    Args:
        recordings: with gain and offset removed.
        gauge: the static gauge curve.
        memory_s: (memories,) time constants of the running means.
        unified: whether bent samples are fitted, too.
    """
    inputs, strain = rate_samples(recordings, memory_s, unified)
    scale: NDArray[np.float64] = np.maximum(inputs.std(axis=0), 1e-9)
    input_range = np.stack([inputs.min(axis=0), inputs.max(axis=0)])
    terms = curve_terms(inputs, scale, gauge)
    coefficients, normal = ridge(terms, strain)
    independent = sum(r.counted(unified).sum() / correlated_samples(r.t_s) for r in recordings)
    residual_sigma = np.sqrt(len(strain) / independent) * np.std(strain - terms @ coefficients)
    factor = residual_sigma * np.linalg.inv(np.linalg.cholesky(normal)).T
    return RateCurve(
        gauge=gauge, memory_s=memory_s, scale=scale, range=input_range, coefficients=coefficients, factor=factor
    )


def rate_samples(
    recordings: Sequence[Recording], memory_s: NDArray[np.float64], unified: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (samples, 1 + memories) inputs and the (samples,) strain of all samples that count."""
    parts = [(rate_inputs(r.change, r.running_means(memory_s)), r.strain, r.counted(unified)) for r in recordings]
    inputs = np.concatenate([x[counted] for x, _, counted in parts])
    return inputs, np.concatenate([strain[counted] for _, strain, counted in parts])


def ridge(terms: NDArray[np.float64], strain: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (terms,) coefficients of strain, damped by `RIDGE`, and the (terms, terms) damped normal matrix."""
    normal = np.einsum("ni,nj->ij", terms, terms)  # sums in the same order for any number of cores
    normal += RIDGE * np.diag(np.diag(normal))
    return np.asarray(np.linalg.solve(normal, np.einsum("ni,n->i", terms, strain))), normal
