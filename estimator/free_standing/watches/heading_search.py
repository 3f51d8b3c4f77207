"""Where a robot heads, and where it is, after it has rolled: a search over all headings by ranges.

A robot that has rolled over several faces unseen heads anywhere. The derivative of a range by the heading holds for
some tenths of a radian, so that a filter which begins with a wrong heading may end with one that is wrong by half a
turn, and take it for known. While the standard deviation of the heading is above `LOST_RAD`, ranges therefore do not
correct the state, but are collected as long as the robot stands on the same nodes. With the median y_k of the n_k
ranges of each pair of beacon and node, its offset o_k of variance P_k, and the nodes turned by an angle a about the
floor's normal through p and moved by d along the floor,

    J(a, d) = |d|^2 / STRAYED_M^2 + sum_k min(r_k^2, OUTLIER_AT^2),     r_k = (y_k - o_k - |x_k(a, d) - b_k|) / s_k
    s_k^2 = (pi / 2) sigma_y^2 / n_k + P_k + FREE_M^2

has some minima J_i at a_i, d_i, of the probabilities exp(-J_i / 2) |C_i|^1/2. C_i is their covariance, with what
somebody before a beacon may add to all of its ranges. Robot, feet and sensors are turned and moved as one to the most
probable minimum, and the errors of heading and place become those of the mixture of all (`headed`).
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ....factors.range import NEAREST_M
from ....models.pose.pose_settings import PoseSettings
from ....models.structure.floor import Floor
from ....models.values.aids import RangeReading
from ....models.values.rotations import cross, rotation
from ....models.values.stamps import is_due
from ..prediction import Frame, Prediction, heading_direction
from ..tipping import ANY_HEADING_RAD
from .range_trust import FREE_M

LOST_RAD = 0.5
"""Standard deviation of the heading above which it is searched for; after a tip over one edge it is 0.2."""
LEAST_S = 0.5
"""Time for which ranges are collected before the first search, and after which it is repeated."""
ANGLES = 16
"""Number of angles from which is searched."""
DESCENTS = 20
"""Number of steps of Gauss and Newton from each, the first half with Huber's kernel."""
OUTLIER_AT = 4.0
"""Error of a pair, in standard deviations, as which a larger one counts."""
FITTING = 5.5
"""Mean of r^2 up to which ranges fit; 4.8 where a quarter are outliers, as while one of four beacons is hidden."""
MOST_OF_PAIR = 20
"""Number of the latest ranges of a pair that count."""
LONGEST_STEP = 0.3
"""Longest step of the angle in rad, and of the place in m."""
STRAYED_M = 1.0
"""How far the robot may be from where it is thought to be, per axis."""
BEFORE_RANGES = np.diag([1 / ANY_HEADING_RAD, 1 / STRAYED_M, 1 / STRAYED_M]) ** 2
"""Information on angle and place without ranges."""
SAME_RAD = 0.5
"""Angle within which minima are one."""


@dataclass(frozen=True, slots=True, eq=False)
class _Ranges:
    """The ranges of some pairs."""

    arm_m: NDArray[np.float64]
    """(pairs, 3) from p to the node of each pair."""
    centre_m: NDArray[np.float64]
    """(3,) p."""
    beacon_m: NDArray[np.float64]
    """(pairs, 3)"""
    range_m: NDArray[np.float64]
    """(pairs,) without offset."""
    sigma_m: NDArray[np.float64]
    """(pairs,)"""

    def minima(self, floor: Floor) -> list[tuple[float, NDArray[np.float64]]]:
        """Return J, and (3,) angle and shift, at each minimum, the least first."""
        x = np.column_stack([np.linspace(-np.pi, np.pi, ANGLES, endpoint=False), np.zeros((ANGLES, 2))])
        for step in range(DESCENTS):
            r, H = self._errors(x, floor)
            share = np.abs(r) / OUTLIER_AT
            is_far = 2 * step < DESCENTS  # from the minimum, so that all seem to be outliers
            weight = 1 / np.sqrt(np.maximum(share, 1.0)) if is_far else np.where(share < 1, 1.0, 0.0)
            r, H = weight * r, weight[..., None] * H
            slope = np.einsum("spi,sp->si", H, r) - x * [0.0, STRAYED_M**-2, STRAYED_M**-2]
            moves = np.linalg.solve(np.swapaxes(H, 1, 2) @ H + BEFORE_RANGES, slope[..., None])[..., 0]
            x = x + np.clip(moves, -LONGEST_STEP, LONGEST_STEP)
        r, _ = self._errors(x, floor)
        J = np.sum(x[:, 1:] ** 2, axis=1) / STRAYED_M**2 + np.sum(np.minimum(r**2, OUTLIER_AT**2), axis=1)
        minima: list[tuple[float, NDArray[np.float64]]] = []
        for k in np.argsort(J):
            if all(abs(_wrapped(x[k, 0] - other[0])) > SAME_RAD for _, other in minima):
                minima.append((float(J[k]), x[k]))
        return minima

    def covariance(
        self, x: NDArray[np.float64], range_covariance_m2: NDArray[np.float64], floor: Floor
    ) -> NDArray[np.float64]:
        """Return the (3, 3) covariance of a minimum, where errors of the ranges have a (pairs, pairs) covariance."""
        r, H = (of_one[0] for of_one in self._errors(x[None], floor))
        H[np.abs(r) >= OUTLIER_AT] = 0.0
        least = np.linalg.inv(H.T @ H + BEFORE_RANGES)
        gain = least @ H.T / self.sigma_m
        return np.asarray(gain @ range_covariance_m2 @ gain.T + least @ BEFORE_RANGES @ least)

    def _errors(self, x: NDArray[np.float64], floor: Floor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (n, pairs) r of (n, 3) angles and shifts, and (n, pairs, 3) minus its derivative."""
        turned_m = self.arm_m @ np.swapaxes(rotation(x[:, :1] * floor.normal), 1, 2)
        away_m = (self.centre_m + x[:, 1:] @ floor.axes)[:, None] + turned_m - self.beacon_m
        distance_m = np.maximum(np.linalg.norm(away_m, axis=-1), NEAREST_M)
        u = away_m / distance_m[..., None]
        by_angle = np.sum(u * cross(floor.normal, turned_m), axis=-1)
        slope = np.concatenate([by_angle[..., None], u @ floor.axes.T], axis=-1)
        return (self.range_m - distance_m) / self.sigma_m, slope / self.sigma_m[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class Headed:
    """Where a robot heads and is, relative to where it was thought to be."""

    angle_rad: float
    shift_m: NDArray[np.float64]
    """(2,) along the axes of the floor."""
    covariance: NDArray[np.float64]
    """(3, 3) of both."""


class HeadingSearch:
    """Collects ranges while the heading is lost, and searches for it."""

    def __init__(self, numbers_of_pair: Mapping[tuple[int, int, int], tuple[int, int]], settings: PoseSettings) -> None:
        self._numbers_of_pair = numbers_of_pair
        self._settings = settings
        self._readings: dict[tuple[int, int, int], deque[RangeReading]] = {}
        self._standing = np.zeros(0, dtype=np.bool_)
        self._searched_s = np.nan

    def observe(self, predicted: Prediction, frame: Frame, standing: NDArray[np.bool_], floor: Floor) -> Headed | None:
        """Take on the ranges of one more frame; return where the robot heads, if that is found.

        Args:
            predicted: what is expected of the frame, of a robot whose heading is lost.
            frame: the frame.
            standing: (nodes,) which nodes stand, some at least.
            floor: the floor as it is estimated.
        """
        if not np.array_equal(standing, self._standing):
            self.restart()
            self._standing = standing
        for reading in frame.ranges:
            self._readings.setdefault(reading.pair, deque(maxlen=MOST_OF_PAIR)).append(reading)
        if np.isnan(self._searched_s):
            self._searched_s = frame.t_s
        if not is_due(frame.t_s - self._searched_s, LEAST_S):
            return None
        self._searched_s = frame.t_s
        return self._found(predicted, floor)

    def restart(self) -> None:
        """Forget all ranges."""
        self._readings = {}
        self._searched_s = np.nan

    def _found(self, predicted: Prediction, floor: Floor) -> Headed | None:
        placed, at = predicted.placed, predicted.placed.state.layout
        readings = list(self._readings.values())
        number, beacon = np.array([self._numbers_of_pair[pair] for pair in self._readings]).T
        offset, error = at.range_offset.start + number, at.beacon_error.start + beacon
        P, rows = predicted.covariance, np.arange(len(readings))
        noise_m2 = 0.5 * np.pi * self._settings.range_m**2 / np.array([len(of_pair) for of_pair in readings])
        median_m = np.array([np.median([reading.range_m for reading in of_pair]) for of_pair in readings])
        ranges = _Ranges(
            arm_m=placed.node_position_m[[of_pair[0].node for of_pair in readings]] - placed.state.position_m,
            centre_m=placed.state.position_m,
            beacon_m=np.array([of_pair[0].beacon_position_m for of_pair in readings]),
            range_m=median_m - placed.state.range_offset_m[number],
            sigma_m=np.sqrt(noise_m2 + P[offset, offset] + FREE_M**2),
        )
        minima = ranges.minima(floor)
        least, best = minima[0]
        if least > FITTING * len(readings):
            return None
        A = np.zeros((len(readings), at.size))
        A[rows, offset] = A[rows, error] = 1.0
        range_covariance_m2 = A @ P @ A.T + np.diag(noise_m2)
        covariances = np.array([ranges.covariance(x, range_covariance_m2, floor) for _, x in minima])
        log_weight = np.array([-0.5 * J for J, _ in minima]) + 0.5 * np.linalg.slogdet(covariances)[1]
        weight = softmax(log_weight)
        away = np.array([[_wrapped(x[0] - best[0]), *(x[1:] - best[1:])] for _, x in minima])
        covariance = np.einsum("i,ijk->jk", weight, covariances + away[:, :, None] * away[:, None])
        return Headed(float(best[0]), best[1:], covariance)


def _wrapped(angle_rad: float) -> float:
    """Return an angle between -pi and pi."""
    return float(np.angle(np.exp(1j * angle_rad)))


def is_lost(predicted: Prediction, floor: Floor) -> bool:
    """Return whether the heading is too uncertain for derivatives by it."""
    at, n = predicted.placed.state.layout, floor.normal
    return float(n @ predicted.covariance[at.turn, at.turn] @ n) > LOST_RAD**2


def headed(predicted: Prediction, found: Headed, floor: Floor) -> Prediction:
    """Return the prediction with robot, feet and sensors turned about the floor's normal, and moved along the floor.

    With the turn T of all vectors, and the directions D of a turn about p and M of moves in the errors d of the state,

        d <- (1 - D n^T - M E^T) T d + D a + M s

    so that errors of heading and place before are replaced by those of the search, a and s.

    Args:
        predicted: before.
        found: where it heads and is.
        floor: the floor as told.
    """
    placed, before = predicted.placed, predicted.placed.state
    at, tilted = before.layout, floor.tilted(before.floor_tilt)
    n, axes = tilted.normal, tilted.axes
    turn, moved_m = rotation(found.angle_rad * n), found.shift_m @ axes
    foothold_m = before.foothold_m @ floor.axes - before.position_m
    state = replace(
        before,
        turn=turn @ before.turn,
        position_m=before.position_m + moved_m,
        rate_rad_per_s=turn @ before.rate_rad_per_s,
        velocity_m_per_s=turn @ before.velocity_m_per_s,
        foothold_m=(before.position_m + foothold_m @ turn.T + moved_m) @ floor.axes.T,
        imu_turn=turn @ before.imu_turn,
    )
    M = np.zeros((at.size, 2))
    M[at.position] = axes.T
    M[at.foothold] = np.tile(floor.axes @ axes.T, (len(before.foothold_m), 1))
    D = heading_direction(state, floor) - M @ axes @ cross(n, state.position_m)
    T = np.eye(at.size)
    for part, by in (
        (slice(0, at.foothold.start), turn),
        (at.imu_turn, turn),
        (at.foothold, floor.axes @ turn @ floor.axes.T),
    ):
        T[part, part] = np.kron(np.eye((part.stop - part.start) // len(by)), by)
    F = T - np.outer(D, n @ T[at.turn]) - M @ axes @ T[at.position]
    by_search = np.column_stack([D, M])
    covariance = F @ predicted.covariance @ F.T + by_search @ found.covariance @ by_search.T
    return Prediction(placed.at(state), F @ predicted.transition, covariance, predicted.turned)
