"""Where the nodes that stand have their feet: new footholds, their random walk, and slips."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...factors.ground import foothold_rows
from ...models.balance.sliding import least_friction_slides_m
from ...models.balance.support import legs_n
from ...models.pose.placed import Rows
from ...models.pose.pose_settings import PoseSettings
from ...models.structure.floor import UP, Floor
from ...models.values.chi_squared import squared_distance
from ...models.values.slip import Slip
from .prediction import Prediction

LEAST_SHARE = 0.05
"""Least share of the weight on a node that stands: the centre of mass is not quite the centroid."""


def walk_variance_m2(
    stands: NDArray[np.bool_], turned_rad: float, step_s: float, settings: PoseSettings
) -> NDArray[np.float64]:
    """Return (2 nodes,) the variance by which footholds walk while the body turns by an angle in a time step.

    Args:
        stands: (nodes,) which nodes stand; the others have no foothold.
        turned_rad: the angle.
        step_s: the time step.
        settings: creep over time, slip over angle.
    """
    walk = settings.creep_m_per_s05**2 * step_s + settings.slip_m_per_rad05**2 * turned_rad
    return np.repeat(np.where(stands, walk, 0.0), 2)


def let_slide(
    predicted: Prediction,
    body_before_m: NDArray[np.float64],
    stands: NDArray[np.bool_],
    stayed: NDArray[np.bool_],
    floor: Floor,
    settings: PoseSettings,
) -> Prediction:
    """Return the prediction with the random walk of the footholds that slide because the structure deforms.

    In proportion to the way, and inverse to the weight, it makes the motion of least friction the likeliest.

    Args:
        predicted: before.
        body_before_m: (nodes, 3) the shape in the frame before, relative to c.
        stands: (nodes,) which nodes stand.
        stayed: (nodes,) which of them have stood since the frame before.
        floor: the floor.
        settings: walk of a foothold with the way that its node slides.
    """
    placed = predicted.placed
    nodes = len(stands)
    carried, _ = legs_n(np.full(nodes, 1 / nodes), placed.node_position_m, UP, stands.astype(np.float64))
    share = np.maximum(carried[stayed], LEAST_SHARE)
    along = placed.state.turn.T @ floor.axes.T  # the axes of the floor, in the body
    slide_m = least_friction_slides_m(body_before_m[stayed] @ along, placed.body_m[stayed] @ along, share)
    walk = np.zeros(nodes)
    walk[stayed] = settings.slide_m_per_m05**2 * slide_m / (len(share) * share)
    at = placed.state.layout
    variance = np.zeros(at.size)
    variance[at.foothold] = np.repeat(walk, 2)
    return predicted.then(placed, np.eye(at.size), variance)


@dataclass(frozen=True, slots=True, eq=False)
class Feet:
    """Some nodes that have stood since the frame before, and what their footholds say."""

    nodes: NDArray[np.int64]
    """(feet,)"""
    rows: Rows
    """Two for each of them, see `factors.ground.foothold_rows`."""

    @classmethod
    def of(cls, predicted: Prediction, nodes: NDArray[np.bool_], floor: Floor, settings: PoseSettings) -> "Feet":
        """Return those of (nodes,) some nodes."""
        here, placed = np.flatnonzero(nodes), predicted.placed
        return cls(here, foothold_rows(placed, floor, here, predicted.turned, settings.floor_m))

    def among(self, nodes: NDArray[np.bool_]) -> "Feet":
        """Return those which are among (nodes,) some nodes."""
        are = nodes[self.nodes]
        if are.all():
            return self
        twice, rows = np.repeat(are, 2), self.rows
        return Feet(self.nodes[are], Rows(rows.error[twice], rows.jacobian[twice], rows.variance[twice]))


def slips(feet: Feet, predicted: Prediction, t_s: float, floor: Floor, slip_sigma: float) -> list[Slip]:
    """Return which of some nodes are not where they stood, and how far they have slipped.

    With the error e of a node's foothold and its covariance S, the way is -e, and a node has slipped if e^T S^-1 e is
    above the square of `slip_sigma`.

    Args:
        feet: these nodes.
        predicted: what is expected of the frame.
        t_s: time of the frame.
        floor: the floor.
        slip_sigma: distance from the foothold, in standard deviations, from which a node has slipped.
    """
    nodes, rows = feet.nodes, feet.rows
    if not len(nodes):
        return []
    e = rows.error.reshape(-1, 2)
    H = rows.jacobian.reshape(len(nodes), 2, -1)
    S = H @ predicted.covariance @ np.swapaxes(H, 1, 2) + rows.variance.reshape(-1, 2)[:, :, None] * np.eye(2)
    squared = squared_distance(e, S)
    return [
        Slip(t_s, int(nodes[k]), -e[k] @ floor.axes, float(np.sqrt(e[k] @ S[k] @ e[k] / max(e[k] @ e[k], 1e-300))))
        for k in np.flatnonzero(squared > slip_sigma**2)
    ]


def turned_sigma(feet: Feet, predicted: Prediction, floor: Floor) -> float:
    """Return how far some nodes have turned together about the floor's normal, in standard deviations.

    With the errors e of all their footholds and the covariance S of e, their places a along the floor about the mean of
    them, and a turned by a right angle, b, the angle is

        psi = b . e / b . b,     sigma^2 = b^T S b / (b . b)^2

    A robot that turns on its feet slides with all of them but one at most. Its place tells less: where it moves at a
    constant velocity, inertial sensors do not feel it.

    Args:
        feet: these nodes.
        predicted: what is expected of the frame.
        floor: the floor.
    """
    nodes, rows = feet.nodes, feet.rows
    if len(nodes) < 2:
        return 0.0
    a = predicted.placed.node_position_m[nodes] @ floor.axes.T
    a = a - a.mean(axis=0)
    b = np.stack([-a[:, 1], a[:, 0]], axis=1).ravel()
    by_state = b @ rows.jacobian
    variance = by_state @ predicted.covariance @ by_state + b**2 @ rows.variance
    return float(abs(b @ rows.error) / np.sqrt(variance))


def put_down(predicted: Prediction, nodes: NDArray[np.bool_], floor: Floor, floor_m: float) -> Prediction:
    """Return the prediction with new footholds where nodes begin to stand.

    Args:
        predicted: before.
        nodes: (nodes,) which of them begin to stand.
        floor: the floor.
        floor_m: standard deviation of a foothold.
    """
    if not nodes.any():
        return predicted
    placed = predicted.placed
    at = placed.state.layout
    axes = floor.axes
    F = np.eye(at.size)
    variance = np.zeros(at.size)
    for node in np.flatnonzero(nodes):
        place = at.of_foothold(int(node))
        F[place] = axes @ placed.jacobian[node]
        of_shape = np.einsum("ai,ij,aj->a", axes, placed.node_covariance_m2[node], axes)
        variance[place] = of_shape + floor_m**2
    foothold_m = np.where(nodes[:, None], placed.node_position_m @ axes.T, placed.state.foothold_m)
    state = replace(placed.state, foothold_m=foothold_m)
    return predicted.then(placed.at(state), F, variance)
