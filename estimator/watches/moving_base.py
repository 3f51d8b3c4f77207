"""Whether the base of an anchored structure moves although its anchors are told to stand still.

Lengths do not see where a structure is. An inertial sensor on a rod does: its attitude follows its rate from the rest
on, Q <- Q exp((w - b) dt), with the bias b of the seconds at rest, and gives the direction Q a of its rod. When this
and the direction in the estimated shape part by more than sensors and deformation explain, for most of the sensors,
the base has turned. Sensors on rods that stand upright at rest tell nothing, as gravity does not tell how they are
turned about their rods, nor do those that were not read at rest, whose bias is unknown. A base that slides without
turning is not seen, nor what it does while the sensors are silent.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...factors.imu import ImuArray
from ...models.pose.imu_samples import ImuPreintegration, ImuSamples
from ...models.structure.floor import UP
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.aids import READING_HOLDS_S, Imu, ImuReading
from ...models.values.rotations import rotation
from ...models.values.stamps import RestClock

APART_RAD = 0.03
"""Standard deviation of the angle between both directions: misalignment, and errors of the shape."""
DRIFT_RAD_PER_S = 2e-4
"""Growth of this standard deviation with time: what is left of the bias."""
APART_SIGMA = 4.0
"""Angle in standard deviations beyond which the base has turned."""


class MovingBase:
    """Compares the rods of one shape after another with what inertial sensors say of them."""

    def __init__(self, rest: RestShape, imus: Sequence[Imu], rest_seconds: float) -> None:
        self._imus = ImuArray(imus, rest.structure.rods)
        self._is_told = self._imus.is_inclined(rest.node_position_m)
        self._size_m = float(rest.structure.rod_length_m.mean())
        self._free = rest.structure.free_coordinates
        self._rest_clock = RestClock(rest_seconds)
        self._at_rest: list[ImuReading] = []
        self._turn: NDArray[np.float64] | None = None
        self._bias = np.zeros((len(imus), 3))
        self._latest_s = np.full(len(imus), np.nan)
        self._start_s = np.nan
        self._has_turned = False

    def observe(self, shape: Shape) -> Shape:
        """Return a shape of one more frame, with doubt and a wide covariance if the base has turned."""
        readings = [reading for reading in shape.lengths.aids if isinstance(reading, ImuReading)]
        if self._turn is None:
            self._at_rest += readings
            self._start(shape)
            return shape
        started_anew = set() if self._has_turned else self._start_anew(readings, shape)
        for reading in readings:
            step_s = reading.t_s - self._latest_s[reading.imu]
            if reading.imu in started_anew or np.isnan(step_s):
                continue
            rate = reading.rate_rad_per_s - self._bias[reading.imu]
            self._turn[reading.imu] = self._turn[reading.imu] @ rotation(rate * step_s)
            self._latest_s[reading.imu] = reading.t_s
        heard = self._is_told & (shape.t_s - self._latest_s < READING_HOLDS_S)
        if heard.any():
            sigma = np.hypot(APART_RAD, DRIFT_RAD_PER_S * (shape.t_s - self._start_s))
            self._has_turned = bool(np.median(self._angle(self._turn, shape)[heard]) >= APART_SIGMA * sigma)
        if not self._has_turned:
            return shape
        return shape.widened(self._free, self._size_m**2 * np.eye(len(self._free))).in_doubt(Reason.BASE)

    def _start_anew(self, readings: list[ImuReading], shape: Shape) -> set[int]:
        """Take the attitude of sensors that were silent from a shape; return their numbers.

        How they turned meanwhile is not known.
        """
        assert self._turn is not None
        silent = {one.imu for one in readings if not one.t_s - self._latest_s[one.imu] < READING_HOLDS_S}
        if silent:
            attitude = self._attitude(ImuPreintegration(self._imus.count).mean(shape.t_s, readings), shape)
            for reading in readings:
                if reading.imu in silent:
                    self._turn[reading.imu] = attitude[reading.imu]
                    self._latest_s[reading.imu] = reading.t_s
        return silent

    def _start(self, shape: Shape) -> None:
        """Find biases and attitudes at the end of the rest."""
        self._rest_clock.count_frame(shape.t_s)
        if self._rest_clock.is_at_rest(shape.t_s):
            return
        self._start_s = shape.t_s
        samples = ImuPreintegration(self._imus.count).mean(shape.t_s, self._at_rest)
        self._is_told = self._is_told & (samples.count > 0)
        self._bias = samples.rate_rad_per_s
        self._turn = self._attitude(samples, shape)
        for reading in self._at_rest:
            self._latest_s[reading.imu] = reading.t_s
        self._at_rest = []

    def _attitude(self, samples: ImuSamples, shape: Shape) -> NDArray[np.float64]:
        """Return (imus, 3, 3) how the sensors that were read are turned, from their specific force and a shape."""
        force = np.where(samples.count[:, None] > 0, samples.specific_force_m_per_s2, UP)
        return self._imus.attitude_at_rest(self._imus.rod_direction(shape.node_position_m), force)

    def _angle(self, turn: NDArray[np.float64], shape: Shape) -> NDArray[np.float64]:
        """Return (imus,) the angles between the directions of the rods by the sensors and in a shape."""
        by_sensor = np.einsum("iab,ib->ia", turn, self._imus.axis)
        by_shape = self._imus.rod_direction(shape.node_position_m)
        return np.asarray(np.arccos(np.clip(np.sum(by_sensor * by_shape, axis=1), -1, 1)))
