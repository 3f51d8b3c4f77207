"""From body coordinates to the world, and gravity and floor back: what a pose is for."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.balance.support import Support, standing, weightless
from ...models.estimation import BranchSettings
from ...models.pose.large_turn import heading_pivot_m, turned_covariance_m2
from ...models.pose.placed import PlacedShape
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import UP, Floor
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import OtherShape, Reason, Shape
from .contacts import Standing
from .pose_smoother import PoseStep
from .tipping import tipping
from .watches.shake_watch import shaken


def support_of(
    rest: RestShape,
    node_position_m: NDArray[np.float64],
    state: PoseState,
    covariance: NDArray[np.float64],
    carried: NDArray[np.float64],
) -> Support:
    """Return the force of gravity and floor, in body axes, on a structure of this pose."""
    tilt = float(np.sqrt(np.trace(covariance[:2, :2])))
    if tilt > 1.0:
        return weightless(rest.node_mass_kg)
    return standing(rest.node_mass_kg, node_position_m, state.turn.T @ UP, tilt, carried)


def placed_by(state: PoseState, shape: Shape, rest: RestShape, step: PoseStep) -> PlacedShape:
    """Return a shape of body coordinates as a state places it, with the variance that shaking adds to its own."""
    body_m = shape.node_position_m - rest.node_position_m.mean(axis=0)
    return PlacedShape(state, body_m, shaken(shape.covariance_m2, step.shaken_m2))


SPUN_RAD = 0.05
"""Standard deviation of the angle by which tendons let a rod spin while the robot tips, and bring it back: from one
side to the other it is 2 to 11 degrees in roll_01, 02, 04 and slope_01."""


def in_world(
    shape: Shape,
    rest: RestShape,
    floor: Floor,
    state: PoseState,
    covariance: NDArray[np.float64],
    step: PoseStep,
    settings: BranchSettings,
) -> Shape:
    """Return a shape of body coordinates in the world.

    Where other nodes may stand, the covariance includes where the nodes would be then. The shape on another face, or
    halfway over an edge, that is about as probable is told beside it. While it tips with sensors on parallel rods
    alone, these may have spun in the structure: the covariance includes that the robot is turned otherwise by that,
    about the nodes that stand.

    Args:
        shape: in body coordinates.
        rest: the rest shape, whose centroid is the origin of the pose.
        floor: the floor as told.
        state: the pose.
        covariance: (size, size) of its errors.
        step: of the filter, which tells which nodes stand.
        settings: when a second shape is told.
    """
    stands = step.standing
    placed = placed_by(state, shape, rest, step)
    x = placed.node_position_m
    tilted = floor.tilted(state.floor_tilt)
    total = turned_covariance_m2(placed, covariance, heading_pivot_m(state, covariance, tilted.normal))
    for probability, nodes in stands.others:
        away_m = (_standing_on(x, nodes, stands, tilted) - x).ravel()
        total += probability * np.outer(away_m, away_m)
    if step.spun_about is not None:
        pivot_m = x[stands.nodes].mean(axis=0) if stands.nodes.any() else state.position_m
        away_m = SPUN_RAD * np.cross(step.spun_about, x - pivot_m).ravel()
        total += np.outer(away_m, away_m)
    if other := stands.likeliest_other(settings.log_ratio):
        log_ratio, nodes = other
        shape = shape.with_other(OtherShape(_standing_on(x, nodes, stands, tilted), log_ratio))
    if stands.contradicted:
        shape = shape.in_doubt(Reason.CONTACTS)
    if step.contradicted_imus.any():
        shape = shape.in_doubt(Reason.IMU)
    if step.doubts_ranges:
        shape = shape.in_doubt(Reason.RANGES)
    if step.strays:
        shape = shape.in_doubt(Reason.CONTACTS)
    if stands.assumed:
        shape = shape.in_doubt(Reason.ATTITUDE)
    return replace(
        shape,
        node_position_m=x,
        covariance_m2=total,
        loads=shape.loads.turned(state.turn) if shape.loads else None,
        contacts=stands.probability,
        slips=step.slips,
        outlying_ranges=step.outlying_ranges,
        floor_normal=floor.estimated(state.floor_tilt, covariance[state.layout.floor_tilt, state.layout.floor_tilt]),
    )


def _standing_on(
    node_position_m: NDArray[np.float64], nodes: NDArray[np.bool_], stands: Standing, floor: Floor
) -> NDArray[np.float64]:
    """Return (nodes, 3) where a structure that stands on some nodes would be if it stood on others."""
    turn, pivot_m = tipping(node_position_m, nodes, nodes & stands.nodes, floor.normal)
    return pivot_m + (node_position_m - pivot_m) @ turn.T
