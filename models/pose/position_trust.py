"""Which positions to trust: those that agree with the robot at rest, keep its scale, and do not jump while it is seen.

At rest the nodes are at x, as `[rest] node_position_m` says. There a position y of the world contradicts it where

    (y - x)^T S^-1 (y - x) > MOST_SIGMA^2,     S = C + (STANDS_M^2 + sigma^2) 1

with the covariance C of x; and so do positions of several nodes of which no two have their distance. A node of which
most positions at rest contradict is not where it is told to be, and a recording of which most nodes do so is told in
another frame, unit or order of axes. Neither is used afterwards. A node that is told to be in two places at one instant
is taken to be in neither.

The mean of many positions at rest is more exact than one of them. With the means e_a of y - x at the n nodes of a
recording and their mean e, its frame, or the robot, is elsewhere than told, and the pose is doubted, where

    e^T S^-1 e > SHIFTED_SIGMA^2,     S = sum C_ab / n^2 + sigma^2 1

because what a capture errs alike at all nodes is no larger than sigma. So it is where one of them is,

    e_a^T S_a^-1 e_a > SHIFTED_SIGMA^2,     S_a = C_aa + sigma^2 1

as one whose marker is on a stalk.

Later the pose may be wrong, and distances are compared: between nodes, and of a robot that hangs to its anchors
(`position_gate`). The scale s of an instant minimises

    sum (|y_a - y_b| - s |x_a - x_b|)^2

over the pairs of nodes that agree, and a recording whose scale has a mean that is not 1 is left out.
"""

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from ..structure.rest_shape import RestShape
from ..structure.shape import pair_blocks
from ..values.aids import PositionReading
from ..values.chi_squared import squared_distance
from ..values.time_series import low_pass_weight
from .placed import PlacedShape
from .position_gate import are_shifted, believed, believed_at_rest

LEAST_AT_REST = 5
"""Number of positions of a node at rest from which they tell that it is not where it is told to be."""
SHIFTED_SIGMA = 4.0
"""Mean difference of the positions at rest from the rest shape, in standard deviations, from which they are doubted."""
MOST_STRETCHED = 0.03
"""Difference of a recording's scale from 1 above which it is wrong: rods keep their lengths."""
SCALE_MEMORY_S = 1.0
"""Time constant of the mean scale: a shape lags behind a tip for shorter than this."""
RECENT_S = 1.0
"""Time over which positions that are left out are compared with all."""


@dataclass(slots=True)
class _AtRest:
    """What the positions of one node at rest tell."""

    read: int = 0
    agreeing: int = 0
    sum_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """(3,) of the differences of those that agree from the rest shape."""

    def observe(self, apart_m: NDArray[np.float64], *, agrees: bool) -> None:
        """Count one more position, (3,) apart from the rest shape."""
        self.read += 1
        self.agreeing += agrees
        self.sum_m += apart_m * agrees

    @property
    def is_misplaced(self) -> bool:
        """Whether most of them contradict the rest shape."""
        return self.read >= LEAST_AT_REST and 2 * self.agreeing < self.read


@dataclass(slots=True)
class _Capture:
    """What is known of one recording."""

    seen_s: float
    """When positions of two nodes were believed last; the end of the rest before that."""
    is_astray: bool
    """Whether its nodes are not where the pose expects them: they jumped in sight, or were not seen at rest."""
    scale: float = 1.0

    def observe(self, t_s: float, readings: Sequence[PositionReading], node_position_m: NDArray[np.float64]) -> None:
        """Learn the scale from the believed positions of two nodes or more at one instant.

        Args:
            t_s: time of the instant.
            readings: the positions.
            node_position_m: (nodes, 3) the shape.
        """
        y = np.array([reading.position_m for reading in readings])
        x = node_position_m[[reading.node for reading in readings]]
        pairs = np.triu_indices(len(x), 1)
        read_m, shape_m = (np.linalg.norm(nodes[:, None] - nodes, axis=2)[pairs] for nodes in (y, x))
        if not shape_m.any():  # positions of one node alone
            return
        step_s = float(np.clip(t_s - self.seen_s, 0.0, SCALE_MEMORY_S))
        self.scale += float(low_pass_weight(step_s, SCALE_MEMORY_S)) * (
            read_m @ shape_m / (shape_m @ shape_m) - self.scale
        )
        self.seen_s = t_s


class PositionTrust:
    """Follows which positions to trust, frame by frame."""

    def __init__(self, rest: RestShape, rest_until_s: float, sigma_m: float) -> None:
        """Prepare for a robot that stands at its rest shape at the start.

        Args:
            rest: the rest shape, in the world.
            rest_until_s: until when it stands there, on the clock of the frames.
            sigma_m: standard deviation of a position, per axis.
        """
        self._rest = rest
        self._rest_until_s = rest_until_s
        self._sigma_m = sigma_m
        self._at_rest: dict[int, dict[int, _AtRest]] = defaultdict(lambda: defaultdict(_AtRest))
        self._recordings: dict[int, _Capture] = {}
        self._recent: deque[tuple[float, bool]] = deque()
        self._is_shifted = False

    @property
    def is_doubted(self) -> bool:
        """Whether half of the positions of the last second, or more, were left out, or all were shifted at rest."""
        left_out = sum(not used for _, used in self._recent)
        return self._is_shifted or (bool(self._recent) and 2 * left_out >= len(self._recent))

    def trusted(
        self,
        t_s: float,
        positions: Sequence[PositionReading],
        expected: PlacedShape,
        covariance: NDArray[np.float64],
        step_s: float,
    ) -> list[PositionReading]:
        """Return the positions of a frame that are to be used.

        Args:
            t_s: time of the frame.
            positions: since the frame before, in order of time.
            expected: the shape where the pose of the frame before expects it.
            covariance: (size, size) of the errors of that pose.
            step_s: time since the frame before.
        """
        found: list[PositionReading] = []
        total_m2 = expected.total_covariance_m2(covariance) if positions else covariance
        for _, instant in groupby(positions, key=lambda reading: (reading.t_s, reading.recording)):
            at_once = list(instant)
            places: dict[int, set[tuple[float, ...]]] = defaultdict(set)
            for reading in at_once:
                places[reading.node].add(tuple(reading.position_m.tolist()))
            told = [reading for reading in at_once if len(places[reading.node]) == 1]
            used = self._of_instant(told, expected, total_m2, step_s) if told else []
            found += [reading for reading, is_used in zip(told, used, strict=True) if is_used]
            self._recent.extend((t_s, is_used) for is_used in [*used, *[False] * (len(at_once) - len(told))])
        while self._recent and t_s - self._recent[0][0] > RECENT_S:
            self._recent.popleft()
        return found

    def _of_instant(
        self, readings: Sequence[PositionReading], expected: PlacedShape, total_m2: NDArray[np.float64], step_s: float
    ) -> list[bool]:
        """Return which positions of one instant and recording are used; arguments as those of `trusted`."""
        number, t_s = readings[0].recording, readings[0].t_s
        if t_s < self._rest_until_s and readings[0].frame is None:
            used = believed_at_rest(readings, self._rest.node_position_m, self._rest.covariance_m2, self._sigma_m)
            for reading, is_used in zip(readings, used, strict=True):
                apart_m = reading.position_m - self._rest.node_position_m[reading.node]
                self._at_rest[number][reading.node].observe(apart_m, agrees=is_used)
            self._is_shifted = any(self._is_shifted_at_rest(seen) for seen in self._at_rest.values())
            return used
        told = [reading for reading in readings if not self._is_misplaced(reading)]
        if not told:
            return [False] * len(readings)
        if number not in self._recordings:
            is_astray = readings[0].frame is None and number not in self._at_rest
            self._recordings[number] = _Capture(self._rest_until_s, is_astray)
        recording = self._recordings[number]
        x, shape_m2 = expected.node_position_m, expected.shape_covariance_m2
        unseen_s = step_s if recording.is_astray else max(t_s - recording.seen_s, step_s)
        group = believed(told, x, total_m2, shape_m2, step_s, unseen_s, self._sigma_m)
        used_now = [reading for reading, passes in zip(told, group.passes, strict=True) if passes]
        if are_shifted(used_now, self._rest.structure, x, shape_m2, self._sigma_m):
            used_now = []
        if group.agreeing > 1:
            recording.is_astray = not used_now
        if len(used_now) > 1:
            recording.observe(t_s, used_now, x)
        nodes = {reading.node for reading in used_now} if abs(recording.scale - 1) < MOST_STRETCHED else set()
        return [reading.node in nodes for reading in readings]

    def _is_shifted_at_rest(self, at_rest: Mapping[int, _AtRest]) -> bool:
        """Return whether the positions of a recording at rest, by node, are shifted alike, or those of one node are."""
        seen = {node: one for node, one in at_rest.items() if one.agreeing >= LEAST_AT_REST}
        if not seen:
            return False
        of_node = np.array([one.sum_m / one.agreeing for one in seen.values()])
        blocks_m2 = pair_blocks(self._rest.covariance_m2)[np.ix_(list(seen), list(seen))]
        e = np.vstack([of_node.mean(axis=0), of_node])
        C = np.concatenate([blocks_m2.mean(axis=(0, 1))[None], np.einsum("aaij->aij", blocks_m2)])
        S = C + self._sigma_m**2 * np.eye(3)
        return bool((squared_distance(e, S) > SHIFTED_SIGMA**2).any())

    def _is_misplaced(self, reading: PositionReading) -> bool:
        """Return whether positions at rest told that this node, or most of its recording, is not where it is told."""
        at_rest = self._at_rest.get(reading.recording, {})
        misplaced = [node for node, seen in at_rest.items() if seen.is_misplaced]
        return reading.node in misplaced or 2 * len(misplaced) > len(at_rest)
