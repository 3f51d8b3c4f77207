"""The result of a method on a trial, as far as it is stored in a result directory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.external_loads import ExternalLoads
from ..structure.reconstruction import CoordinateFrame, Reconstruction


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The result of a method on a trial, as far as it is stored in a result directory."""

    t_s: NDArray[np.float64]
    """(frames,)"""
    node_position_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    node_covariance_m2: NDArray[np.float64]
    """(frames, nodes, 3, 3) covariance of each node; nan for a method without covariance."""
    length_m: NDArray[np.float64]
    """(frames, tendons) measured lengths; nan where no length was measured."""
    sigma_m: NDArray[np.float64]
    """(frames, tendons) standard deviation of the measured length; inf where no length was measured."""
    mode: NDArray[np.int64]
    """(frames, tendons) `Mode`."""
    flags: NDArray[np.int64]
    """(frames, tendons) `Flag` bits."""
    innovation_sigma_m: NDArray[np.float64]
    """(frames, tendons) sigma of measured minus predicted length; nan for a method without covariance."""
    is_sensed: NDArray[np.bool_]
    """(tendons,) True for tendons with a sensor."""
    loads: ExternalLoads | None = None
    """Estimated loads in all frames; None for a method without loads."""
    contacts: NDArray[np.float64] | None = None
    """(frames, nodes) probability that the floor carries each node; None where there is no floor."""
    coordinate_frame: CoordinateFrame = "anchors"
    """In which the shapes are described."""

    @classmethod
    def of(cls, reconstruction: Reconstruction) -> "Estimate":
        """Return the part of a reconstruction that is stored in a result directory."""
        return cls(
            t_s=reconstruction.t_s,
            node_position_m=reconstruction.node_position_m,
            node_covariance_m2=reconstruction.node_covariance_m2,
            length_m=reconstruction.length_m,
            sigma_m=reconstruction.sigma_m,
            mode=reconstruction.mode,
            flags=reconstruction.flags,
            innovation_sigma_m=reconstruction.innovation_sigma_m,
            is_sensed=reconstruction.structure.is_sensed,
            loads=reconstruction.loads,
            contacts=reconstruction.contacts,
            coordinate_frame=reconstruction.coordinate_frame,
        )
