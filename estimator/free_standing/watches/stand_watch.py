"""Whether a robot stands as the floor can carry it: on a face of its hull.

Where heights tell which nodes stand, the faces tell whether these can carry the robot. Inertial sensors feel when it is
still. It then stands on a face. With the heights h_k of the three nodes of a face, their differences
e = (h_1 - h_0, h_2 - h_0), and the covariance S of e by attitude and shape, it may stand there if

    e^T S^-1 e < CONTRADICTS_SIGMA^2

Where it may stand on no face, it is held or leans, the floor is not the plane that is told, or the attitude is wrong.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ....factors.ground import clearance_covariance_m2
from ....models.pose.imu_agreement import CONTRADICTS_SIGMA
from ....models.pose.imu_samples import ImuSamples
from ....models.pose.placed import PlacedShape
from ....models.structure.floor import Floor
from ....models.values.chi_squared import squared_distance
from ..contacts import Standing
from ..imu_trust import is_still

SETTLES_S = 0.3
"""Time without motion after which a robot that nobody holds is at rest on a face."""
PUT_DOWN_S = 2.0
"""The same after it was lifted: a hand may hold it still for a while."""
STAND_LOOK_EVERY_S = 0.2
"""Shortest time between two looks at the faces of the hull."""
NEAREST = 3
"""Number of faces that are looked at, those that are nearest to level."""
HELD_SHARE = 0.5
"""Probability of the nearest face where the robot may stand on none: a hand holds it, or the attitude is wrong."""
FROM_FIRST = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
"""Of the heights of three nodes, those of the other two above the first."""


class StandWatch:
    """Follows whether the robot stands as the floor can carry it, frame by frame."""

    def __init__(self) -> None:
        self._still_s = 0.0
        self._looked_s = -np.inf
        self._settles_s = SETTLES_S
        self._nearest: NDArray[np.bool_] | None = None

    def observe(
        self,
        t_s: float,
        step_s: float,
        placed: PlacedShape,
        covariance: NDArray[np.float64],
        floor: Floor,
        samples: ImuSamples,
        standing: Standing,
        *,
        flies: bool,
    ) -> Standing:
        """Return which nodes stand, with the face on which the robot has to stand instead where they cannot carry it.

        Args:
            t_s: time of the frame.
            step_s: time since the frame before.
            placed: the shape in the world.
            covariance: (size, size) of the errors of its state.
            floor: the floor as told.
            samples: of the inertial sensors that are used; one at least.
            standing: which nodes stand, as heights or forces tell.
            flies: whether it bounces, or falls; where no node stands otherwise, a hand lifts it.
        """
        self._still_s = self._still_s + step_s if is_still(samples) else 0.0
        if not standing.nodes.any() and not flies:
            self._settles_s, self._nearest = PUT_DOWN_S, standing.nodes
        elif self._still_s > self._settles_s and t_s - self._looked_s > STAND_LOOK_EVERY_S:
            self._looked_s, self._settles_s = t_s, SETTLES_S
            face, squared = nearest_face(placed, covariance, floor)
            self._nearest = face if squared > CONTRADICTS_SIGMA**2 else None
        if self._nearest is None:
            return standing
        others = ((HELD_SHARE, self._nearest),) if self._nearest.any() else ()
        return replace(standing, others=(*standing.others, *others), contradicted=True)


def nearest_face(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> tuple[NDArray[np.bool_], float]:
    """Return (nodes,) those of the face that is level most likely, and e^T S^-1 e of it.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor as told.
    """
    x = placed.node_position_m
    tilted = floor.tilted(placed.state.floor_tilt)
    hull = ConvexHull(x, qhull_options="QJ")
    up = -hull.equations[:, :3]
    total = clearance_covariance_m2(placed, covariance, floor)
    clearance_m = tilted.clearance_m(x)
    best, least = np.zeros(len(x), dtype=np.bool_), np.inf
    for face in np.argsort(-up @ tilted.normal)[:NEAREST].tolist():
        nodes = hull.simplices[face]
        e = FROM_FIRST @ clearance_m[nodes]
        S = FROM_FIRST @ total[np.ix_(nodes, nodes)] @ FROM_FIRST.T
        squared = float(squared_distance(e, S))
        if squared < least:
            best, least = np.isin(np.arange(len(x)), nodes), squared
    return best, least
