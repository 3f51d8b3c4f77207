"""The plausibility of positions: those that contradict the shape or the pose are left out.

Readings of one instant are of one body. Two of them, of nodes a and b, agree if their distance is that in the shape,

    | |y_a - y_b| - |x_a - x_b| | < MOST_SIGMA s,     s^2 = u^T (P_aa + P_bb - P_ab - P_ba) u + 2 sigma^2 + LAGS_M^2

with the direction u from b to a. The largest set of nodes is used that all agree and are where the pose expects them,
with the error e of each and the covariance S of it,

    e^T S^-1 e < MOST_SIGMA^2

and where no two agree, each that is where the pose expects it. S includes how far a node moves in a frame. Three nodes
or more are used where they may have moved to since two were seen, so that a robot that was moved unseen is found. To
agree is not enough: in a symmetric structure nodes that are exchanged keep their distances to some others.

A structure that hangs turns about its anchors, whose places are known, so that its pose changes none of the distances
to them. With the place A_k of an anchor k,

    r_ak = |y_a - A_k| - |x_a - x_k| = u_ak^T t + noise,    u_ak = (y_a - A_k) / |y_a - A_k|

where t is how far the frame of the positions is shifted against the anchors. With the covariance S of the noise, from
shape, positions and frame, and U the rows u_ak^T, it is shifted where the best t explains more than `MOST_SIGMA`^2:

    |U' t - r'| smallest,    |U' t|^2 > MOST_SIGMA^2,    U' = L^-1 U,    r' = L^-1 r,    L L^T = S
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.shape import node_blocks, pair_blocks
from ..structure.structure import Structure
from ..values.aids import PositionReading
from ..values.chi_squared import squared_distance

MOST_SIGMA = 6.0
"""Difference, in standard deviations, from which two values contradict each other."""
LAGS_M = 0.002
"""Standard deviation by which a shape lags behind a structure that tips: distances were 8 mm off at most in roll_05."""
MOVES_M_PER_S = 1.0
"""Standard deviation of the velocity of a node since the frame before."""
STANDS_M = 0.001
"""Standard deviation of where the robot stands at rest: as the pose filter takes it."""


@dataclass(frozen=True, slots=True)
class Believed:
    """Which positions of one instant are to be used."""

    passes: list[bool]
    """For each of them."""
    agreeing: int
    """Number of those in the largest set that agree with each other, used or not."""


def believed_at_rest(
    readings: Sequence[PositionReading],
    rest_m: NDArray[np.float64],
    rest_covariance_m2: NDArray[np.float64],
    sigma_m: float,
) -> list[bool]:
    """Return which positions of one instant, each of another node, agree with a robot that stands at its rest shape.

    Args:
        readings: in the world.
        rest_m: (nodes, 3) the rest shape.
        rest_covariance_m2: (3 nodes, 3 nodes) of that.
        sigma_m: standard deviation of a position, per axis.
    """
    nodes = np.array([reading.node for reading in readings])
    read_m = np.array([reading.position_m for reading in readings])
    S = node_blocks(rest_covariance_m2)[nodes] + (sigma_m**2 + STANDS_M**2) * np.eye(3)
    near = np.flatnonzero(squared_distance(read_m - rest_m[nodes], S) < MOST_SIGMA**2)
    if len(near) > 1:
        blocks_m2 = pair_blocks(rest_covariance_m2)[np.ix_(nodes[near], nodes[near])]
        agree = _agree(read_m[near], rest_m[nodes[near]], blocks_m2, sigma_m, lag_m=0.0)
        largest = _largest(agree, np.arange(len(near)))
        near = near[sorted(largest)] if len(largest) > 1 else near[:0]
    return [k in near for k in range(len(nodes))]


def believed(
    readings: Sequence[PositionReading],
    node_position_m: NDArray[np.float64],
    covariance_m2: NDArray[np.float64],
    shape_covariance_m2: NDArray[np.float64],
    step_s: float,
    unseen_s: float,
    sigma_m: float,
) -> Believed:
    """Return which positions of one instant, each of another node, are to be used.

    Args:
        readings: in the world.
        node_position_m: (nodes, 3) where the pose of the frame before expects the nodes.
        covariance_m2: (3 nodes, 3 nodes) of that, by pose and shape.
        shape_covariance_m2: (3 nodes, 3 nodes) of the shape alone, in the same axes.
        step_s: time since the frame before.
        unseen_s: time since two nodes were seen, `step_s` at least.
        sigma_m: standard deviation of a position, per axis.
    """
    nodes = np.array([reading.node for reading in readings])
    read_m = np.array([reading.position_m for reading in readings])
    expected_m = node_position_m[nodes]
    S = node_blocks(covariance_m2)[nodes] + sigma_m**2 * np.eye(3)
    e = read_m - expected_m
    squared = squared_distance(e, S + (MOVES_M_PER_S * step_s) ** 2 * np.eye(3))
    agree = _agree(read_m, expected_m, pair_blocks(shape_covariance_m2)[np.ix_(nodes, nodes)], sigma_m, LAGS_M)
    nearest = np.argsort(squared)
    agreeing = len(_largest(agree, nearest))
    if agreeing == 1:
        return Believed([bool(alone < MOST_SIGMA**2) for alone in squared], 1)
    moved = squared_distance(e, S + (MOVES_M_PER_S * unseen_s) ** 2 * np.eye(3))
    used = _largest(agree, nearest[moved[nearest] < MOST_SIGMA**2])
    if len(used) < 3:  # two that are exchanged have their distance
        used = _largest(agree, nearest[squared[nearest] < MOST_SIGMA**2])
    return Believed([k in used for k in range(len(nodes))], agreeing)


def are_shifted(
    readings: Sequence[PositionReading],
    structure: Structure,
    node_position_m: NDArray[np.float64],
    shape_covariance_m2: NDArray[np.float64],
    sigma_m: float,
) -> bool:
    """Return whether the positions of one instant are shifted against the anchors; False without anchors.

    Args:
        readings: in the world, of one recording, each of another node; those of anchors themselves are not looked at.
        structure: with the places of the anchors.
        node_position_m: (nodes, 3) the shape, however it is turned.
        shape_covariance_m2: (3 nodes, 3 nodes) of the shape alone, in the same axes.
        sigma_m: standard deviation of a position, per axis.
    """
    anchors = structure.anchors
    seen = [reading for reading in readings if reading.node not in anchors]
    if not seen or not len(anchors):
        return False
    node, anchor = (grid.ravel() for grid in np.meshgrid([reading.node for reading in seen], anchors, indexing="ij"))
    of_reading = np.repeat(np.arange(len(seen)), len(anchors))
    read_m = np.array([reading.position_m for reading in seen])[of_reading]
    U, read_away_m = _directions(read_m - np.tile(structure.anchor_position_m, (len(seen), 1)))
    D, away_m = _directions(node_position_m[node] - node_position_m[anchor])
    P = pair_blocks(shape_covariance_m2)
    by_shape = sum(
        sign * np.einsum("ai,abij,bj->ab", D, P[np.ix_(first, second)], D)
        for sign, first, second in ((1, node, node), (1, anchor, anchor), (-1, node, anchor), (-1, anchor, node))
    )
    B = np.array([np.zeros((3, 6)) if one.frame is None else one.frame.jacobian(one.position_m) for one in seen])
    by_frame = np.einsum("ai,aiz->az", U, B[of_reading])
    same = of_reading[:, None] == of_reading
    S = by_shape + by_frame @ by_frame.T + same * (U @ U.T) * sigma_m**2 + LAGS_M**2 * np.eye(len(U))
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    U, r = whiten @ U, whiten @ (read_away_m - away_m)
    t = np.linalg.lstsq(U, r, rcond=None)[0]
    return bool(np.sum((U @ t) ** 2) > MOST_SIGMA**2)


def _agree(
    read_m: NDArray[np.float64],
    shape_m: NDArray[np.float64],
    blocks_m2: NDArray[np.float64],
    sigma_m: float,
    lag_m: float,
) -> NDArray[np.bool_]:
    """Return (k, k) whether the distance of two nodes as read is that in the shape."""
    between_m = shape_m[:, None] - shape_m
    distance_m = np.linalg.norm(between_m, axis=2)
    u = between_m / np.maximum(distance_m, 1e-12)[:, :, None]
    own = np.einsum("kkij->kij", blocks_m2)
    of_both = own[:, None] + own - blocks_m2 - np.swapaxes(blocks_m2, 0, 1)
    variance = np.einsum("kli,klij,klj->kl", u, of_both, u) + 2 * sigma_m**2 + lag_m**2
    misfit_m = np.linalg.norm(read_m[:, None] - read_m, axis=2) - distance_m
    return np.asarray(np.abs(misfit_m) < MOST_SIGMA * np.sqrt(variance))


def _largest(agree: NDArray[np.bool_], among: NDArray[np.int64]) -> set[int]:
    """Return the largest set of some readings that agree with each other, the first one of equally large ones.

    Args:
        agree: (k, k) see `_agree`.
        among: numbers of these readings; the search begins with each of them, in this order.
    """
    return max((_agreeing(agree, among, first) for first in among.tolist()), key=len, default=set())


def _agreeing(agree: NDArray[np.bool_], among: NDArray[np.int64], first: int) -> set[int]:
    """Return those of some readings that agree with one and with each other, those with most friends first."""
    found = {first}
    friends = agree[np.ix_(among, among)].sum(axis=1)
    for k in among[np.argsort(-friends, kind="stable")].tolist():
        if agree[k, list(found)].all():
            found.add(k)
    return found


def _directions(between_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (k, 3) unit vectors along some differences, and (k,) their lengths."""
    distance_m = np.linalg.norm(between_m, axis=1)
    return between_m / np.maximum(distance_m, 1e-12)[:, None], distance_m
