"""Noise models, each created only once, and the standard deviation of each tendon's length in the graph."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..models.estimation import NoiseSettings
from ..models.values.readings import BENDING, Flag, ModelError, TendonLengths

KERNEL_SCALES = {"huber": 1.345, "cauchy": 2.3849}
"""Constants of the robust kernels that give 95 % efficiency on Gaussian noise."""
KERNELS = {
    "huber": gtsam.noiseModel.mEstimator.Huber.Create(KERNEL_SCALES["huber"]),
    "cauchy": gtsam.noiseModel.mEstimator.Cauchy.Create(KERNEL_SCALES["cauchy"]),
}
"""Robust kernels."""
AMBIGUOUS = int(Flag.AMBIGUOUS)
MOST_SHARED = 0.95
"""Largest part of a sigma that sensors share; the rest is each sensor's own."""
SIGMA_STEP = 0.01
"""Relative step to which the sigmas of tendons are rounded, so that noise models can be reused."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightedLengths:
    """The lengths of all tendons at one instant, with the sigma that each length has in the graph."""

    lengths: TendonLengths
    sigma_m: NDArray[np.float64]
    """(tendons,) as `tendon_sigma_m` returns it, times `scale`; inf for a tendon that is left out."""
    scale: float = 1.0
    """Factor of all sigmas."""

    @property
    def shared(self) -> NDArray[np.float64] | None:
        """(tendons,) what `stacked_shared` returns of one frame."""
        stacked = stacked_shared([self])
        return None if stacked is None else stacked[0]

    @property
    def count(self) -> int:
        """The number of lengths that are used."""
        return int(np.isfinite(self.sigma_m).sum())

    def scaled(self, factor: float) -> "WeightedLengths":
        """Return the same lengths with their sigmas multiplied by a factor."""
        return WeightedLengths(self.lengths, factor * self.sigma_m, factor * self.scale)

    def without(self, left_out: NDArray[np.bool_], flag: Flag | None = None) -> "WeightedLengths":
        """Return the same lengths without some tendons.

        Args:
            left_out: (tendons,) True for the tendons to leave out.
            flag: is added to the flags of these tendons; None adds no flag.
        """
        flags = self.lengths.flags | np.where(left_out, int(flag or 0), 0)
        lengths = replace(self.lengths, sigma_m=np.where(left_out, np.inf, self.lengths.sigma_m), flags=flags)
        return WeightedLengths(lengths, np.where(left_out, np.inf, self.sigma_m), self.scale)


def weigh(lengths: TendonLengths, settings: NoiseSettings) -> WeightedLengths:
    """Return the lengths of one instant with their sigma in the graph.

    With a robust kernel the errors of lengths count as independent, and what sensors share is not used.
    """
    if settings.robust != "none":
        lengths = replace(lengths, model_error=None)
    return WeightedLengths(lengths, tendon_sigma_m(lengths, settings))


def tendon_sigma_m(lengths: TendonLengths, settings: NoiseSettings) -> NDArray[np.float64]:
    """Return (tendons,): sigma^2 = sigma_mode^2 + sigma_reading^2 - sigma_rest^2; inf for a tendon to leave out.

    The part of the reading's sigma that comes from the rest shape is subtracted, because that error is the same in
    every frame.
    """
    mode_sigma_m = np.where(lengths.mode == BENDING, settings.bending_m, settings.stretching_m)
    mode_sigma_m = np.where(lengths.flags & AMBIGUOUS, settings.ambiguous_m, mode_sigma_m)
    return np.where(lengths.usable, np.sqrt(mode_sigma_m**2 + lengths.sigma_m**2 - lengths.rest_sigma_m**2), np.inf)


@lru_cache(maxsize=4096)  # where rows come at uneven times, each has its own
def isotropic(dimension: int, sigma: float) -> gtsam.noiseModel.Isotropic:
    """Return the Gaussian noise model with one sigma for all dimensions."""
    return gtsam.noiseModel.Isotropic.Sigma(dimension, sigma)


@cache
def unit(dimension: int) -> gtsam.noiseModel.Unit:
    """Return the noise model of a residual that is already divided by its sigma."""
    return gtsam.noiseModel.Unit.Create(dimension)


def tendon_noises(sigma_m: NDArray[np.float64], robust: str) -> list[gtsam.noiseModel.Base]:
    """Return the noise model of each tendon's length; sigmas are rounded on a logarithmic scale."""
    steps = np.rint(np.log(sigma_m) / SIGMA_STEP).astype(np.int64).tolist()
    return [_tendon_noise(step, robust) for step in steps]


def rounded_sigma_m(sigma_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) sigmas of lengths as `tendon_noises` rounds them."""
    return np.asarray(np.exp(SIGMA_STEP * np.rint(np.log(sigma_m) / SIGMA_STEP)))


def stacked_shared(measured: Sequence[WeightedLengths]) -> NDArray[np.float64] | None:
    """Return (frames, tendons) the part of the errors that all sensors share, over sigma_m; None if there is none.

    It is 0 in frames whose errors are independent.
    """
    known = np.array([one.lengths.model_error is not None for one in measured])
    if not known.any():
        return None
    sigma_m = np.array([one.sigma_m for one in measured])
    length_m = np.array([one.lengths.length_m for one in measured])
    scale = np.array([[one.scale] for one in measured])
    errors = ModelError.stacked([one.lengths.model_error for one in measured if one.lengths.model_error is not None])
    shared = np.zeros_like(sigma_m)
    shared[known] = scale[known] * errors.shared_m(length_m[known]) / sigma_m[known]
    return np.where(np.isfinite(sigma_m), np.clip(shared, -MOST_SHARED, MOST_SHARED), 0.0)


def independent_rows(rows: NDArray[np.float64], shared: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows of lengths, each over its sigma, as rows whose errors are independent, too.

    Errors that share a part u have the correlation C = D + u u^T with D = 1 - u^2 on its diagonal. With
    v = D^-1/2 u the rows are multiplied by

        R = (1 - (1 - 1 / sqrt(1 + v^T v)) / (v^T v) v v^T) D^-1/2,   R C R^T = 1

    Args:
        rows: (..., tendons, n)
        shared: (..., tendons) u, the shared part of each length's sigma over that sigma.
    """
    own = np.sqrt(1 - shared**2)
    v = (shared / own)[..., None]
    rows = rows / own[..., None]
    squared = np.sum(v * v, axis=(-2, -1), keepdims=True)
    factor = (1 - 1 / np.sqrt(1 + squared)) / np.maximum(squared, np.finfo(np.float64).tiny)
    return np.asarray(rows - factor * v * np.sum(v * rows, axis=-2, keepdims=True))


def robust_loss(squared: NDArray[np.float64], robust: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the loss of (...,) squared whitened residuals z^2, and the weight that each has when it is linearised.

    They are z^2 / 2 and 1 without a kernel, and else those of gtsam's kernels:

        Huber    k |z| - k^2 / 2            and k / |z|                where |z| > k
        Cauchy   c^2 / 2 log(1 + z^2 / c^2) and 1 / (1 + z^2 / c^2)
    """
    if robust == "cauchy":
        c = KERNEL_SCALES[robust]
        share = squared / c**2
        return 0.5 * c**2 * np.log1p(share), 1 / (1 + share)
    if robust == "huber":
        k = KERNEL_SCALES[robust]
        beyond = np.maximum(np.sqrt(squared), k)
        return np.where(beyond > k, k * beyond - 0.5 * k**2, 0.5 * squared), k / beyond
    return 0.5 * squared, np.ones_like(squared)


@lru_cache(maxsize=4096)
def _tendon_noise(step: int, robust: str) -> gtsam.noiseModel.Base:
    gaussian = gtsam.noiseModel.Isotropic.Sigma(1, float(np.exp(step * SIGMA_STEP)))
    return gaussian if robust == "none" else gtsam.noiseModel.Robust.Create(KERNELS[robust], gaussian)
