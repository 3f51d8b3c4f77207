"""The sum that the rest step minimises, see `rest_step`, and how uncertain a part is that was told wrongly."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ...factors.own import own_rows
from ...factors.tendon import TautCables
from ...models.balance.statics import Statics
from ...models.balance.support import Support
from ...models.structure.lengths import length_jacobian, member_length_m
from ...models.structure.mechanics import Mechanics
from ...models.structure.rest_shape import GeometrySigma, RestSettings, UncertainPart
from ...models.structure.rigidity import rigid_motions
from ...models.structure.structure import Structure
from ...models.values.readings import RestLengths

WRONG_ROD_M = 0.001
"""Standard deviation of a rod's length, if the rods are what was told wrongly."""
WRONG_ANCHOR_M = 0.002
"""Standard deviation of an anchor's position per axis, if the anchors are what was told wrongly."""
WRONG_SHAPE_M = (0.002, 0.004)
"""Standard deviations of a measured position per axis, if the measured shape is what was told wrongly; the likelier one
counts. With 2 mm alone, errors of 3 mm looked like those of other parts, too."""
WRONG_AXES_M = 0.005
"""Root mean square over the nodes of what a measured shape is moved by, if it was measured in other axes than those of
the anchors: a turn by 2 degrees about its middle, or a shift."""
WRONG_NATURAL_M = 0.003
"""Standard deviation of a natural length, if the natural lengths are what was told wrongly."""
WRONG_LENGTH_M = 0.02
"""Standard deviation of a length that was measured at rest, if its sensor is wrong."""
WRONG_LENGTHS = 2
"""Largest number of such lengths."""
WRONG_HUB_M = 0.0075
"""Distance from a rod's end at which its tendons end, if it was not told that they end on hubs."""
MOST_STEPS = 200
"""Number of steps to a minimum after which there is none; six to eight are usual, from a measured shape."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The most probable z of one problem."""

    z: NDArray[np.float64]
    information: NDArray[np.float64]
    """Half the second derivative of the sum at z."""
    log_evidence: float
    """Up to a constant that all problems have in common."""
    largest_error: float
    """Of all that is known, in standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class RestProblem:
    """The sum to minimise as a function of z.

    z holds the deviations of nodes, log stiffnesses, natural lengths, and forces of the floor at the nodes that it
    carries from their known values, each divided by its sigma, or by the root of their covariance.
    """

    structure: Structure
    nominal: Mechanics | None
    known_m: NDArray[np.float64]
    """(nodes, 3) the positions known beforehand, x_known."""
    root_m: NDArray[np.float64]
    """(3 nodes, 3 nodes) square root of the covariance of known_m."""
    geometry: GeometrySigma
    settings: RestSettings
    support: Support | None
    """The force of gravity and floor; None without mechanics."""
    lengths: RestLengths | None
    """The measured lengths of the tendons; None without any."""

    @property
    def coordinates(self) -> int:
        """The number of coordinates, with which z begins."""
        return 3 * self.structure.node_count

    @property
    def hub_force_n(self) -> float:
        """Standard deviation of the unbalanced force at a node, whose tendons pull in the direction of a hub."""
        if self.nominal is None:
            return 0.0
        length_m = self.structure.tendon_length_m(self.known_m)
        tension_n = self.nominal.stiffness_n_per_m * np.maximum(length_m - self.nominal.natural_length_m, 0)
        tension_n[self.nominal.stiff_cables] = 0.0  # unknown
        squared = np.zeros(self.structure.node_count)
        np.add.at(squared, self.structure.tendons, ((tension_n / length_m) ** 2)[:, None])
        return self.geometry.hub_radius_m * float(np.sqrt(squared.mean() / 3))

    def position_m(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (nodes, 3) positions at z."""
        return self.known_m + (self.root_m @ z[: self.coordinates]).reshape(-1, 3)

    def tared(self, nominal: Mechanics, z: NDArray[np.float64]) -> Mechanics:
        """Return the nominal mechanics with the stiffnesses and natural lengths at z."""
        tendons = len(self.structure.tendons)
        by_log_stiffness, by_length = z[self.coordinates : self.coordinates + 2 * tendons].reshape(2, -1)
        stiffness = nominal.stiffness_n_per_m * np.exp(self.settings.stiffness_spread * by_log_stiffness)
        natural_length_m = nominal.natural_length_m + self.settings.natural_length_sigma_m * by_length
        return replace(nominal, stiffness_n_per_m=stiffness, natural_length_m=natural_length_m)

    def less_certain(self, wrong: tuple[UncertainPart, ...]) -> Iterator["RestProblem"]:
        """Yield the problem in which some parts of the geometry may be as far off as they are where told wrongly.

        With a measured shape that is wrong there is one for each of `WRONG_SHAPE_M`.
        """
        for shape_m in WRONG_SHAPE_M if "rest shape" in wrong else WRONG_SHAPE_M[:1]:
            yield reduce(partial(RestProblem._less_certain, shape_m=shape_m), wrong, self)

    def _less_certain(self, part: UncertainPart, shape_m: float) -> "RestProblem":
        geometry, settings = self.geometry, self.settings
        measured_m = settings.measured_sigma_m
        match part:
            case "rods":
                rod_length_m = max(geometry.rod_length_m, WRONG_ROD_M)
                return replace(self, geometry=replace(geometry, rod_length_m=rod_length_m))
            case "anchors":
                return replace(self, geometry=replace(geometry, anchor_m=max(geometry.anchor_m, WRONG_ANCHOR_M)))
            case "rest shape":
                return replace(self, root_m=max(measured_m, shape_m) * np.eye(self.coordinates))
            case "axes":
                moved_m = float(np.hypot(measured_m, WRONG_AXES_M * np.sqrt(self.structure.node_count)))
                return replace(self, root_m=covariance_root_m(self.known_m, measured_m, moved_m))
            case "hubs":
                return replace(self, geometry=replace(geometry, hub_radius_m=WRONG_HUB_M))
            case "natural lengths":
                natural_m = max(settings.natural_length_sigma_m, WRONG_NATURAL_M)
                return replace(self, settings=replace(settings, natural_length_sigma_m=natural_m))

    def minimum(self) -> Minimum:
        """Return the z that minimises |rows(z)|^2 + |z|^2."""
        size = self.coordinates + (2 * len(self.structure.tendons) + 3 * len(self._carried) if self.nominal else 0)
        solution = least_squares(
            lambda z: np.concatenate([self.rows(z)[0], z]),
            np.zeros(size),
            lambda z: np.concatenate([self.rows(z)[1], np.eye(size)]),
            method="lm",
            xtol=1e-10,
            max_nfev=MOST_STEPS,
        )
        hessian = solution.jac.T @ solution.jac
        log_sigma = len(self.structure.rods) * np.log(self.geometry.rod_length_m)
        log_sigma += 3 * len(self.structure.anchors) * np.log(self.geometry.anchor_m)
        if self.nominal:
            statics = Statics(self.structure, self.nominal)
            log_sigma += statics.rank * np.log(self._force_sigma_n)
        if self.lengths:
            log_sigma += np.log(self.lengths.sigma_m[self.lengths.is_read]).sum()
        log_evidence = -solution.cost - 0.5 * np.linalg.slogdet(hessian)[1] - log_sigma
        return Minimum(
            z=solution.x,
            information=hessian,
            log_evidence=float(log_evidence) if solution.success else -np.inf,
            largest_error=float(np.abs(solution.fun).max()),
        )

    def rows(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals over their sigmas, without those of the priors, and their Jacobian by z."""
        position_m = self.position_m(z)
        structure = self.structure
        rod_error = member_length_m(position_m, structure.rods) - structure.rod_length_m
        cable_rows, by_cables = self._cables(position_m)
        length_rows, by_lengths = self._lengths(position_m)
        anchor_error = (position_m[structure.anchors] - structure.anchor_position_m).ravel()
        by_position = np.concatenate(
            [
                length_jacobian(position_m, structure.rods) / self.geometry.rod_length_m,
                np.eye(self.coordinates)[structure.anchored_coordinates] / self.geometry.anchor_m,
                by_cables,
                by_lengths,
            ]
        )
        jacobian = np.zeros((len(by_position), len(z)))
        jacobian[:, : self.coordinates] = by_position @ self.root_m
        force_rows, force_jacobian = self._balance(z)
        of_geometry = [rod_error / self.geometry.rod_length_m, anchor_error / self.geometry.anchor_m]
        rows = [*of_geometry, cable_rows, length_rows, force_rows]
        return np.concatenate(rows), np.concatenate([jacobian, force_jacobian])

    def _cables(self, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of taut cables over their sigma, and their Jacobian; no rows without stiff cables."""
        if self.nominal is None or not len(self.nominal.stiff_cables):
            return np.zeros(0), np.zeros((0, self.coordinates))
        return own_rows([TautCables.of(self.structure, self.nominal, by_forces=False)], 0.0, position_m)

    def with_wrong_length(self, z: NDArray[np.float64]) -> "RestProblem | None":
        """Return the problem in which the length that fits worst at z is wrong; None where enough are, or all are."""
        lengths = self.lengths
        if lengths is None or np.count_nonzero(lengths.sigma_m == WRONG_LENGTH_M) >= WRONG_LENGTHS:
            return None
        is_trusted = lengths.is_read & (lengths.sigma_m < WRONG_LENGTH_M)
        if not is_trusted.any():
            return None
        apart_m = member_length_m(self.position_m(z), self.structure.tendons) - lengths.length_m
        apart = np.where(is_trusted, np.abs(apart_m) / lengths.sigma_m, -np.inf)
        worst = np.arange(len(apart)) == np.argmax(apart)
        return replace(self, lengths=replace(lengths, sigma_m=np.where(worst, WRONG_LENGTH_M, lengths.sigma_m)))

    def _lengths(self, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of measured lengths over their sigma, and their Jacobian; no rows without any."""
        if self.lengths is None:
            return np.zeros(0), np.zeros((0, self.coordinates))
        read = self.lengths.is_read
        tendons, sigma_m = self.structure.tendons[read], self.lengths.sigma_m[read]
        error_m = member_length_m(position_m, tendons) - self.lengths.length_m[read]
        return error_m / sigma_m, length_jacobian(position_m, tendons) / sigma_m[:, None]

    @property
    def _carried(self) -> NDArray[np.int64]:
        """(carried,) the nodes that the floor may carry."""
        if self.support is None:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(np.trace(self.support.covariance_n2, axis1=1, axis2=2) > 0)

    @property
    def _support_root_n(self) -> NDArray[np.float64]:
        """(carried, 3, 3) square root of the covariance of the floor's force, which is 0 along it at a bare touch."""
        assert self.support is not None, "forces need mechanics"
        variance, axes = np.linalg.eigh(self.support.covariance_n2[self._carried])
        return np.asarray(axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :])

    def supported(self, z: NDArray[np.float64]) -> Support:
        """Return the force of gravity and floor at z."""
        assert self.support is not None, "forces need mechanics"
        carried = self._carried
        force_n = self.support.force_n.copy()
        force_n[carried] += np.einsum("nij,nj->ni", self._support_root_n, z[len(z) - 3 * len(carried) :].reshape(-1, 3))
        return Support(force_n, np.zeros_like(self.support.covariance_n2))

    @property
    def _force_sigma_n(self) -> float:
        return float(np.hypot(self.settings.force_sigma_n, self.hub_force_n))

    def _balance(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of `Statics` over their sigma, and their Jacobian by z; no rows without mechanics."""
        if self.nominal is None:
            return np.zeros(0), np.zeros((0, len(z)))
        assert self.support is not None, "forces need mechanics"
        statics = Statics(self.structure, self.tared(self.nominal, z)).supported(self.supported(z))
        position = self.position_m(z)
        carried = self._carried
        by_force = statics.outer_force_jacobian(position).reshape(len(statics.group), -1, 3)[:, carried]
        by_force = np.einsum("rnj,nji->rni", by_force, self._support_root_n)
        r, by_position = statics.residual_and_jacobian(position)
        by_log_stiffness, by_natural_length = statics.mechanics_jacobian(position)
        parts = [
            by_position @ self.root_m,
            self.settings.stiffness_spread * by_log_stiffness,
            self.settings.natural_length_sigma_m * by_natural_length,
            by_force.reshape(len(r), -1),
        ]
        return r / self._force_sigma_n, np.concatenate(parts, axis=1) / self._force_sigma_n


def covariance_root_m(known_m: NDArray[np.float64], sigma_m: float, moved_m: float) -> NDArray[np.float64]:
    """Return the root of the covariance of (nodes, 3) positions.

    Args:
        known_m: (nodes, 3) the positions.
        sigma_m: standard deviation per axis of a node in the shape.
        moved_m: standard deviation of the shape along each of its shifts and turns, over all nodes.
    """
    motions = rigid_motions(known_m)
    return np.asarray(sigma_m * np.eye(known_m.size) + (moved_m - sigma_m) * motions @ motions.T)
