"""Which inertial sensors to trust: those whose gravity agrees with the inclination of their rods.

In slow motion the specific force f is against gravity, so that its part along the rod's axis a, as told, is the rod's
inclination: f . a / |f| = (R u) . z. A sensor that is told the wrong way round, sits on another rod, or has failed,
contradicts it. One that does for longer than a moment is left out.
"""

from dataclasses import replace

import numpy as np

from ...factors.imu import ImuArray, ImuSamples
from ...models.pose.placed import PlacedShape
from ...models.structure.floor import UP
from ...models.structure.support import GRAVITY_M_PER_S2
from ...models.values.low_pass import low_pass_weight

MOST_APART = 0.25
"""Difference of both inclinations beyond which they contradict each other: 14 degrees."""
SLOW_EXCESS_M_PER_S2 = 0.5
"""Difference of the specific force from g below which the motion is slow."""
SLOW_RAD_PER_S = 0.1
"""Rate below which it is slow."""
TRUST_MEMORY_S = 0.5
"""Time constant of the mean difference."""


class ImuTrust:
    """Follows which sensors to trust, frame by frame."""

    def __init__(self, imus: int) -> None:
        self.is_trusted = np.ones(imus, dtype=np.bool_)
        """(imus,)"""
        self._apart = np.zeros(imus)

    def trusted(self, samples: ImuSamples) -> ImuSamples:
        """Return the samples without those of sensors that are not trusted."""
        return samples if self.is_trusted.all() else replace(samples, count=np.where(self.is_trusted, samples.count, 0))

    def observe(self, imus: ImuArray, placed: PlacedShape, samples: ImuSamples, step_s: float) -> None:
        """Learn from a frame.

        Args:
            imus: the sensors.
            placed: the shape in the world.
            samples: of the sensors in the frame.
            step_s: time since the frame before.
        """
        force = samples.specific_force_m_per_s2
        size = np.linalg.norm(force, axis=1)
        slow = np.abs(size - GRAVITY_M_PER_S2) < SLOW_EXCESS_M_PER_S2
        slow &= np.linalg.norm(samples.rate_rad_per_s, axis=1) < SLOW_RAD_PER_S
        along = placed.arm_m[imus.ends[:, 1]] - placed.arm_m[imus.ends[:, 0]]
        inclination = along @ UP / np.linalg.norm(along, axis=1)
        apart = np.abs(np.sum(force * imus.axis, axis=1) / size - inclination)
        weight = low_pass_weight(step_s, TRUST_MEMORY_S)
        self._apart += np.where(slow, weight * (np.nan_to_num(apart) - self._apart), 0.0)
        self.is_trusted = self.is_trusted & (self._apart < MOST_APART)
