"""Torques of a structure that hangs: they balance about its suspension.

With the weight W, the lever d from the suspension to the centre of mass, in world axes, and the torque T of hands,
about every axis e of the suspension

    e . (d x (-z) + T / W) = 0

A swing and what is not told of the masses are in its variance.
"""

import numpy as np
from numpy.typing import NDArray

from ..models.pose.placed import PlacedShape, Rows
from ..models.structure.floor import UP
from ..models.structure.suspension import Suspension
from ..models.values.rotations import cross_matrix


def torque_rows(
    placed: PlacedShape,
    suspension: Suspension,
    lever_m: NDArray[np.float64],
    hands_m: NDArray[np.float64],
    covariance_m2: NDArray[np.float64],
) -> Rows:
    """Return one row for each axis about which the structure swings.

    Args:
        placed: the shape in the world.
        suspension: where it hangs.
        lever_m: (3,) d, in body axes.
        hands_m: (3,) T / W, in body axes.
        covariance_m2: (3, 3) of the sum of both torques over the weight, in world axes.
    """
    axes, turn = suspension.axes, placed.state.turn
    lever, hands = turn @ lever_m, turn @ hands_m
    jacobian = np.zeros((len(axes), placed.state.layout.size))
    down = lever if lever @ UP < 0 else -lever  # upside down, the way to rest is that of the torque, too
    by_turn = -cross_matrix(UP) @ cross_matrix(down) - cross_matrix(hands)
    if suspension.is_ball:  # level axes turn with the structure about the vertical, of which the balance says nothing
        by_turn = by_turn @ (np.eye(3) - np.outer(UP, UP))
    jacobian[:, placed.state.layout.turn] = axes @ by_turn
    error = -suspension.torque_m(lever) - axes @ hands
    return Rows(error, jacobian, np.einsum("ai,ij,aj->a", axes, covariance_m2, axes))
