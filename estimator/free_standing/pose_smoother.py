"""The smoother of Rauch, Tung and Striebel: the pose in each frame, given the aids of all frames.

Backwards over the steps of `PoseFilter`, with the transition F, the covariance P and the predicted covariance P-,

    G = P F^T (P-)^-1,   d_k <- d_k + G (d_k+1 - d-_k+1),   P_k <- P_k + G (P_k+1 - P-_k+1) G^T
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.pose.pose_state import PoseState
from ...models.values.slip import Slip
from .contacts import Standing


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
    strays: bool
    """Whether the robot is further from where it was held last than it is long."""
    outlying_ranges: tuple[int, ...]
    """See `Shape.outlying_ranges`."""
    doubts_ranges: bool
    """Whether beacons contradict the rest, or many of them the pose, see `RangeTrust`."""


def smoothed(steps: Sequence[PoseStep]) -> list[tuple[PoseState, NDArray[np.float64]]]:
    """Return state and covariance in each step, given all steps, by the smoother of Rauch, Tung and Striebel."""
    state, covariance = steps[-1].state, steps[-1].covariance
    found = [(state, covariance)]
    for k in range(len(steps) - 2, -1, -1):
        after, now = steps[k + 1], steps[k]
        tiny = 1e-16 * np.eye(len(covariance))
        gain = np.linalg.solve(after.predicted_covariance + tiny, after.transition @ now.covariance).T
        covariance = now.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        state = now.state.moved(gain @ after.predicted.errors_to(state))
        found.append((state, covariance))
    return found[::-1]
