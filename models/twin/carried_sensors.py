"""What a virtual robot carries beside its tendons, and what a virtual lab has: inertial sensors, ranges, positions."""

from dataclasses import dataclass

import numpy as np

from ..structure.structure import Structure
from ..values.aids import AidReading, ImuReading, PositionReading, RangeReading
from ..values.rotations import rotation, rotation_vector
from ..values.tables import NotNegative, Positive, Share
from .engine import TwinMotion


@dataclass(frozen=True, slots=True)
class ImuPlan:
    """`[[imu]]`: an inertial sensor on a rod; its axes are turned about the rod by a random angle."""

    rod: int
    fraction: Share
    """Place along the rod: 0 at its first node, 1 at its second."""
    rate_hz: Positive
    rate_noise_rad_per_s: NotNegative
    force_noise_m_per_s2: NotNegative
    rate_bias_rad_per_s: NotNegative
    """Standard deviation of the bias of the rate, per axis."""
    force_bias_m_per_s2: NotNegative
    """Standard deviation of the bias of the specific force, per axis."""
    misalignment_rad: NotNegative
    """Standard deviation of the angle between the rod and its axis as told, about either axis across it."""
    range_m_per_s2: Positive
    """Largest specific force that it measures, per axis."""
    rate_scale: NotNegative = 0.0
    """Standard deviation of the error of the rate in proportion to it, per axis."""

    def readings(
        self, number: int, motion: TwinMotion, structure: Structure, gravity_m_per_s2: float, rng: np.random.Generator
    ) -> list[AidReading]:
        """Return the samples: means over the time between two of them, with their errors, cut at the range."""
        assert motion.rod_turn is not None, "inertial sensors need the turn of the rods"
        step_s = float(motion.t_s[1] - motion.t_s[0])
        in_rod = rotation(np.array([0, 0, rng.uniform(-np.pi, np.pi)])) @ rotation(
            self.misalignment_rad * np.append(rng.normal(size=2), 0.0)
        )
        turn = motion.rod_turn[:, self.rod] @ in_rod
        a, b = structure.rods[self.rod]
        place_m = (1 - self.fraction) * motion.node_position_m[:, a] + self.fraction * motion.node_position_m[:, b]
        rate = rotation_vector(np.swapaxes(turn[:-1], 1, 2) @ turn[1:]) / step_s
        force = np.zeros((len(turn), 3))
        force[1:-1] = np.diff(place_m, n=2, axis=0) / step_s**2
        force[:, 2] += gravity_m_per_s2
        force = np.einsum("tba,tb->ta", turn, force)
        every = round(1 / self.rate_hz / step_s)
        count = len(rate) // every
        rate = rate[: count * every].reshape(count, every, 3).mean(axis=1)
        force = force[: count * every].reshape(count, every, 3).mean(axis=1)
        if self.rate_scale:
            rate = rate * (1 + self.rate_scale * rng.normal(size=3))
        rate = (
            rate
            + self.rate_bias_rad_per_s * rng.normal(size=3)
            + self.rate_noise_rad_per_s * rng.normal(size=rate.shape)
        )
        force = force + self.force_bias_m_per_s2 * rng.normal(size=3)
        force = force + self.force_noise_m_per_s2 * rng.normal(size=force.shape)
        force = np.clip(force, -self.range_m_per_s2, self.range_m_per_s2)
        t_s = motion.t_s[0] + step_s * every * (np.arange(count) + 1)
        return [ImuReading(number, float(t), w, f) for t, w, f in zip(t_s, rate, force, strict=True)]


@dataclass(frozen=True, slots=True)
class RangePlan:
    """`[[range]]`: beacons that measure the distances to all nodes, one after another."""

    beacon_position_m: list[tuple[float, float, float]]
    rate_hz: Positive
    """Of all distances together."""
    noise_m: NotNegative
    offset_m: NotNegative
    """Standard deviation of the offset of a pair of beacon and node."""
    outlier_share: Share
    outlier_m: NotNegative
    """Mean by which an outlier is too long."""

    def readings(self, number: int, motion: TwinMotion, rng: np.random.Generator) -> list[AidReading]:
        """Return the distances."""
        beacons = np.array(self.beacon_position_m)
        nodes = motion.node_position_m.shape[1]
        offset_m = self.offset_m * rng.normal(size=(len(beacons), nodes))
        found: list[AidReading] = []
        for k, t_s in enumerate(np.arange(motion.t_s[0], motion.t_s[-1], 1 / self.rate_hz)):
            beacon, node = k % len(beacons), (k // len(beacons)) % nodes
            x = motion.node_position_m[np.searchsorted(motion.t_s, t_s), node]
            range_m = np.linalg.norm(x - beacons[beacon]) + offset_m[beacon, node] + self.noise_m * rng.normal()
            if rng.random() < self.outlier_share:
                range_m += rng.exponential(self.outlier_m)
            found.append(RangeReading(float(t_s), beacons[beacon], (number, beacon, node), float(range_m)))
        return found


@dataclass(frozen=True, slots=True)
class PositionPlan:
    """`[[position]]`: motion capture of some nodes, which are hidden from time to time."""

    nodes: list[int]
    rate_hz: Positive
    noise_m: NotNegative
    seen_s: Positive
    """Mean time for which a node is seen."""
    hidden_s: Positive
    """Mean time for which it is hidden."""

    def readings(self, number: int, motion: TwinMotion, rng: np.random.Generator) -> list[AidReading]:
        """Return the positions."""
        found: list[AidReading] = []
        times_s = np.arange(motion.t_s[0], motion.t_s[-1], 1 / self.rate_hz)
        for node in self.nodes:
            seen, until_s = True, rng.exponential(self.seen_s)
            for t_s in times_s:
                while t_s > until_s:
                    seen = not seen
                    until_s += rng.exponential(self.seen_s if seen else self.hidden_s)
                if seen:
                    x = motion.node_position_m[np.searchsorted(motion.t_s, t_s), node]
                    found.append(PositionReading(float(t_s), node, x + self.noise_m * rng.normal(size=3), number))
        return sorted(found, key=lambda reading: reading.t_s)
