"""How a structure tips onto other nodes: the shortest turn, where a contact tells more than the motion did."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...factors.ground import rolled_on_floor_m
from ...models.pose.placed import PlacedShape
from ...models.pose.pose_settings import PoseSettings
from ...models.structure.floor import Floor
from ...models.values.rotations import cross_matrix, rotation_vector, shortest_rotation
from .prediction import Prediction

LANDED_M = 0.015
"""Height above the floor at which a node cannot stand: the structure has tipped further than was predicted."""
LANDING_RAD_PER_RAD05 = 0.14
"""Random walk of the turn, beside the shortest one, with the angle by which the structure tips unseen. At 36 tips of
roll_01 to roll_05 and slope_01 the turn about the vertical was 0.07 where two feet stay, 0.12 where one does, 0.3 on
the slope of five degrees, and 0.14 in all, rms."""
LANDING_M_PER_RAD05 = 0.015
"""The same of the feet that stay, per axis: 8 mm on a level floor, 30 mm on the slope, and 15 mm in all, rms."""
TIPS_RAD_PER_S = 0.3
"""Rate at which a structure turns that tips; one that is pressed turns by less."""
MISSED_RAD = 0.3
"""Heading that the shortest turn misses, above which the pose before it was wrong."""
ANY_HEADING_RAD = np.pi / np.sqrt(3)
"""Standard deviation of the turn when no node has stayed: the robot has rolled over several faces, and heads anywhere.
Its centroid has rolled by its height above the floor times the angle or further: the standard deviation per axis."""

LEAST_RISE = 1e-6
"""Height of the centroid over the middle of two nodes, in their distance, below which it is rounding error."""


def has_landed(placed: PlacedShape, floor: Floor, nodes: NDArray[np.bool_]) -> bool:
    """Return whether one of some nodes, which stand now, was predicted to be far above the floor."""
    return bool((floor.clearance_m(placed.node_position_m[nodes]) > LANDED_M).any())


def tipped(
    predicted: Prediction,
    turn: NDArray[np.float64],
    pivot_m: NDArray[np.float64],
    stands: NDArray[np.bool_],
    stayed: NDArray[np.bool_],
    floor: Floor,
    settings: PoseSettings,
) -> Prediction:
    """Return the prediction with the body turned about a point, on caps that roll, and at rest after it.

    Footholds tell nothing of the way of the tip: the nodes that have stayed need new ones, and caps do not roll on.

    Args:
        predicted: before the turn.
        turn: (3, 3) in the world.
        pivot_m: (3,) the point.
        stands: (nodes,) which nodes stand after it.
        stayed: (nodes,) which of them have stood before it, too.
        floor: the floor.
        settings: for the motion that follows.
    """
    placed = predicted.placed
    phi = rotation_vector(turn)
    angle = float(np.linalg.norm(phi))
    rolled_m = rolled_on_floor_m(phi, floor) @ floor.axes
    turned_rad, moved_m = LANDING_RAD_PER_RAD05 * np.sqrt(angle), LANDING_M_PER_RAD05 * np.sqrt(angle)
    if not stayed.any():
        rolled_m = np.zeros(3)
        turned_rad, moved_m = ANY_HEADING_RAD, angle * rolls_m(placed, floor)
    elif rolled_about_one_node(stands, stayed):
        turned_rad, moved_m = angle, angle * rolls_m(placed, floor)
    state = replace(
        placed.state,
        turn=turn @ placed.state.turn,
        position_m=pivot_m + turn @ (placed.state.position_m - pivot_m) + rolled_m,
        rate_rad_per_s=np.zeros(3),
        velocity_m_per_s=np.zeros(3),
    )
    at = state.layout
    F = np.eye(at.size)
    F[at.turn, at.turn] = heading_jacobian(turn, floor.normal)
    about_pivot = cross_matrix(pivot_m - state.position_m)
    F[at.position, at.turn] = about_pivot @ F[at.turn, at.turn] - cross_matrix(pivot_m - placed.state.position_m)
    F[at.rate] = F[at.velocity] = 0.0
    G = np.eye(at.size, 12)
    G[at.position, at.turn] = about_pivot
    G *= np.repeat([turned_rad, moved_m, settings.turn_rad_per_s, settings.motion_m_per_s], 3)
    return Prediction(placed.at(state), F @ predicted.transition, F @ predicted.covariance @ F.T + G @ G.T, np.zeros(3))


def rolled_about_one_node(stands: NDArray[np.bool_], stayed: NDArray[np.bool_]) -> bool:
    """Return whether a structure came to lie on a face of which one node alone has stood before.

    The two faces share no edge over which it could tip. It has rolled over another face between them, on either side
    of the node: heading and place are as uncertain as the turn is large.

    Args:
        stands: (nodes,) which nodes stand now.
        stayed: (nodes,) which of them have stood before.
    """
    return int(np.count_nonzero(stands)) > 2 and int(np.count_nonzero(stayed)) == 1


def misplaced(predicted: Prediction, misled_rad: float, floor: Floor) -> Prediction:
    """Return the prediction of a body whose attitude was found to be wrong after it had tipped.

    It has rolled another way than was told: heading and place are as uncertain as they would be after an unseen tip by
    the angle of the error. Footholds tell nothing of it: the nodes that stand need new ones.

    Args:
        predicted: before.
        misled_rad: the angle by which the attitude was wrong.
        floor: the floor.
    """
    placed = predicted.placed
    at = placed.state.layout
    variance = np.zeros(at.size)
    variance[at.turn] = (misled_rad * floor.normal) ** 2
    variance[at.position] = (misled_rad * rolls_m(placed, floor)) ** 2
    return predicted.then(placed, np.eye(at.size), variance)


def rolls_m(placed: PlacedShape, floor: Floor) -> float:
    """Return the way of the centroid per angle: its height above the floor, and the radius of a cap."""
    return float(floor.clearance_m(placed.state.position_m)) + floor.cap_radius_m


def heading_jacobian(turn: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3, 3), the derivative of the errors of a body's turn after a tip by those before it.

    The tip is the shortest turn T of the direction u of the body, T u = n, so that no error of the tilt is left:

        d' = n (u + n)^T / (1 + u . n) d

    Args:
        turn: (3, 3) T, and any turn about the normal after it.
        normal: (3,) n, of the floor.
    """
    up = turn.T @ normal
    return np.outer(normal, up + normal) / (1 + up @ normal)


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
        up = -across if across @ up < 0 else across
    pivot_m = node_position_m[stayed].mean(axis=0) if stayed.any() else centroid_m
    rise = float(np.linalg.norm(up))
    is_in_the_middle = rise < LEAST_RISE * float(np.linalg.norm(np.ptp(corner_m, axis=0)))  # and turns no further
    return shortest_rotation(normal if is_in_the_middle else up / rise, normal), pivot_m
