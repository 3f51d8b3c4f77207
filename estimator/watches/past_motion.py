"""How far a structure may be from its estimate while no length is read: as far as it has been in the trial.

What loads do while nothing is read is not known, but the same hands and motors act on the structure as before. With the
shapes x_k of all n frames in which lengths were read, an estimate x without lengths is, after the time s since the
nearest of these frames, as uncertain as if any of them may be the shape by now:

    (1 - exp(-s / `BUILDS_UP_S`)) 1/n sum (x_k - x) (x_k - x)^T

It is added to the covariance of the shapes that loads of the expected size would make (`estimator.uncertainty`), which
are small where the structure is nearly slack: it collapses under less.
"""

import numpy as np
from numpy.typing import NDArray

from ...models.structure.shape import Shape, Status

BUILDS_UP_S = 0.3
"""Time constant in which a structure goes to another shape: that of a push that builds up."""


class PastMotion:
    """The mean and the covariance of the shapes so far.

    Args:
        free: (free,) the free coordinates.
    """

    def __init__(self, free: NDArray[np.int64]) -> None:
        self._free = free
        self._count = 0
        self._mean_m = np.zeros(len(free))
        self._scatter_m2 = np.zeros((len(free), len(free)))
        self._learned_s = np.nan

    def observe(self, shape: Shape) -> Shape:
        """Return the shape of one more frame, with a larger covariance if no length was read; learn from it if one was.

        Args:
            shape: of the newest frame.
        """
        if shape.status is Status.PRIOR_ONLY:
            return self.widened(shape, shape.t_s - self._learned_s)
        self.learn(shape.node_position_m[None])
        self._learned_s = shape.t_s
        return shape

    def learn(self, node_position_m: NDArray[np.float64]) -> None:
        """Learn from (frames, nodes, 3) shapes with lengths."""
        if not len(node_position_m):
            return
        x_m = node_position_m.reshape(len(node_position_m), -1)[:, self._free]
        mean_m = x_m.mean(axis=0)
        apart_m, count = mean_m - self._mean_m, self._count + len(x_m)
        self._scatter_m2 += (x_m - mean_m).T @ (x_m - mean_m)
        self._scatter_m2 += self._count * len(x_m) / count * np.outer(apart_m, apart_m)
        self._mean_m += len(x_m) / count * apart_m
        self._count = count

    def widened(self, shape: Shape, since_s: float) -> Shape:
        """Return a shape without lengths, with a larger covariance.

        Args:
            shape: of a frame.
            since_s: time to the nearest frame with lengths.
        """
        if not self._count:
            return shape
        apart_m = self._mean_m - shape.node_position_m.reshape(-1)[self._free]
        moment_m2 = self._scatter_m2 / self._count + np.outer(apart_m, apart_m)
        return shape.widened(self._free, -np.expm1(-since_s / BUILDS_UP_S) * moment_m2)
