"""What a method says of a trial, as much of it as a result directory keeps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.external_loads import ExternalLoads
from ..structure.reconstruction import Reconstruction


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What a method says of a trial, as much of it as a result directory keeps."""

    t_s: NDArray[np.float64]
    """(frames,)"""
    node_position_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    node_covariance_m2: NDArray[np.float64]
    """(frames, nodes, 3, 3) of each node; nan from a method that gives none."""
    length_m: NDArray[np.float64]
    """(frames, tendons) as measured, nan where not."""
    sigma_m: NDArray[np.float64]
    """(frames, tendons) of the measurement, inf where there is none."""
    mode: NDArray[np.int64]
    """(frames, tendons) `Mode`."""
    flags: NDArray[np.int64]
    """(frames, tendons) `Flag` bits."""
    innovation_sigma_m: NDArray[np.float64]
    """(frames, tendons) sigma of measured minus predicted length; nan from a method that gives no covariance."""
    loads: ExternalLoads | None = None
    """Of all frames; None from a method that gives none."""

    @classmethod
    def of(cls, r: Reconstruction) -> "Estimate":
        """Return what a result directory would keep of a reconstruction."""
        lengths = (r.length_m, r.sigma_m, r.mode, r.flags, r.innovation_sigma_m)
        return cls(r.t_s, r.node_position_m, r.node_covariance_m2, *lengths, r.loads)
