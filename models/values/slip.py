"""A slip: a node that the floor carries, and that is not where it stood."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

SAME_SLIDE_S = 0.25
"""Time between two slips of a node below which they are parts of one slide."""
TOLD_SIGMA = 2.0
"""Length of a slide over its standard deviation from which it is told."""


@dataclass(frozen=True, slots=True, eq=False)
class Slip:
    """How far one node has slipped on the floor until some time."""

    t_s: float
    """Of the frame in which it was found."""
    node: int
    way_m: NDArray[np.float64]
    """(3,) in the world, from where it stood to where it stands."""
    sigma_m: float
    """Standard deviation of its length."""

    @property
    def distance_m(self) -> float:
        """The length of the way."""
        return float(np.linalg.norm(self.way_m))


def slides(slips: Sequence[Slip]) -> list[Slip]:
    """Return the slips with those of one slide added up, each with the time of its first; in order of time.

    Left out are those whose sum is less than `TOLD_SIGMA` standard deviations: a foot whose foothold was given up with
    those of others has not slipped.

    Args:
        slips: in order of time. A long slide is found piece by piece.
    """
    found: list[Slip] = []
    latest: dict[int, tuple[int, float]] = {}  # of each node, the place of its last slide and when it last slipped
    for slip in slips:
        place, latest_s = latest.get(slip.node, (0, -np.inf))
        if slip.t_s - latest_s < SAME_SLIDE_S:
            begun = found[place]
            found[place] = replace(
                begun, way_m=begun.way_m + slip.way_m, sigma_m=float(np.hypot(begun.sigma_m, slip.sigma_m))
            )
        else:
            place = len(found)
            found.append(slip)
        latest[slip.node] = place, slip.t_s
    return [slide for slide in found if slide.distance_m > TOLD_SIGMA * slide.sigma_m]
