"""The rest step, before the first frame: where the structure stands, and with what stiffness and natural lengths.

Known beforehand are rods and anchors (exactly), nominal stiffness and natural lengths, and, where someone measured it,
the shape. Unloaded, forces balance. The most probable nodes x, stiffnesses k and natural lengths L0 minimise

    |(l_rod(x) - L_rod) / sigma_rod|^2 + |(x - x_known) / sigma_x|^2
        + |r(x; k, L0) / sigma_F|^2 + |log(k / k_nominal) / spread|^2 + |(L0 - L0_given) / sigma_L0|^2

with r of `Statics`. It has as many equations as tendons and is blind to one common scale of k, which the prior holds:
that hardly matters to shapes, while ratios of k that do not balance at rest would pull every frame aside.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..models.geometry import length_jacobian, member_length_m
from ..models.rest import RestSettings, RestShape
from ..models.rigidity import find_rest_shape
from ..models.statics import Mechanics, Statics
from ..models.structure import Structure

ROD_SIGMA_M = 1e-5
"""Exact, for all that follows."""

Rows = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


def rest_step(
    structure: Structure,
    mechanics: Mechanics | None,
    measured_position_m: NDArray[np.float64] | None,
    settings: RestSettings,
) -> RestShape:
    """Return the rest shape with its covariance, and the mechanics that balance there.

    Args:
        structure: rods and anchors are kept exactly.
        mechanics: nominal; None where it is not known, then forces say nothing.
        measured_position_m: (nodes, 3) of the structure at rest, if it was measured.
        settings: how well each of them is known.

    Raises:
        IndeterminateError: when neither a measurement nor form finding gives a shape.
    """
    source: Literal["measured", "found"] = "found" if measured_position_m is None else "measured"
    known_m = structure.with_anchors_placed(
        find_rest_shape(structure) if measured_position_m is None else measured_position_m
    )
    if source == "measured":
        sigma_m = settings.measured_sigma_m
    else:  # equilibrium finds the shape; without it the shape is that of equal tendons
        sigma_m = settings.found_sigma_m if mechanics is None else float(structure.rod_length_m.mean())
    free = structure.free_nodes
    size = 3 * len(free)

    def place(z: NDArray[np.float64]) -> NDArray[np.float64]:
        position = known_m.copy()
        position[free] += sigma_m * z[:size].reshape(-1, 3)
        return position

    def geometry(z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rod_error = member_length_m(place(z), structure.rods) - structure.rod_length_m
        rows = length_jacobian(place(z), structure.rods)[:, free].reshape(len(rod_error), -1)
        jacobian = np.zeros((len(rod_error), len(z)))
        jacobian[:, :size] = sigma_m * rows
        return rod_error / ROD_SIGMA_M, jacobian / ROD_SIGMA_M

    if mechanics is None:
        z, covariance = _most_probable(geometry, size)
        return RestShape(place(z), _of_all_nodes(structure, sigma_m**2 * covariance), source)

    nominal = mechanics
    tendons = len(structure.tendons)

    def tared(z: NDArray[np.float64]) -> Mechanics:
        stiffness = nominal.stiffness_n_per_m * np.exp(settings.stiffness_spread * z[size : size + tendons])
        natural_length_m = nominal.natural_length_m + settings.natural_length_sigma_m * z[size + tendons :]
        return replace(nominal, stiffness_n_per_m=stiffness, natural_length_m=natural_length_m)

    def balance(z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        statics, position = Statics(structure, tared(z)), place(z)
        r, by_position = statics.residual_and_jacobian(position)
        by_log_stiffness, by_natural_length = statics.mechanics_jacobian(position)
        by_position = by_position.reshape(len(r), -1, 3)[:, free].reshape(len(r), -1)
        jacobian = np.concatenate(
            [
                sigma_m * by_position,
                settings.stiffness_spread * by_log_stiffness,
                settings.natural_length_sigma_m * by_natural_length,
            ],
            axis=1,
        )
        return r / settings.force_sigma_n, jacobian / settings.force_sigma_n

    def rows(z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        (r, J), (f, F) = geometry(z), balance(z)
        return np.concatenate([r, f]), np.concatenate([J, F])

    z, covariance = _most_probable(rows, size + 2 * tendons)
    position, mechanics = place(z), tared(z)
    unbalanced_n = _rms_n(structure, nominal, position), _rms_n(structure, mechanics, position)
    covariance_m2 = _of_all_nodes(structure, sigma_m**2 * covariance[:size, :size])
    return RestShape(position, covariance_m2, source, mechanics, unbalanced_n=unbalanced_n)


def _most_probable(rows: Rows, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum of |rows(z)|^2 + |z|^2, z being deviations over their sigmas, and the covariance there."""
    solution = least_squares(
        lambda z: np.concatenate([rows(z)[0], z]),
        np.zeros(size),
        lambda z: np.concatenate([rows(z)[1], np.eye(size)]),
        method="lm",
        xtol=1e-10,
    )
    return solution.x, np.linalg.inv(solution.jac.T @ solution.jac)


def _rms_n(structure: Structure, mechanics: Mechanics, position_m: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(Statics(structure, mechanics).residual_n(position_m) ** 2)))


def _of_all_nodes(structure: Structure, free_covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3 nodes, 3 nodes): anchors do not move."""
    coordinates = structure.free_coordinates
    covariance = np.zeros((3 * structure.node_count, 3 * structure.node_count))
    covariance[np.ix_(coordinates, coordinates)] = free_covariance
    return covariance
