"""The rest shape: where the structure stands before anyone touches it, measured or found."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .geometry import length_jacobian, member_length_m
from .rigidity import find_rest_shape
from .structure import Structure
from .tables import Positive
from .taring import RestLengths


@dataclass(frozen=True, slots=True)
class RestSettings:
    """How well a rest shape is known, per axis."""

    measured_sigma_m: Positive = 0.0003
    """Of a shape measured by motion capture."""
    found_sigma_m: Positive = 0.003
    """Of a shape found from lengths alone: 10 % of spread in stiffness and gravity move nodes by so much."""


@dataclass(frozen=True, slots=True, eq=False)
class RestShape:
    """The unloaded shape, with its uncertainty."""

    node_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes)"""
    source: Literal["measured", "found"]

    def lengths(self, structure: Structure, seconds: float) -> RestLengths:
        """Return the tendon lengths at rest with their sigma."""
        jacobian = length_jacobian(self.node_position_m, structure.tendons).reshape(len(structure.tendons), -1)
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance_m2, jacobian)
        length_m = structure.tendon_length_m(self.node_position_m)
        return RestLengths(seconds, length_m, np.sqrt(np.maximum(variance, 1e-12)))


def rest_shape(
    structure: Structure, measured_position_m: NDArray[np.float64] | None, settings: RestSettings
) -> RestShape:
    """Return the rest shape nearest to the measured nodes, or else to the found one, that keeps rods and anchors.

    The rods' lengths are taken as exact: x = m - C J^T (J C J^T)^-1 (l(m) - l_rod), and C shrinks alike.
    """
    source: Literal["measured", "found"] = "found" if measured_position_m is None else "measured"
    position = find_rest_shape(structure) if measured_position_m is None else measured_position_m
    sigma_m = settings.found_sigma_m if measured_position_m is None else settings.measured_sigma_m
    position = structure.with_anchors_placed(position)
    variance = np.full((structure.node_count, 3), sigma_m**2)
    variance[structure.anchors] = 0.0
    covariance = prior = np.diag(variance.ravel())
    start = position
    for _ in range(3):
        jacobian = length_jacobian(position, structure.rods).reshape(len(structure.rods), -1)
        gain = prior @ jacobian.T @ np.linalg.pinv(jacobian @ prior @ jacobian.T)
        misfit = member_length_m(position, structure.rods) - structure.rod_length_m
        position = start - (gain @ (misfit + jacobian @ (start - position).ravel())).reshape(-1, 3)
        covariance = prior - gain @ jacobian @ prior
    return RestShape(position, covariance, source)
