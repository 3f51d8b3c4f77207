"""Whether feet that should stand slide: a second estimate of the pose, which they do not hold.

A slow slide of all feet moves the robot by less in one frame than the shape is wrong by, and footholds would hold it
back for ever. Inertial sensors feel it: beside the filter runs a copy without footholds, for up to `WATCH_S`. With its
error e of a foothold and the covariance S of it, the node slides if e^T S^-1 e is too large. The filter then takes the
copy over, and the node has no foothold until it is slow: with the velocity v, of covariance S_v,

    v^T v < s^2 + tr S_v
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.pose.placed import PlacedShape
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import Floor
from ...models.values.rotations import cross, cross_matrix

WATCH_S = 0.3
"""Time after which the copy starts again: over a longer one, inertial sensors do not tell a slide of millimetres."""
LOST_M = 0.005
"""Standard deviation, per axis, of what a robot has slid before the copy started: by less than is found."""
WITH_IT_SIGMA = 2.0
"""Distance from its foothold, in standard deviations, from which a node slides too when another one does."""
REST_M_PER_S = 0.05
"""Speed s below which a foot that slid stands again: friction stops it within a frame or two."""


@dataclass(frozen=True, slots=True, eq=False)
class UnheldPose:
    """The estimate of the pose without footholds."""

    since_s: float
    """When it was that of the filter."""
    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size) of its errors."""
    turn_before: NDArray[np.float64]
    """(3, 3) the turn in the frame before."""


def at_rest(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> NDArray[np.bool_]:
    """Return (nodes,) which nodes may be at rest along the floor, by the velocity of the body.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor.
    """
    state, at = placed.state, placed.state.layout
    v = (state.velocity_m_per_s + cross(state.rate_rad_per_s, placed.arm_m)) @ floor.axes.T
    jacobian = np.zeros((len(v), 2, at.size))
    jacobian[:, :, at.velocity] = floor.axes
    jacobian[:, :, at.rate] = -floor.axes @ cross_matrix(placed.arm_m)
    variance = np.einsum("kai,ij,kaj->k", jacobian, covariance, jacobian)
    return np.asarray(np.sum(v**2, axis=1) < REST_M_PER_S**2 + variance)


def slid_before(since_s: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames, nodes) which nodes slide in each frame, given the slides that later frames have found.

    Args:
        since_s: (frames, nodes) since when a node slides, see `PoseStep.slides_since_s`.
        t_s: (frames,) time of each frame.
    """
    slides = np.zeros(since_s.shape, dtype=np.bool_)
    for k, node in np.argwhere(np.isfinite(since_s)):
        slides[np.searchsorted(t_s, since_s[k, node], side="right") : k + 1, node] = True
    return slides
