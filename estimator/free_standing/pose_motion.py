"""How the state of a pose changes over a frame: its transition F, and the noise that is added.

The body turns by phi and its rate decays, to e^(-dt / tau) of it over a step dt. Without inertial sensors phi is phi_0,
the present rate times the step, with

    C = 2 sigma^2 / tau dt^3 / 3

as its covariance, for a rate of standard deviation sigma that lasts for tau. Each inertial sensor i, on a rod of
direction d_i, tells phi across its rod to within the rate of deformation and along it to within that of the
rod's spin, which counts only where all sensors are on parallel rods:

    phi = C (C_0^-1 phi_0 + sum_i M_i Q_i diag(1 + k_i) (w_i - b_i) dt),   C = (C_0^-1 + sum_i M_i)^-1
    M_i = (1 - d d^T) / (s_deformation dt)^2 + d d^T / (s_spin dt)^2

A sensor whose samples are missing turns with the body, by T, and against it as its rod deforms and spins:

    d_i' = d' + T (d_i - d) + noise

The mean point of the sensors, at the arm a from the centroid, is accelerated by their mean specific force and gravity,
and the centroid's velocity is v = u - w x a, with the velocity u of this point.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...factors.imu import ImuArray
from ...models.pose.imu_samples import ImuSamples
from ...models.pose.placed import put_blocks
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import ErrorLayout, PoseState
from ...models.structure.floor import GRAVITY_M_PER_S2, UP
from ...models.values.rotations import cross_matrix, rotation

EYE = np.eye(3)
TINY = 1e-9
SHOCK_M_PER_S2 = 20.0
"""Difference of a specific force from gravity, 2 g, above which feet strike the floor: no hand moves a robot so."""
SHOCK_SHARE = 0.5
"""Noise of the specific force in proportion to what exceeds it: a shock is shorter than the time between samples."""
CUT_OFF_SHARE = 1.0
"""The same of one that is cut off, in proportion to its whole difference from gravity: what is beyond the range may be
as large as what is within."""
LEAST_TOLD = 0.2
"""Least eigenvalue of sum (1 - d d^T), from which sensors on rods of different directions tell every turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The state after a time step, and what it is made of."""

    state: PoseState
    transition: NDArray[np.float64]
    """(size, size) F, the derivative of its errors by those of the state before."""
    noise: NDArray[np.float64]
    """(size, size) covariance that the time step adds."""


class PoseMotion:
    """Predicts the state of a pose over one frame after another."""

    def __init__(self, imus: ImuArray, settings: PoseSettings) -> None:
        self._imus = imus
        self._settings = settings

    def after(
        self, before: PoseState, step_s: float, samples: ImuSamples | None, arms_m: tuple[NDArray[np.float64], ...]
    ) -> Motion:
        """Return the state after a time step.

        Args:
            before: the state before.
            step_s: the time step; of a long gap, what the pose is known for, while samples last for all of it.
            samples: of the inertial sensors in this step; None without such sensors.
            arms_m: two arrays (nodes, 3) of the nodes in body coordinates, before and after the step.
        """
        at = before.layout
        F = np.eye(at.size)
        noise = np.zeros((at.size, at.size))
        if samples is None:
            return Motion(self._moved(self._turned(before, step_s, F, noise), step_s, F, noise), F, noise)
        state = self._turned_by_imus(before, step_s, samples, F, noise)
        forced = np.flatnonzero(samples.count)
        if not len(forced):
            return Motion(self._moved(state, step_s, F, noise), F, noise)
        return Motion(self._moved_by_imus(before, state, step_s, samples, forced, arms_m, F, noise), F, noise)

    def _turned(
        self, before: PoseState, step_s: float, F: NDArray[np.float64], noise: NDArray[np.float64]
    ) -> PoseState:
        """Return the state with the body turned at its present rate, which decays."""
        at = before.layout
        density, slowed = self._density(self._settings.turn_rad_per_s, step_s)
        turn = rotation(before.rate_rad_per_s * step_s)
        F[at.turn, at.turn] = turn
        F[at.turn, at.rate] = step_s * EYE
        F[at.rate, at.rate] = slowed * EYE
        _add_integrated(noise, at.turn, at.rate, density, step_s)
        return replace(before, turn=turn @ before.turn, rate_rad_per_s=slowed * before.rate_rad_per_s)

    def _turned_by_imus(
        self,
        before: PoseState,
        step_s: float,
        samples: ImuSamples,
        F: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> PoseState:
        """Return the state with sensors and body turned as the sensors say."""
        settings, at = self._settings, before.layout
        lasted_s = np.where(np.isnan(samples.lasted_s), step_s, samples.lasted_s)
        turning_s = float(lasted_s.max())
        told = (samples.rate_rad_per_s - before.rate_bias_rad_per_s) * lasted_s[:, None]
        w = (1 + before.rate_scale) * told
        imu_turn = before.imu_turn @ rotation(w)
        middle = 0.5 * (before.imu_turn + imu_turn)
        d = self._imus.direction(replace(before, imu_turn=middle))
        d /= np.maximum(np.linalg.norm(d, axis=1, keepdims=True), TINY)  # or 1 - d d^T has negative eigenvalues
        along = d[:, :, None] * d[:, None, :]
        counted = (samples.count > 0)[:, None, None]
        spread = np.linalg.eigvalsh(np.sum(counted * (EYE - along), axis=0))[0]
        by_spin = 0.0 if spread > LEAST_TOLD else settings.spin_rad_per_s**-2
        M = counted * ((EYE - along) / settings.deformation_rad_per_s**2 + by_spin * along) / step_s**2
        density, slowed = self._density(settings.turn_rad_per_s, step_s)
        known = 3 / (density * step_s**3) * EYE
        C = np.linalg.inv(known + M.sum(axis=0))
        turned = np.einsum("iab,ib->ia", middle, w)
        by_imu = C @ M
        by_rate = slowed * step_s * C @ known
        phi = by_rate @ before.rate_rad_per_s + np.einsum("iab,ib->a", by_imu, turned)
        turn = rotation(phi)
        F[at.turn, at.turn] = turn
        F[at.turn, at.rate] = by_rate
        by_bias = -middle * (lasted_s[:, None] * (1 + before.rate_scale))[:, None]
        by_scale = middle * told[:, None]
        put_blocks(F, at.of_imus(at.imu_turn), at.of_imus(at.rate_bias), by_bias)
        put_blocks(F, at.of_imus(at.imu_turn), at.of_imus(at.rate_scale), by_scale)
        F[at.turn, at.rate_bias] = _side_by_side(by_imu @ by_bias)
        F[at.turn, at.rate_scale] = _side_by_side(by_imu @ by_scale)
        F[at.turn, at.imu_turn] = _side_by_side(-by_imu @ cross_matrix(turned))
        F[at.rate] = F[at.turn] / turning_s
        F[at.rate, at.turn] = 0.0
        noise[at.turn, at.turn] = C
        noise[at.turn, at.rate] = noise[at.rate, at.turn] = C / turning_s
        noise[at.rate, at.rate] = C / turning_s**2 + density * step_s / 3 * EYE
        unseen = np.where(samples.count > 0, 0.0, density * step_s**3)
        white = settings.rate_rad_per_s**2 * lasted_s**2 / np.maximum(samples.count, 1)
        _add_diagonal(noise, at.imu_turn, np.repeat(white + unseen, 3))
        _add_diagonal(noise, at.rate_bias, settings.rate_bias_rad_per_s15**2 * turning_s)
        _add_diagonal(noise, at.force_bias, settings.force_bias_m_per_s25**2 * turning_s)
        for imu in map(int, np.flatnonzero(samples.are_missing)):
            imu_turn[imu] = turn @ before.imu_turn[imu]
            self._carry_along(at, at.of_imu(at.imu_turn, imu), turn, step_s, F, noise)
        return replace(before, turn=turn @ before.turn, rate_rad_per_s=phi / turning_s, imu_turn=imu_turn)

    def _carry_along(
        self,
        at: ErrorLayout,
        sensor: slice,
        turn: NDArray[np.float64],
        step_s: float,
        F: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> None:
        """Turn the errors of a sensor, at their place, with those of the body, see above."""
        F[sensor] = F[at.turn]
        F[sensor, at.turn] -= turn
        F[sensor, sensor] += turn
        noise[sensor] = noise[at.turn]
        noise[:, sensor] = noise[:, at.turn]
        noise[sensor, sensor] = noise[at.turn, at.turn]
        against = self._settings.deformation_rad_per_s**2 + self._settings.spin_rad_per_s**2
        _add_diagonal(noise, sensor, against * step_s**2)

    def _moved(self, state: PoseState, step_s: float, F: NDArray[np.float64], noise: NDArray[np.float64]) -> PoseState:
        """Return the state with the centroid moved at its present velocity, which decays."""
        at = state.layout
        density, slowed = self._density(self._settings.motion_m_per_s, step_s)
        F[at.position, at.velocity] = step_s * EYE
        F[at.velocity, at.velocity] = slowed * EYE
        _add_integrated(noise, at.position, at.velocity, density, step_s)
        return replace(
            state,
            position_m=state.position_m + step_s * state.velocity_m_per_s,
            velocity_m_per_s=slowed * state.velocity_m_per_s,
        )

    def _moved_by_imus(
        self,
        before: PoseState,
        after: PoseState,
        step_s: float,
        samples: ImuSamples,
        forced: NDArray[np.int64],
        arms_m: tuple[NDArray[np.float64], ...],
        F: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> PoseState:
        """Return the state with the centroid moved as the mean specific force of some sensors says."""
        settings, at = self._settings, before.layout
        middle = 0.5 * (before.imu_turn + after.imu_turn)[forced]
        force = np.einsum(
            "iab,ib->ia", middle, samples.specific_force_m_per_s2[forced] - before.force_bias_m_per_s2[forced]
        )
        arm_before = self._imus.arm_m(arms_m[0] @ before.turn.T, forced)
        arm_after = self._imus.arm_m(arms_m[1] @ after.turn.T, forced)
        accelerated = (force.mean(axis=0) - GRAVITY_M_PER_S2 * UP) * step_s
        vectors = np.stack([before.rate_rad_per_s, arm_before, after.rate_rad_per_s, arm_after])
        w_before, a_before, w_after, a_after = cross_matrix(vectors)
        point = before.velocity_m_per_s + w_before @ arm_before + accelerated
        velocity = point - w_after @ arm_after
        rows = np.zeros((3, at.size))
        rows[:, at.velocity] = EYE
        rows[:, at.rate] = -a_before
        share = step_s / len(forced)
        rows[:, at.of_imus(at.imu_turn)[forced].ravel()] = _side_by_side(-share * cross_matrix(force))
        rows[:, at.of_imus(at.force_bias)[forced].ravel()] = _side_by_side(-share * middle)
        rows[:, at.turn] = -w_before @ a_before
        F[at.velocity] = rows + a_after @ F[at.rate] + w_after @ a_after @ F[at.turn]
        F[at.position] += 0.5 * step_s * F[at.velocity]
        F[at.position, at.velocity] += 0.5 * step_s * EYE
        sigma = force_sigma_m_per_s2(samples, forced, settings)
        _carry_noise(noise, at.rate, at.velocity, a_after)
        noise[at.velocity, at.velocity] += (sigma * step_s) ** 2 * EYE
        _carry_noise(noise, at.velocity, at.position, 0.5 * step_s * EYE)
        return replace(
            after,
            position_m=before.position_m + 0.5 * step_s * (before.velocity_m_per_s + velocity),
            velocity_m_per_s=velocity,
        )

    def _density(self, sigma: float, step_s: float) -> tuple[float, float]:
        """Return the power density of the white noise that keeps a rate at sigma, and its decay over a step."""
        holds_s = self._settings.motion_holds_s
        return 2 * sigma**2 / holds_s, float(np.exp(-step_s / holds_s))


def force_sigma_m_per_s2(samples: ImuSamples, sensors: NDArray[np.int64], settings: PoseSettings) -> float:
    """Return the noise of the mean specific force of some sensors."""
    excess, is_cut_off = samples.excess_m_per_s2[sensors], samples.force_is_cut_off[sensors]
    white = settings.force_m_per_s2 / np.sqrt(len(sensors))
    in_motion = settings.force_share * excess
    in_shock = np.where(is_cut_off, CUT_OFF_SHARE * excess, SHOCK_SHARE * np.maximum(excess - SHOCK_M_PER_S2, 0.0))
    return float(white + (in_motion + in_shock).mean())


def _side_by_side(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m, blocks n), the (blocks, m, n) blocks beside each other."""
    return blocks.swapaxes(0, 1).reshape(blocks.shape[1], -1)


def _add_integrated(noise: NDArray[np.float64], value: slice, rate: slice, density: float, step_s: float) -> None:
    """Add the covariance of white noise that is integrated once in a rate, and twice in its value."""
    noise[value, value] += density * step_s**3 / 3 * EYE
    noise[value, rate] += density * step_s**2 / 2 * EYE
    noise[rate, value] += density * step_s**2 / 2 * EYE
    noise[rate, rate] += density * step_s * EYE


def _add_diagonal(noise: NDArray[np.float64], part: slice, variance: NDArray[np.float64] | float) -> None:
    here = np.arange(part.start, part.stop)
    noise[here, here] += variance


def _carry_noise(noise: NDArray[np.float64], part: slice, onto: slice, by: NDArray[np.float64]) -> None:
    """Add the noise of one part of the state, times a matrix, to another part, which has none yet."""
    noise[onto] = by @ noise[part]
    noise[:, onto] = noise[:, part] @ by.T
