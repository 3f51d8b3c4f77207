"""Whether a load stays that no weight explains: then somebody touched the structure while its sensors were tared.

Taring takes the structure for unloaded. If a hand pressed it meanwhile with F and then let go, all later lengths look
as if -F pulled at that node, and the loads of later hands come on top of it. The loads of each node are averaged over
`MEAN_S`. The newest mean c stays where it is large, more than `NEAR_SHARE` of the means are within 0.3 |c| of it, and
less than `SMALL_SHARE` of them below 0.3 |c|, until more are. Hands do not load a node so evenly. A weight that is hung
up does, and pulls down; what pulls up, or aside, is a hand that pressed during the rest.

The shape is not corrected, as a cord may pull there. If none does, the structure is unloaded where nothing but c seems
to load it, and its mean deformation d then is the error of all shapes: the covariance grows by d d^T.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ...models.structure.floor import UP
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.readings import TendonLengths

MEAN_S = 0.5
"""Time over which loads are averaged."""
MOST_MEANS = 120
"""Number of the latest means that count: one minute."""
LEAST_MEANS = 20
"""Number of means from which they count: 10 s."""
LEAST_LOAD = 0.2
"""Least load that stays, over the standard deviation of that of a finger."""
CLOSE = 0.3
"""Distance from c, over its size, up to which a mean is near it, and size up to which one is small."""
NEAR_SHARE = 0.35
"""In 5 simulated trials that were tared under 0.5 to 1 N the share is up to 0.48 to 0.60. In 20 others it is at most
0.24 with the share of small ones that counts, but for 0.39 where wind blows."""
SMALL_SHARE = 0.25
"""Where one node is pressed again and again, more are small."""
DOWN = 0.7
"""Cosine of the angle from straight down within which a load may be a weight."""


class SteadyLoad:
    """Follows the loads of one frame after another.

    Args:
        rest: the rest shape.
        finger_n: standard deviation of the load of a finger.
    """

    def __init__(self, rest: RestShape, finger_n: float) -> None:
        self._rest = rest
        self._least_n = LEAST_LOAD * finger_n
        self._means: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque(maxlen=MOST_MEANS)
        self._newest: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        self._since_s = np.nan
        self._steady_n = np.zeros(len(rest.structure.free_nodes))  # size of the load that stays; 0 where none does
        self._deformation_m = np.zeros(len(rest.structure.free_coordinates))  # where nothing else loads it

    def observe(self, shape: Shape) -> Shape:
        """Return the shape of one more frame, with doubt and a wider covariance if a load stays."""
        if shape.loads is not None:
            self.learn(shape.lengths, shape.loads.force_n, shape.node_position_m)
        return self.widened(shape)

    def learn(self, lengths: TendonLengths, force_n: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> None:
        """Learn from one more frame.

        Args:
            lengths: of the frame.
            force_n: (nodes, 3) the loads; nan at anchors.
            node_position_m: (nodes, 3) the shape.
        """
        structure = self._rest.structure
        if not lengths.of_strips or not structure.is_held:  # hands, or the floor, load what is not held all the time
            return
        if self._newest and lengths.t_s >= self._since_s + MEAN_S:
            loads_n, deformations_m = zip(*self._newest, strict=True)
            self._means.append((np.mean(loads_n, axis=0), np.mean(deformations_m, axis=0)))
            self._newest = []
            if len(self._means) >= LEAST_MEANS:
                self._judge()
        if not self._newest:
            self._since_s = lengths.t_s
        deformation_m = (node_position_m - self._rest.node_position_m).reshape(-1)[structure.free_coordinates]
        self._newest.append((np.nan_to_num(force_n[structure.free_nodes]), deformation_m))

    def widened(self, shape: Shape) -> Shape:
        """Return a shape, with doubt and a wider covariance if a load stays."""
        if not self._steady_n.any():
            return shape
        free, error_m = self._rest.structure.free_coordinates, self._deformation_m
        return shape.widened(free, np.outer(error_m, error_m)).in_doubt(Reason.REST)

    def _judge(self) -> None:
        """Find out at which nodes a load stays."""
        load_n, deformation_m = (np.array(means) for means in zip(*self._means, strict=True))
        newest_n, size_n = load_n[-1], np.linalg.norm(load_n, axis=-1)
        newest_size_n = size_n[-1]
        near = np.linalg.norm(load_n - newest_n, axis=-1) < CLOSE * newest_size_n
        is_weight = -(newest_n @ UP) > DOWN * newest_size_n
        stays = (newest_size_n > self._least_n) & (near.mean(axis=0) > NEAR_SHARE) & ~is_weight
        self._steady_n = np.where(stays, newest_size_n, self._steady_n)
        self._steady_n[(size_n < CLOSE * self._steady_n).mean(axis=0) >= SMALL_SHARE] = 0.0
        if stays.any():  # between presses, the load that stays is the largest
            at = int(np.argmax(stays * newest_size_n))
            alone = near[:, at] & (size_n.argmax(axis=1) == at)
            if alone.any():
                self._deformation_m = deformation_m[alone].mean(axis=0)
