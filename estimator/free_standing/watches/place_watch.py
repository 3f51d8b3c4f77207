"""Whether the robot is further from where a foot or a reading held it last than it is long.

Friction stops a slide long before. A pose that strays has been moved by sensors that are wrong.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....models.values.aids import READING_HOLDS_S
from ....models.values.slip import Slip
from ..prediction import Frame


class PlaceWatch:
    """Follows where the robot was held, frame by frame."""

    def __init__(self, position_m: NDArray[np.float64], size_m: float, rest_until_s: float) -> None:
        """Begin at rest.

        Args:
            position_m: (3,) where the robot is.
            size_m: its length.
            rest_until_s: time until which it rests there.
        """
        self._held_m = position_m
        self._size_m = size_m
        self._rest_until_s = rest_until_s
        self._located_s = -np.inf

    def observe(self, frame: Frame) -> None:
        """Take note of a frame in which a position or a range is read."""
        if frame.positions or frame.ranges:
            self._located_s = frame.t_s

    def is_located(self, t_s: float) -> bool:
        """Return whether a position or a range tells where the robot is."""
        return t_s - self._located_s < READING_HOLDS_S

    def strays(self, t_s: float, position_m: NDArray[np.float64], found: Sequence[Slip], *, is_held: bool) -> bool:
        """Return whether the robot is, or a foot has slipped, further from where it was held than it is long.

        Args:
            t_s: time of the frame.
            position_m: (3,) where the robot is.
            found: its slips in this frame.
            is_held: whether a foot stands that does not slide.
        """
        is_located = self.is_located(t_s) or t_s < self._rest_until_s
        if is_located or is_held:
            self._held_m = position_m
        way_m = [float(np.linalg.norm(position_m - self._held_m)), *(slip.distance_m for slip in found)]
        return max(way_m) > self._size_m and not is_located
