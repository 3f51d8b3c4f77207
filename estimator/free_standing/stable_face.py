"""On which face of its hull a structure rests, by its shape alone.

Where neither a sensor nor the balance of forces tells how a structure is turned, it is taken to move slowly, and nobody
to hold it: it rests on a face above which its centre of mass is. Rods of equal mass have it at the centroid c of the
nodes. On a face with the upward normal u, c is inside an edge from p to q, with the third corner r, by

    m = v . (c - p),     v = +- u x (q - p) / |q - p|,     v . (r - p) > 0

Where the structure deforms so far that m is negative, it tips over the edge, onto the face beyond it. Where a further
node comes down to the floor, a face of the new hull takes over.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.special import ndtr

from ...models.structure.floor import Floor
from ...models.structure.shape import Shape
from .contacts import Standing

CENTRE_M = 0.01
"""Standard deviation of the centre of mass about the centroid of the nodes: batteries and motors."""
MAY_TIP = 0.003
"""Probability of having tipped over an edge above which the face beyond it is counted in the uncertainty."""


class StableFace:
    """Follows the face on which a structure rests, frame by frame."""

    def __init__(self, floor: Floor) -> None:
        self._up = floor.normal  # the axes of the body are those of the world at rest

    def turned_to(self, up: NDArray[np.float64]) -> None:
        """Take it as known how the structure is turned in one more frame: (3,) the floor's normal, in body axes."""
        self._up = up

    def observe(self, shape: Shape) -> Standing:
        """Return which nodes stand in one more frame.

        Args:
            shape: in body coordinates.
        """
        x = shape.node_position_m
        hull = ConvexHull(x, qhull_options="QJ")  # joggled: every face is a triangle, of a flat structure too
        up = -hull.equations[:, :3]
        here = int(np.argmax(up @ self._up))  # the face before, or that of a node which has come down
        margin_m, beyond = _edges(x, hull, here, up[here])
        for _ in range(len(up)):
            if margin_m.min() >= 0:
                break
            here = int(beyond[np.argmin(margin_m)])
            margin_m, beyond = _edges(x, hull, here, up[here])
        self._up = up[here]
        sigma_m = float(np.sqrt(CENTRE_M**2 + np.trace(shape.covariance_m2) / x.size))
        over = ndtr(-margin_m / sigma_m)
        carried = np.array([np.isin(np.arange(len(x)), hull.simplices[face]) for face in (here, *beyond)])
        share = np.array([max(1 - over.sum(), 0.0), *over])
        others = tuple((float(p), nodes) for p, nodes in zip(over, carried[1:], strict=True) if p > MAY_TIP)
        return Standing(carried[0], np.asarray(share @ carried / share.sum()), others, assumed=True)


def _edges(
    x: NDArray[np.float64], hull: ConvexHull, here: int, up: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return (3,) the margin of the centroid inside each edge of a face, and (3,) the face beyond each edge."""
    corner_m = x[hull.simplices[here]]
    p, q = corner_m[[1, 2, 0]], corner_m[[2, 0, 1]]  # the edge across from each corner
    inward = np.cross(up, q - p)
    inward *= np.sign(np.sum(inward * (corner_m - p), axis=1, keepdims=True))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return np.sum(inward * (x.mean(axis=0) - p), axis=1), hull.neighbors[here]
