"""The covariance of a shape and the loads on it, from the factors of its own frame.

The error of a sensor lasts for seconds, so that frames 20 ms apart have nearly the same errors and add little
information to each other. The estimate uses all of them, but the covariance counts each error only once: it is the
inverse of the information of the frame's own factors at the estimate,

    P = (sum_rods + sum_tendons + sum_prior J^T J / sigma^2 + sum_g J_g^T J_g / (sigma_F (1 + q_g))^2)^-1 + C_rest

Forces have the weight 1 / (1 + q)^2, q = |r_g|^2 / sigma_F^2. The curvature of Cauchy's kernel is (1 - q) / (1 + q)^2,
so that a node which carries a load contributes almost no information. C_rest is the covariance of the rest shape,
whose error shifts every frame in the same way. On the development trials 95 % ellipsoids from marginals over five
frames covered 88 to 94 % of the true positions (75 % where tendons are slack); these cover 92 to 98 % (86 to 92 %).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..factors.equilibrium import squared_norms
from ..factors.noise import WeightedLengths
from ..models.structure.external_loads import ExternalLoads, external_loads
from ..models.structure.lengths import propagated_variance
from ..models.structure.rigidity import free_length_jacobian
from ..models.values.errors import IndeterminateError
from .graph import GraphBuilder


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """The covariance of a shape, and the loads on it."""

    covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes) covariance of all coordinates, ordered by node."""
    loads: ExternalLoads | None
    """None where the stiffness of the tendons is not known."""


class FrameEvidence:
    """Computes the covariance and the loads of a shape from the factors of its own frame."""

    def __init__(self, builder: GraphBuilder) -> None:
        self._builder = builder
        structure = builder.structure
        noise = builder.noise
        self._rest_covariance_m2 = builder.rest.covariance_m2.copy()
        anchored = np.setdiff1d(np.arange(3 * structure.node_count), structure.free_coordinates)
        self._rest_covariance_m2[anchored, anchored] += noise.anchor_m**2

    def assess(self, node_position_m: NDArray[np.float64], measured: WeightedLengths) -> Assessment:
        """Return the covariance of a shape, and the loads on it where stiffness is known.

        Args:
            node_position_m: (nodes, 3) the estimate.
            measured: the lengths that it was estimated from.

        Raises:
            IndeterminateError: when there is no shape prior and no other factor determines some motion.
        """
        structure = self._builder.structure
        noise = self._builder.noise
        statics = self._builder.statics
        free = structure.free_coordinates
        sigma_m = measured.sigma_m[structure.free_tendons]
        weight = np.concatenate([np.full(len(structure.rods), 1 / noise.rod_m), 1 / sigma_m])
        weighted = free_length_jacobian(structure, node_position_m) * weight[:, None]
        information = weighted.T @ weighted + np.eye(len(free)) / noise.shape_prior_m**2
        if statics:
            r, by_position = statics.residual_and_jacobian(node_position_m)
            by_position = by_position[:, free]
            weight = 1 / (1 + squared_norms(r / noise.force_n, statics)) / noise.force_n
            weighted = by_position * weight[:, None]
            information += weighted.T @ weighted
        try:
            free_covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError as error:
            raise IndeterminateError("a node is undetermined: no shape prior, and too few lengths") from error
        covariance = self._rest_covariance_m2.copy()
        covariance[np.ix_(free, free)] += free_covariance
        if not statics:
            return Assessment(covariance, None)
        variance = propagated_variance(by_position, free_covariance)
        return Assessment(covariance, external_loads(statics, node_position_m, r, variance))
