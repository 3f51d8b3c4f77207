"""The floor: a node that stands is at the floor's height, and stays where it stands while its end cap rolls.

With the normal n, the floor's height h, the foothold c of node k, both floor axes E, and the turn phi of the body since
the frame before, a node x_k that stands has

    n . x_k = h,     E x_k = c_k + r E (phi x n)

where r is the radius of the cap. A node cannot be below the floor. Where the normal is not told exactly, n and h of the
heights are those of the floor as the state tilts it; E, and n of the caps' way, are those of the floor as told.
"""

import numpy as np
from numpy.typing import NDArray

from ..models.pose.placed import PlacedShape, Rows
from ..models.structure.floor import Floor
from ..models.values.rotations import cross, cross_matrix


def height_rows(placed: PlacedShape, floor: Floor, nodes: NDArray[np.int64], sigma_m: float, repeats: float) -> Rows:
    """Return one row for each of the nodes that are at the height of the floor.

    Args:
        placed: the shape in the world.
        floor: the floor as told.
        nodes: the nodes that stand, or would be below the floor.
        sigma_m: standard deviation of the floor's height.
        repeats: number of frames for which the error of the shape lasts.
    """
    tilted = floor.tilted(placed.state.floor_tilt)
    n = tilted.normal
    of_shape = placed.node_covariance_m2[nodes] @ n @ n
    return Rows(
        error=-tilted.clearance_m(placed.node_position_m[nodes]),
        jacobian=clearance_jacobian(placed, floor)[nodes],
        variance=repeats * (sigma_m**2 + of_shape),
    )


def clearance_jacobian(placed: PlacedShape, floor: Floor) -> NDArray[np.float64]:
    """Return (nodes, size), the derivatives of the nodes' heights above the floor by the errors of the state."""
    at, tilt = placed.state.layout, placed.state.floor_tilt
    n = floor.tilted(tilt).normal
    jacobian = np.zeros((len(placed.arm_m), at.size))
    jacobian[:, at.turn] = cross(placed.arm_m, n)  # n . (d x a) = d . (a x n)
    jacobian[:, at.position] = n
    jacobian[:, at.floor_tilt] = floor.clearance_by_tilt_m(placed.node_position_m, tilt)
    return jacobian


def velocity_along_floor(
    placed: PlacedShape, axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (nodes, 2) E (v + w x a), the nodes' velocities along the floor, and (nodes, 2, size) their derivatives.

    Args:
        placed: the shape in the world, whose nodes are at the arms a from the centroid.
        axes: (2, 3) E, along the floor.
    """
    state, at = placed.state, placed.state.layout
    v = (state.velocity_m_per_s + cross(state.rate_rad_per_s, placed.arm_m)) @ axes.T
    jacobian = np.zeros((len(v), 2, at.size))
    jacobian[:, :, at.velocity] = axes
    jacobian[:, :, at.rate] = -axes @ cross_matrix(placed.arm_m)
    return v, jacobian


def clearance_covariance_m2(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> NDArray[np.float64]:
    """Return (nodes, nodes) the covariance of the nodes' heights by attitude, tilt of the floor, and shape.

    The height of the centroid, which is the same for all nodes, is not in it.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor as told.
    """
    at, tilted = placed.state.layout, floor.tilted(placed.state.floor_tilt)
    attitude = np.r_[at.turn, at.floor_tilt]
    H = clearance_jacobian(placed, floor)[:, attitude]
    return np.asarray(H @ covariance[np.ix_(attitude, attitude)] @ H.T + placed.height_covariance_m2(tilted.normal))


def foothold_rows(
    placed: PlacedShape,
    floor: Floor,
    nodes: NDArray[np.int64],
    turned: NDArray[np.float64],
    sigma_m: float,
) -> Rows:
    """Return two rows for each of the nodes that have stood since the frame before.

    Args:
        placed: the shape in the world.
        floor: the floor.
        nodes: these nodes.
        turned: (3,) phi, rotation vector of the body since the frame before.
        sigma_m: standard deviation of a foothold.
    """
    at = placed.state.layout
    rolled_m = rolled_on_floor_m(turned, floor)
    error = placed.state.foothold_m[nodes] + rolled_m - placed.node_position_m[nodes] @ floor.axes.T
    of_nodes = np.zeros((len(nodes), 2, at.size))
    by_roll = floor.cap_radius_m * cross_matrix(floor.normal)  # d(phi x n) = -n x d(phi)
    by_turn = by_roll - cross_matrix(placed.arm_m[nodes])
    of_nodes[:, :, at.turn] = floor.axes @ by_turn
    of_nodes[:, :, at.position] = floor.axes
    jacobian = of_nodes.reshape(-1, at.size)
    rows = np.arange(len(jacobian))
    jacobian[rows, (at.foothold.start + 2 * nodes[:, None] + np.arange(2)).ravel()] = -1.0
    of_shape = np.sum(floor.axes @ placed.node_covariance_m2[nodes] * floor.axes, axis=2)
    return Rows(error.ravel(), jacobian, (sigma_m**2 + of_shape).ravel())


def rolled_on_floor_m(turned: NDArray[np.float64], floor: Floor) -> NDArray[np.float64]:
    """Return (2,), the way r E (phi x n) that the centre of a cap rolls when the body turns by phi."""
    return np.asarray(floor.cap_radius_m * floor.axes @ cross(turned, floor.normal))
