"""Which nodes the floor carries.

Where inertial sensors tell how the structure is turned, heights tell it: each node is a hidden Markov model of two
regimes. A node that stands is at the height of the lowest one, within the uncertainty of pose and shape; one that does
not is above it by `lifted_m` on average. The lowest node stands, unless positions or ranges tell that it is far above
the floor: then somebody lifts the robot. Nor does it stand while the specific force of the robot is small: then it
bounces, or falls.

Elsewhere the balance of forces tells it, see `estimator.free_standing.resting_faces`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from ...factors.ground import clearance_covariance_m2, clearance_jacobian, velocity_along_floor
from ...models.pose.placed import PlacedShape
from ...models.pose.pose_settings import PoseSettings
from ...models.structure.floor import Floor
from ...models.values.chi_squared import squared_distance

STANDING_SHARE = 0.25
"""Share of the nodes that stand."""
CERTAIN = 1e-3
"""Least probability of standing or not."""
LIFTED_SIGMA = 5.0
"""Height of the lowest node, in standard deviations, above which the whole robot is lifted."""
LANDED_SIGMA = 2.0
"""The same of a robot that was lifted unseen: errors of its height grow until the floor is among the likely ones."""
LIFTED_M = 0.01
"""Least such height."""
EXACT_M = 0.003
"""Standard deviation of a node's height over the lowest one, up to which a frame counts in full. A larger one is due to
the attitude, whose error lasts: frames then count in proportion to the inverse of the variance. Where each counted in
full, after 0.1 s without samples in a tip, three nodes seemed to stand of which one did, and a robot with six sensors
was 136 mm off in place of 16."""
EDGE_LOG_RATIO = 0.7
"""A tip over an edge has to be twice as probable as another face to be told: while hands push a robot that stands, one
over some edge is about as probable as that."""
HYSTERESIS = 0.2
"""A node is put on the floor above, and lifted below, the probability of a half by this difference."""


def is_in_the_air(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> bool:
    """Return whether the lowest node is above the floor, by `LIFTED_SIGMA` and by `LIFTED_M`.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor as told.
    """
    height_m, by_state, of_shape = _lowest(placed, floor)
    sigma_m = float(np.sqrt(by_state @ covariance @ by_state + of_shape))
    return height_m > max(LIFTED_M, LIFTED_SIGMA * sigma_m)


def may_have_landed(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> bool:
    """Return whether the lowest node may be at rest at the floor, and the robot rise or sink no more.

    With its height h above the floor, 0 if it seems to be below, its velocity u, the velocity v of the centroid, and
    both axes E of the floor,

        e^T S^-1 e < LANDED_SIGMA^2     for e = (h, n . v) and for e = E u

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor as told.
    """
    height_m, by_state, of_shape = _lowest(placed, floor)
    state, at = placed.state, placed.state.layout
    tilted = floor.tilted(state.floor_tilt)
    H = np.zeros((2, at.size))
    H[0] = by_state
    H[1, at.velocity] = tilted.normal
    S = H @ covariance @ H.T
    S[0, 0] += of_shape
    e = np.array([max(height_m, 0.0), tilted.normal @ state.velocity_m_per_s])
    if squared_distance(e, S) > LANDED_SIGMA**2:
        return False
    lowest = int(np.argmin(tilted.clearance_m(placed.node_position_m)))
    u, J = (of_nodes[lowest] for of_nodes in velocity_along_floor(placed, tilted.axes))
    return bool(squared_distance(u, J @ covariance @ J.T) < LANDED_SIGMA**2)


def _lowest(placed: PlacedShape, floor: Floor) -> tuple[float, NDArray[np.float64], float]:
    """Return the lowest node's height, (size,) its derivative by the state's errors, and its variance by the shape.

    Args:
        placed: the shape in the world.
        floor: the floor as told.
    """
    tilted = floor.tilted(placed.state.floor_tilt)
    clearance_m = tilted.clearance_m(placed.node_position_m)
    lowest = int(np.argmin(clearance_m))
    of_shape = placed.height_covariance_m2(tilted.normal)[lowest, lowest]
    return float(clearance_m[lowest]), clearance_jacobian(placed, floor)[lowest], float(of_shape)


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Which nodes stand in one frame."""

    nodes: NDArray[np.bool_]
    """(nodes,)"""
    probability: NDArray[np.float64]
    """(nodes,) that the floor carries each node."""
    others: tuple[tuple[float, NDArray[np.bool_]], ...] = ()
    """Other sets of (nodes,) that may stand instead, each with its probability."""
    contradicted: bool = False
    """Whether the balance of forces tells that others stand."""
    assumed: bool = False
    """Whether the shape alone tells it, as if nobody pushed the structure."""

    def probability_of(self, nodes: NDArray[np.bool_]) -> float:
        """Return the probability that these nodes stand, as a face, an edge, or a part of one."""
        alternatives = sum(p for p, other in self.others if not np.any(nodes & ~other))
        return alternatives + (self._unless_others if not np.any(nodes & ~self.nodes) else 0.0)

    def likeliest_other(self, log_ratio: float) -> tuple[float, NDArray[np.bool_]] | None:
        """Return the likeliest other face or edge, unless it is much less probable than what stands.

        Args:
            log_ratio: the log of the probability ratio of what stands to a face, from which that face does not count;
                an edge does not from `EDGE_LOG_RATIO` less.

        Returns:
            The log ratio, and (nodes,) which nodes would stand; None where there is no such face or edge.
        """
        this = np.log(max(self._unless_others, CERTAIN))
        ratios = [(float(this - np.log(p)), nodes) for p, nodes in self.others]
        near = [(r, nodes) for r, nodes in ratios if r < log_ratio - (EDGE_LOG_RATIO if nodes.sum() <= 2 else 0.0)]
        return min(near, key=lambda other: other[0], default=None)

    @property
    def _unless_others(self) -> float:
        """The probability that `nodes` stand, and not one of the other sets."""
        return 1 - sum(p for p, _ in self.others)


def nothing_stands(nodes: int) -> Standing:
    """Return that none of some nodes stands."""
    return Standing(np.zeros(nodes, dtype=np.bool_), np.full(nodes, CERTAIN))


class ContactsByHeight:
    """Follows which nodes stand by their heights, frame by frame."""

    def __init__(self, floor: Floor, standing: NDArray[np.bool_], settings: PoseSettings) -> None:
        self._floor = floor
        self._settings = settings
        self.stand_on(standing)

    def stand_on(self, nodes: NDArray[np.bool_]) -> None:
        """Take it as known which nodes stand."""
        self._standing = nodes
        self._probability = np.clip(nodes.astype(np.float64), CERTAIN, 1 - CERTAIN)

    def observe(
        self,
        placed: PlacedShape,
        covariance: NDArray[np.float64],
        step_s: float,
        *,
        is_located: bool = False,
        is_lifted: bool = False,
        has_come_down: bool = True,
        flies: bool = False,
    ) -> Standing:
        """Return which nodes stand in one more frame.

        Args:
            placed: the shape in the world, as predicted.
            covariance: (size, size) of the errors of its state.
            step_s: time since the frame before.
            is_located: whether positions or ranges tell where the robot is, so that it can be seen to be lifted.
            is_lifted: whether inertial sensors have felt that it was lifted.
            has_come_down: whether they have felt that it came down since then.
            flies: whether they feel that nothing carries it.
        """
        floor = self._floor.tilted(placed.state.floor_tilt)
        clearance_m = floor.clearance_m(placed.node_position_m)
        lowest = int(np.argmin(clearance_m))
        C = clearance_covariance_m2(placed, covariance, self._floor)
        variance = np.diag(C) + C[lowest, lowest] - 2 * C[lowest]
        sigma_m = np.sqrt(variance + self._settings.floor_m**2)
        in_the_air = flies or (is_located and is_in_the_air(placed, covariance, self._floor))
        in_the_air |= is_lifted and not (has_come_down and may_have_landed(placed, covariance, self._floor))
        return self._update(clearance_m - clearance_m[lowest], sigma_m, step_s, in_the_air=in_the_air)

    def _update(
        self, height_m: NDArray[np.float64], sigma_m: NDArray[np.float64], step_s: float, *, in_the_air: bool
    ) -> Standing:
        settings = self._settings
        stay = np.exp(-settings.steps_per_s * step_s)
        before = stay * self._probability + (1 - stay) * STANDING_SHARE
        log_on_floor = -0.5 * (height_m / sigma_m) ** 2 - np.log(np.sqrt(2 * np.pi) * sigma_m)
        log_lifted = -height_m / settings.lifted_m - np.log(settings.lifted_m)
        counts = np.minimum(EXACT_M / sigma_m, 1.0) ** 2
        after = expit(logit(before) + counts * (log_on_floor - log_lifted))
        self._probability = np.clip(after, CERTAIN, 1 - CERTAIN)
        self._standing = self._probability > 0.5 + np.where(self._standing, -HYSTERESIS, HYSTERESIS)
        self._standing[np.argmin(height_m)] = True
        if in_the_air:
            return self.lift()
        return Standing(self._standing, self._probability)

    def lift(self) -> Standing:
        """Take it as known that no node stands, and return that."""
        nothing = nothing_stands(len(self._standing))
        self._standing, self._probability = nothing.nodes, nothing.probability
        return nothing
