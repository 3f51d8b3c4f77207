"""How a structure tips onto other nodes: the shortest turn, where a contact tells more than the motion did."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.pose.placed import PlacedShape
from ...models.pose.pose_settings import PoseSettings
from ...models.structure.floor import Floor
from ...models.values.rotations import rotation_vector, shortest_rotation
from .footholds import walk_variance_m2
from .prediction import Prediction

LANDED_M = 0.015
"""Height above the floor at which a node cannot stand: the structure has tipped further than was predicted."""
LANDING_RAD = 0.1
"""Standard deviation of the turn, beside the shortest one onto the face that stands."""
LANDING_M = 0.01
"""Standard deviation of the motion, beside that turn about the nodes that have stayed."""
UNSEEN_SLIP = 9.0
"""Factor of the variance by which nodes slip while the structure tips unseen: the way of its caps is unknown."""
MISSED_RAD = 0.3
"""Heading that the shortest turn misses, above which the pose before it was wrong."""
LEAP_RAD = 0.8
"""Standard deviation of the turn when no node has stayed: the robot has rolled over several faces."""
LEAP_M = 0.25
"""Standard deviation of the motion when no node has stayed."""


def has_landed(placed: PlacedShape, floor: Floor, nodes: NDArray[np.bool_]) -> bool:
    """Return whether one of some nodes, which stand now, was predicted to be far above the floor."""
    return bool((floor.clearance_m(placed.node_position_m[nodes]) > LANDED_M).any())


def tipped(
    predicted: Prediction,
    turn: NDArray[np.float64],
    pivot_m: NDArray[np.float64],
    stayed: NDArray[np.bool_],
    settings: PoseSettings,
) -> Prediction:
    """Return the prediction with the body turned about a point, and at rest after it.

    Args:
        predicted: before the turn.
        turn: (3, 3) in the world.
        pivot_m: (3,) the point.
        stayed: (nodes,) which nodes have stood before and after it.
        settings: for the motion that follows, and slips.
    """
    placed = predicted.placed
    state = replace(
        placed.state,
        turn=turn @ placed.state.turn,
        position_m=pivot_m + turn @ (placed.state.position_m - pivot_m),
        rate_rad_per_s=np.zeros(3),
        velocity_m_per_s=np.zeros(3),
    )
    at = state.layout
    F = np.eye(at.size)
    F[at.turn, at.turn] = F[at.position, at.position] = turn
    F[at.rate] = F[at.velocity] = 0.0
    turned_rad, moved_m = (LANDING_RAD, LANDING_M) if stayed.any() else (LEAP_RAD, LEAP_M)
    variance = np.zeros(at.size)
    variance[:12] = np.repeat([turned_rad, moved_m, settings.turn_rad_per_s, settings.motion_m_per_s], 3) ** 2
    angle = UNSEEN_SLIP * float(np.linalg.norm(rotation_vector(turn)))
    variance[at.foothold] = walk_variance_m2(stayed, angle, 0.0, settings)
    return predicted.then(PlacedShape(state, placed.body_m, placed.body_covariance_m2), F, variance)


def heading_missed(rod_m: NDArray[np.float64], told: NDArray[np.float64], floor: Floor) -> float:
    """Return the angle about the floor's normal by which some rods miss the directions that are told, in rad.

    Args:
        rod_m: (rods, 3) from end to end, in the world.
        told: (rods, 3) directions that inertial sensors tell.
        floor: the floor.
    """
    along, told = rod_m @ floor.axes.T, told @ floor.axes.T
    sine = np.sum(along[:, 0] * told[:, 1] - along[:, 1] * told[:, 0])
    return float(np.arctan2(sine, np.sum(along * told)))


def tipping(
    node_position_m: NDArray[np.float64],
    stands: NDArray[np.bool_],
    stayed: NDArray[np.bool_],
    normal: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (3, 3), the shortest turn that puts a structure on some of its nodes, and (3,) the point that stays.

    Three nodes or more come to lie level; over two the centroid comes to lie.

    Args:
        node_position_m: (nodes, 3) before.
        stands: (nodes,) which nodes stand after it.
        stayed: (nodes,) which of them have stood before; the structure turns about these, or else about its centroid.
        normal: (3,) of the floor.
    """
    centroid_m = node_position_m.mean(axis=0)
    corner_m = node_position_m[stands]
    middle_m = corner_m.mean(axis=0)
    up = centroid_m - middle_m
    if len(corner_m) > 2:
        across = np.linalg.svd(corner_m - middle_m)[2][2]
        up = across * np.sign(across @ up)
    pivot_m = node_position_m[stayed].mean(axis=0) if stayed.any() else centroid_m
    return shortest_rotation(up / np.linalg.norm(up), normal), pivot_m
