"""Whether an inertial sensor agrees with gravity and with itself; its own samples tell, without any pose.

While a sensor is quiet its specific force f is against gravity, and has its size: |f| = g to within some per cent. From
a quiet moment on, with the direction u = f / |f| against gravity then, and the bias b of the rates w at rest,

    R <- R exp((w - b) dt),   v <- v + (R f - g u) dt

is its turn, and its velocity, which stays that of a robot. In the next quiet moment R f / |f| = u again. Another unit
or scale of the force contradicts the first; another sign, unit, scale, handedness or order of the axes of either
contradicts the others, unless it turns about the vertical alone. So does a mean rate at rest that is no bias, as where
it counts degrees.

A bias that changes turns R slowly. It is told by the same turn since the sensor has been quiet without a break, which
no shock disturbs: after t seconds, from 4 (2 (b_f / g)^2 / t^2 + b_w^2)^(1/2) on. A quiet sensor may begin to turn, and
f is a mean, which lags; there R^T u is a mean of the same memory.
"""

import numpy as np
from numpy.typing import NDArray

from ..structure.floor import GRAVITY_M_PER_S2
from ..values.rotations import rotation
from ..values.time_series import low_pass_weight
from .pose_settings import PoseSettings

MOST_SCALE = 0.1
"""Error of the size of gravity beyond which the force is not told in m/s^2: small sensors are wrong by 3 %, and by
80 mg of offset."""
LEAST_M_PER_S2 = 1e-6
"""Size of a force that has a direction; a sensor that has failed may read exactly zero."""
STEADY_M_PER_S2 = 0.5
"""Change of the specific force from its mean below which a sensor is steady."""
QUIET_S = 0.5
"""Time of steady force after which a sensor is quiet, and the memory of the mean."""
LEAST_APART_RAD = 0.25
"""Angle between both directions of gravity that is no contradiction yet: shocks, and rates beyond the range."""
PROVEN_RAD = 0.5
"""Turn of gravity from one quiet moment to the next, after which a sensor that agrees is told right: a tip."""
MOST_BIAS = 50.0
"""Mean rate at rest, over the standard deviation of a bias, above which it is none: with 0.4 rad/s, 40 times as much, a
robot is followed about as well as without."""
LEAST_RESTED = 10
"""Number of frames at rest from which on their mean rate is judged."""
CONTRADICTS_SIGMA = 4.0
"""Difference in standard deviations beyond which a sensor contradicts itself."""


def has_size_of_gravity(size_m_per_s2: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the specific forces of quiet sensors, of any shape, are gravity in m/s^2 by their sizes."""
    return np.asarray(np.abs(size_m_per_s2 - GRAVITY_M_PER_S2) < MOST_SCALE * GRAVITY_M_PER_S2)


class _TurnSince:
    """How sensors have turned since a quiet moment of each, and the direction against gravity then."""

    def __init__(self, imus: int, settings: PoseSettings) -> None:
        self._settings = settings
        self.up = np.full((imus, 3), np.nan)
        """(imus, 3) u, in the axes of then; nan before the first such moment."""
        self.turn = np.tile(np.eye(3), (imus, 1, 1))
        """(imus, 3, 3) R"""
        self.turned_rad = np.zeros(imus)
        """(imus,) s, the angles by which it has turned, added up."""
        self.lasted_s = np.zeros(imus)
        """(imus,) t"""

    def start(self, imus: NDArray[np.bool_], up: NDArray[np.float64]) -> None:
        """Start (imus,) some sensors anew, with (imus, 3) directions against gravity."""
        self.up[imus] = up[imus]
        self.turn[imus] = np.eye(3)
        self.turned_rad[imus] = self.lasted_s[imus] = 0.0

    def move(self, angle_rad: NDArray[np.float64], step_s: float) -> None:
        """Turn the sensors by (imus, 3) angles in their axes."""
        self.turn = self.turn @ rotation(angle_rad)
        self.turned_rad += np.linalg.norm(angle_rad, axis=1)
        self.lasted_s += step_s

    @property
    def expected_up(self) -> NDArray[np.float64]:
        """(imus, 3) R^T u, the direction against gravity in the axes of now."""
        return np.asarray(np.einsum("iab,ia->ib", self.turn, self.up))

    @property
    def gravity_has_turned(self) -> NDArray[np.bool_]:
        """(imus,) whether the direction against gravity has turned by more than `PROVEN_RAD`."""
        return np.asarray(np.einsum("ia,ia->i", self.expected_up, self.up) < np.cos(PROVEN_RAD))

    def is_apart(
        self, expected_up: NDArray[np.float64], up: NDArray[np.float64], least_rad: float
    ) -> NDArray[np.bool_]:
        """Return (imus,) which directions against gravity, (imus, 3), are not those that are expected.

        sigma^2 = 2 (b_f / g)^2 + (b_w t)^2 + (s phi)^2
        """
        s = self._settings
        cosine = np.einsum("ia,ia->i", expected_up, up) / np.linalg.norm(expected_up, axis=1)
        by_rates = (s.rate_bias_rad_per_s * self.lasted_s) ** 2 + (s.rate_scale * self.turned_rad) ** 2
        variance = 2 * (s.force_bias_m_per_s2 / GRAVITY_M_PER_S2) ** 2 + by_rates
        limit_rad = np.maximum(CONTRADICTS_SIGMA * np.sqrt(variance), least_rad)
        return np.asarray(np.arccos(np.clip(cosine, -1, 1)) > limit_rad)


class ImuAgreement:
    """Follows the agreement of each sensor, frame by frame."""

    def __init__(self, imus: int, rest_until_s: float, settings: PoseSettings) -> None:
        self.has_size = np.ones(imus, dtype=np.bool_)
        """(imus,) whether the specific force had the size of gravity when it was quiet last."""
        self.moves_as_told = np.ones(imus, dtype=np.bool_)
        """(imus,) whether gravity has always turned as the rates say, the velocity been that of a robot, and the mean
        rate at rest a bias."""
        self.is_proven = np.zeros(imus, dtype=np.bool_)
        """(imus,) whether it has done so in a tip, from one quiet moment to the next."""
        self._rest_until_s = rest_until_s
        self._settings = settings
        self._last_s = np.nan
        self._rested = np.zeros(imus, dtype=np.int64)
        self._bias = np.zeros((imus, 3))
        self._force = np.full((imus, 3), np.nan)
        self._steady_s = np.zeros(imus)
        self._since_quiet = _TurnSince(imus, settings)
        self._while_quiet = _TurnSince(imus, settings)
        self._expected_up = np.full((imus, 3), np.nan)
        self._velocity = np.zeros((imus, 3))
        self._shock = np.zeros(imus)

    def observe(
        self, t_s: float, rate: NDArray[np.float64], force: NDArray[np.float64], is_heard: NDArray[np.bool_]
    ) -> None:
        """Learn from a frame.

        Args:
            t_s: its time.
            rate: (imus, 3) mean angular rates in rad/s, in the sensors' axes.
            force: (imus, 3) mean specific forces in m/s^2, in the same axes; nan for a sensor that is not heard.
            is_heard: (imus,) which of them were measured in this frame.
        """
        step_s = t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._last_s = t_s
        at_rest = is_heard & (t_s < self._rest_until_s)
        self._rested += at_rest
        self._bias += np.where(at_rest, 1 / np.maximum(self._rested, 1), 0.0)[:, None] * (rate - self._bias)
        is_bias = np.linalg.norm(self._bias, axis=1) < MOST_BIAS * self._settings.rate_bias_rad_per_s
        is_steady = self._is_steady(force, is_heard, step_s)
        is_quiet = is_heard & is_steady & (at_rest | (self._steady_s > QUIET_S))
        size = np.linalg.norm(self._force, axis=1)
        self.has_size = self.has_size.copy()
        self.has_size[is_quiet] = has_size_of_gravity(size[is_quiet])
        self._move((rate - self._bias) * step_s, np.where(is_heard[:, None], force, self._force), step_s)
        up = self._force / np.maximum(size, LEAST_M_PER_S2)[:, None]
        is_quiet &= self.has_size
        self._expected_up += low_pass_weight(step_s, QUIET_S) * (self._while_quiet.expected_up - self._expected_up)
        is_apart = self._since_quiet.is_apart(self._since_quiet.expected_up, up, LEAST_APART_RAD)
        is_apart |= self._while_quiet.is_apart(self._expected_up, up, 0.0)
        is_told_wrongly = self._is_too_fast() | (is_quiet & is_apart) | ((self._rested >= LEAST_RESTED) & ~is_bias)
        self.moves_as_told = self.moves_as_told & ~is_told_wrongly
        self.is_proven = self.is_proven | (is_quiet & self.moves_as_told & self._since_quiet.gravity_has_turned)
        self._since_quiet.start(is_quiet, up)
        self._velocity[is_quiet] = 0.0
        self._shock[is_quiet] = 0.0
        begins = is_quiet & np.isnan(self._while_quiet.up[:, 0])
        self._while_quiet.start(begins, up)
        self._expected_up[begins] = up[begins]
        self._while_quiet.up[~is_quiet] = np.nan

    def forget(self, imus: NDArray[np.bool_]) -> None:
        """Forget how (imus,) some sensors were turned: they were silent."""
        self._since_quiet.up[imus] = self._while_quiet.up[imus] = np.nan
        self._steady_s[imus] = 0.0

    def _is_steady(self, force: NDArray[np.float64], is_heard: NDArray[np.bool_], step_s: float) -> NDArray[np.bool_]:
        """Return (imus,) which sensors measure a force near its mean, and follow the mean and for how long."""
        self._force = np.where(is_heard[:, None] & np.isnan(self._force), force, self._force)
        change = np.where(is_heard[:, None], force - self._force, 0.0)
        is_steady = np.linalg.norm(change, axis=1) < STEADY_M_PER_S2
        self._force = self._force + low_pass_weight(step_s, QUIET_S) * change
        self._steady_s = np.where(is_steady, self._steady_s + step_s, 0.0)
        return np.asarray(is_steady)

    def _move(self, angle_rad: NDArray[np.float64], force: NDArray[np.float64], step_s: float) -> None:
        """Turn the sensors by (imus, 3) angles in their axes, and accelerate them by (imus, 3) forces."""
        since = self._since_quiet
        before = since.turn
        since.move(angle_rad, step_s)
        accelerated = np.einsum("iab,ib->ia", 0.5 * (before + since.turn), force) - GRAVITY_M_PER_S2 * since.up
        self._velocity = self._velocity + accelerated * step_s
        self._shock += np.abs(np.linalg.norm(force, axis=1) - GRAVITY_M_PER_S2) * step_s
        self._while_quiet.move(angle_rad, step_s)

    def _is_too_fast(self) -> NDArray[np.bool_]:
        """Return (imus,) which velocities are none of a robot: it was moved, struck, or tilted by errors of the sensor.

        sigma_v^2 = sigma_motion^2 + (sum ||f| - g| dt)^2 + 2 (b_f t)^2 + (g b_w t^2 / 2)^2 + (g s phi t)^2
        """
        s, t_s = self._settings, self._since_quiet.lasted_s
        by_rate = s.rate_bias_rad_per_s * t_s / 2
        by_scale = s.rate_scale * self._since_quiet.turned_rad
        tilted = GRAVITY_M_PER_S2 * t_s * np.hypot(by_rate, by_scale)
        moved = np.hypot(s.motion_m_per_s, self._shock)
        variance = moved**2 + 2 * (s.force_bias_m_per_s2 * t_s) ** 2 + tilted**2
        return np.asarray(np.linalg.norm(self._velocity, axis=1) > CONTRADICTS_SIGMA * np.sqrt(variance))
