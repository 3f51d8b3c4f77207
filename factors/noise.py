"""Noise models, each made once; and the one place that says how far a tendon's length is to be trusted."""

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..models.estimation import NoiseSettings
from ..models.values.readings import Flag, Mode, TendonLengths

KERNELS = {
    "huber": gtsam.noiseModel.mEstimator.Huber.Create(1.345),
    "cauchy": gtsam.noiseModel.mEstimator.Cauchy.Create(2.3849),
}
"""At 95 % efficiency on Gaussian noise."""
# plain numbers: an array compared with an enumeration takes ten times as long
BENDING = int(Mode.BENDING)
AMBIGUOUS = int(Flag.AMBIGUOUS)
SIGMA_STEP = 0.01
"""Sigmas of tendons are rounded to within half of this ratio, so that their models can be kept."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightedLengths:
    """One instant of all tendons with the sigma that each length has in the graph."""

    lengths: TendonLengths
    sigma_m: NDArray[np.float64]
    """(tendons,) see `tendon_sigma_m`; inf for a tendon that is left out."""

    def without(self, left_out: NDArray[np.bool_], flag: Flag | None = None) -> "WeightedLengths":
        """Return the same without some tendons.

        Args:
            left_out: (tendons,) which of them.
            flag: says why, in their flags; none if None.
        """
        flags = self.lengths.flags | np.where(left_out, int(flag or 0), 0)
        lengths = replace(self.lengths, sigma_m=np.where(left_out, np.inf, self.lengths.sigma_m), flags=flags)
        return WeightedLengths(lengths, np.where(left_out, np.inf, self.sigma_m))


def weigh(lengths: TendonLengths, settings: NoiseSettings) -> WeightedLengths:
    """Return the lengths of one instant with their sigma in the graph."""
    return WeightedLengths(lengths, tendon_sigma_m(lengths, settings))


def tendon_sigma_m(lengths: TendonLengths, settings: NoiseSettings) -> NDArray[np.float64]:
    """Return (tendons,): sigma^2 = (the mode's own)^2 + (the reading's)^2; inf for a tendon to leave out.

    What the reading owes to the rest shape is not in it: that error is one and the same in every frame.
    """
    own = np.where(lengths.mode == BENDING, settings.bending_m, settings.stretching_m)
    own = np.where(lengths.flags & AMBIGUOUS, settings.ambiguous_m, own)
    return np.where(lengths.usable, np.sqrt(own**2 + lengths.sigma_m**2 - lengths.rest_sigma_m**2), np.inf)


@cache
def isotropic(dimension: int, sigma: float) -> gtsam.noiseModel.Isotropic:
    """Return the Gaussian model of a sigma."""
    return gtsam.noiseModel.Isotropic.Sigma(dimension, sigma)


@cache
def unit(dimension: int) -> gtsam.noiseModel.Unit:
    """Return the model of what is already divided by its sigma."""
    return gtsam.noiseModel.Unit.Create(dimension)


def tendon_noises(sigma_m: NDArray[np.float64], robust: str) -> list[gtsam.noiseModel.Base]:
    """Return the model of each tendon's length, sigmas rounded on a logarithmic scale."""
    steps = np.rint(np.log(sigma_m) / SIGMA_STEP).astype(np.int64).tolist()
    return [_tendon_noise(step, robust) for step in steps]


@lru_cache(maxsize=4096)
def _tendon_noise(step: int, robust: str) -> gtsam.noiseModel.Base:
    gaussian = gtsam.noiseModel.Isotropic.Sigma(1, float(np.exp(step * SIGMA_STEP)))
    return gaussian if robust == "none" else gtsam.noiseModel.Robust.Create(KERNELS[robust], gaussian)
