"""The rest step, before the first frame: it estimates the rest shape, the stiffnesses and the natural lengths.

Known beforehand are the rods and anchors (exactly), the nominal stiffnesses and natural lengths, and the shape, if it
was measured. Without load the forces balance. The most probable nodes x, stiffnesses k and natural lengths L0 minimise

    |(l_rod(x) - L_rod) / sigma_rod|^2 + |(x - x_known) / sigma_x|^2
        + |r(x; k, L0) / sigma_F|^2 + |log(k / k_nominal) / spread|^2 + |(L0 - L0_given) / sigma_L0|^2

with r of `Statics`. One common scale of all k does not change the balance; the prior determines it, and it has little
effect on shapes. Ratios of k that do not balance at rest, in contrast, would shift the shape in every frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..models.structure.lengths import length_jacobian, member_length_m
from ..models.structure.rest_shape import RestSettings, RestShape
from ..models.structure.rigidity import find_rest_shape
from ..models.structure.statics import Mechanics, Statics
from ..models.structure.structure import Structure

ROD_SIGMA_M = 1e-5
"""Standard deviation of a rod's length in the rest step: small enough that rods keep their lengths exactly."""

Rows = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


def rest_step(
    structure: Structure,
    mechanics: Mechanics | None,
    measured_position_m: NDArray[np.float64] | None,
    settings: RestSettings,
) -> RestShape:
    """Return the rest shape with its covariance, and the mechanics that balance there.

    Args:
        structure: its rod lengths and anchor positions are kept exactly.
        mechanics: the nominal mechanics; None where stiffness is not known, and then forces are not used.
        measured_position_m: (nodes, 3) the measured rest shape; None where it was not measured.
        settings: the standard deviations of what is known beforehand.

    Raises:
        IndeterminateError: when neither a measurement nor form finding gives a shape.
    """
    source: Literal["measured", "found"] = "found" if measured_position_m is None else "measured"
    known_m = structure.with_anchors_placed(
        find_rest_shape(structure) if measured_position_m is None else measured_position_m
    )
    if source == "measured":
        sigma_m = settings.measured_sigma_m
    else:  # with mechanics the equilibrium corrects the shape; without, it is that of equally stiff tendons
        sigma_m = settings.found_sigma_m if mechanics is None else float(structure.rod_length_m.mean())
    problem = _RestProblem(structure, mechanics, known_m, sigma_m, settings)
    z, covariance = _most_probable(problem.rows, problem.unknowns)
    size = len(structure.free_coordinates)
    covariance_m2 = _all_nodes_covariance(structure, sigma_m**2 * covariance[:size, :size])
    position_m = problem.position_m(z)
    if mechanics is None:
        return RestShape(node_position_m=position_m, covariance_m2=covariance_m2, source=source)
    tared = problem.tared(mechanics, z)
    unbalanced_n = (_rms_n(structure, mechanics, position_m), _rms_n(structure, tared, position_m))
    return RestShape(
        node_position_m=position_m,
        covariance_m2=covariance_m2,
        source=source,
        mechanics=tared,
        unbalanced_n=unbalanced_n,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _RestProblem:
    """The sum to minimise as a function of z.

    z holds the deviations of free nodes, log stiffnesses and natural lengths from their known values, each divided by
    its sigma.
    """

    structure: Structure
    nominal: Mechanics | None
    known_m: NDArray[np.float64]
    """(nodes, 3) the positions known beforehand, x_known."""
    sigma_m: float
    """Standard deviation of known_m, per axis."""
    settings: RestSettings

    @property
    def unknowns(self) -> int:
        """The number of elements of z."""
        return len(self.structure.free_coordinates) + (2 * len(self.structure.tendons) if self.nominal else 0)

    def position_m(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (nodes, 3) positions at z."""
        position = self.known_m.copy()
        free = self.structure.free_nodes
        position[free] += self.sigma_m * z[: 3 * len(free)].reshape(-1, 3)
        return position

    def tared(self, nominal: Mechanics, z: NDArray[np.float64]) -> Mechanics:
        """Return the nominal mechanics with the stiffnesses and natural lengths at z."""
        by_log_stiffness, by_length = z[len(self.structure.free_coordinates) :].reshape(2, -1)
        stiffness = nominal.stiffness_n_per_m * np.exp(self.settings.stiffness_spread * by_log_stiffness)
        natural_length_m = nominal.natural_length_m + self.settings.natural_length_sigma_m * by_length
        return replace(nominal, stiffness_n_per_m=stiffness, natural_length_m=natural_length_m)

    def rows(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals over their sigmas, without those of the priors, and their Jacobian by z."""
        rod_rows, rod_jacobian = self._rods(z)
        force_rows, force_jacobian = self._balance(z)
        return np.concatenate([rod_rows, force_rows]), np.concatenate([rod_jacobian, force_jacobian])

    def _rods(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (rods,) the errors of the rods' lengths over their sigma, and their Jacobian by z."""
        structure = self.structure
        position = self.position_m(z)
        rod_error = member_length_m(position, structure.rods) - structure.rod_length_m
        by_node = length_jacobian(position, structure.rods, structure.free_coordinates)
        jacobian = np.zeros((len(rod_error), len(z)))
        jacobian[:, : by_node.shape[1]] = self.sigma_m * by_node
        return rod_error / ROD_SIGMA_M, jacobian / ROD_SIGMA_M

    def _balance(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of `Statics` over their sigma, and their Jacobian by z; no rows without mechanics."""
        if self.nominal is None:
            return np.zeros(0), np.zeros((0, len(z)))
        statics = Statics(self.structure, self.tared(self.nominal, z))
        position = self.position_m(z)
        r, by_position = statics.residual_and_jacobian(position)
        by_log_stiffness, by_natural_length = statics.mechanics_jacobian(position)
        parts = [
            self.sigma_m * by_position[:, self.structure.free_coordinates],
            self.settings.stiffness_spread * by_log_stiffness,
            self.settings.natural_length_sigma_m * by_natural_length,
        ]
        return r / self.settings.force_sigma_n, np.concatenate(parts, axis=1) / self.settings.force_sigma_n


def _most_probable(rows: Rows, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the z that minimises |rows(z)|^2 + |z|^2, and its covariance."""
    solution = least_squares(
        lambda z: np.concatenate([rows(z)[0], z]),
        np.zeros(size),
        lambda z: np.concatenate([rows(z)[1], np.eye(size)]),
        method="lm",
        xtol=1e-10,
    )
    return solution.x, np.linalg.inv(solution.jac.T @ solution.jac)


def _rms_n(structure: Structure, mechanics: Mechanics, position_m: NDArray[np.float64]) -> float:
    """Return the root mean square of the unbalanced forces."""
    return float(np.sqrt(np.mean(Statics(structure, mechanics).residual_n(position_m) ** 2)))


def _all_nodes_covariance(structure: Structure, free_covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3 nodes, 3 nodes) covariance of all nodes, which is zero at the anchors."""
    coordinates = structure.free_coordinates
    covariance = np.zeros((3 * structure.node_count, 3 * structure.node_count))
    covariance[np.ix_(coordinates, coordinates)] = free_covariance
    return covariance
