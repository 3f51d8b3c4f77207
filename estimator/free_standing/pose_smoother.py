"""The smoother of Rauch, Tung and Striebel: the pose in each frame, given the aids of all frames.

Backwards over the steps of `PoseFilter`, with the transition F, the covariance P and the predicted covariance P-,

    G = P F^T (P-)^-1,   d_k <- d_k + G (d_k+1 - d-_k+1),   P_k <- P_k + G (P_k+1 - P-_k+1) G^T

Where a copy of the filter takes over, as when feet begin to slide (`SlideWatch`), P- does not follow from P: it may be
less than F P F^T. The motion noise P- - F P F^T counts without its negative part then, or P_k might become negative.

What later frames add to a pose is within its covariance P. Where it is not, they contradict those before, as after an
error of the sensors that no sigma tells: then one of both is wrong, for as far back as the smoother carries it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.pose.pose_state import PoseState
from ...models.values.chi_squared import squared_distance
from ...models.values.slip import Slip
from .contacts import Standing

CONTRADICTED_SIGMA = 6.0
"""Distance of a smoothed turn or position from the filter's, in its standard deviations, from which they contradict
each other: 3.5 at most in development trials; 60 and more where inertial sensors missed shocks, 20 where their bias
ran away."""
LEAST_POSE_SIGMA = 1e-3
"""Least of these standard deviations, in rad and m."""
ROUNDED_SHARE = 1e-9
"""Share of a variance by which rounding may change it."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStep:
    """One step of the filter, as the smoother needs it."""

    transition: NDArray[np.float64]
    """(size, size) F, from the errors of the step before."""
    predicted: PoseState
    predicted_covariance: NDArray[np.float64]
    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size)"""
    shaken_m2: float
    """Variance of each node's place in the shape, per axis, that shaking adds, see `ShakeWatch`."""
    standing: Standing
    """Which nodes stand."""
    slips: tuple[Slip, ...]
    """Of nodes that stand."""
    slides_since_s: NDArray[np.float64]
    """(nodes,) since when each node that slides has done so at the earliest; inf where it does not."""
    lifted_since_s: float
    """Since when the robot has been in the air, as inertial sensors feel it; inf where it stands."""
    contradicted_imus: NDArray[np.bool_]
    """(imus,) see `ImuTrust.contradicted`."""
    imus_told_wrongly: NDArray[np.bool_]
    """(imus,) see `ImuTrust.told_wrongly`."""
    spun_about: NDArray[np.float64] | None
    """(3,) direction in the world about which the robot may be turned wrongly, as rods with sensors spin while it tips;
    None where it does not tip, or more than sensors on parallel rods tell how it is turned."""
    strays: bool
    """Whether the robot is further from where it was held last than it is long."""
    outlying_ranges: tuple[int, ...]
    """See `Shape.outlying_ranges`."""
    doubts_ranges: bool
    """Whether beacons contradict the rest, or many of them the pose, see `RangeTrust`."""


def smoothed_poses(steps: Sequence[PoseStep]) -> list[tuple[PoseState, NDArray[np.float64]]]:
    """Return state and covariance in each step, given all steps, by the smoother of Rauch, Tung and Striebel."""
    state, covariance = steps[-1].state, steps[-1].covariance
    found = [(state, covariance)]
    for k in range(len(steps) - 2, -1, -1):
        after, now = steps[k + 1], steps[k]
        tiny = 1e-16 * np.eye(len(covariance))
        carried = after.transition @ now.covariance
        predicted = _at_least(carried @ after.transition.T, after.predicted_covariance)
        gain = np.linalg.solve(predicted + tiny, carried).T
        covariance = now.covariance + gain @ (covariance - predicted) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        state = now.state.moved(gain @ after.predicted.errors_to(state))
        found.append((state, covariance))
    return found[::-1]


def _at_least(carried: NDArray[np.float64], predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (size, size) P-, or if some variance of it is less than that of F P F^T, the latter and the rest above it.

    Args:
        carried: (size, size) F P F^T.
        predicted: (size, size) P-.
    """
    if (np.diag(predicted) >= (1 - ROUNDED_SHARE) * np.diag(carried)).all():
        return predicted
    value, vector = np.linalg.eigh(predicted - carried)
    return np.asarray(carried + (vector * np.maximum(value, 0.0)) @ vector.T)


def contradiction(step: PoseStep, state: PoseState) -> NDArray[np.float64] | None:
    """Return the (size,) errors from the filter's state to a smoothed one that contradicts it; None if it does not."""
    errors = step.state.errors_to(state)
    for part in (state.layout.turn, state.layout.position):
        known = step.covariance[part, part] + LEAST_POSE_SIGMA**2 * np.eye(3)
        if squared_distance(errors[part], known) > CONTRADICTED_SIGMA**2:
            return errors
    return None
