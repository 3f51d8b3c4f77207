"""Which inertial sensors to trust: those whose gravity agrees with the inclination of their rods.

In slow motion the specific force f is against gravity, so that its part along the rod's axis a, as told, is the rod's
inclination: f . a / |f| = (R u) . z. A sensor that is told the wrong way round, sits on another rod, or has failed,
contradicts it. One that does for longer than a moment is left out.

At the start the attitude of the rods is measured, so that the inclination has to agree within what offsets and the
misalignment explain. A sensor whose rates contradict its own gravity is left out, too, and so is one whose gravity has
another size, as long as it has, see `models.pose.imu_agreement`.

A sensor that was silent does not know how it has turned meanwhile: it is lost, and left out until it moves slowly and
agrees with its rod again. So is, from the start on, one whose rod stands upright: gravity does not tell the turn about
such a rod, in whose axes the rates would count.

A sensor whose rod has turned otherwise than shape, floor and all other sensors say is outvoted, and lost as well. Of
the errors e of the directions of all rods, with the covariance S, to which the turn of a rod by its deformation over
`shape_holds_s` is added, those of sensor i differ from what the others leave for them by W_i^-1 (W e)_i with the
covariance W_i^-1, where W = S^-1:

    chi_i^2 = (W e)_i^T W_i^-1 (W e)_i

A turn that is wrong lasts for more than a frame, so that what chi^2 exceeds its mean of 2 by is added up, with a memory
of `DISPUTE_MEMORY_S`, and in proportion to the time since the frame before, 1 for `WHOLE_STEP_S`. The sensor is
outvoted whose sum is larger than that of all others by `OUTVOTED_SIGMA`^2. Of two that disagree none may be: where the
largest sum is beyond this limit and no sensor is outvoted, all beyond it are in dispute, and doubted from then on,
because what the wrong one told stays in place and heading. So is a sensor whose rates were cut off at the end of its
range: how far it has turned is unknown.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...factors.imu import ImuArray
from ...models.pose.imu_agreement import CONTRADICTS_SIGMA, ImuAgreement
from ...models.pose.imu_samples import ImuSamples
from ...models.pose.placed import PlacedShape
from ...models.pose.pose_settings import PoseSettings
from ...models.pose.pose_state import PoseState
from ...models.structure.floor import GRAVITY_M_PER_S2, UP
from ...models.values.aids import READING_HOLDS_S, ImuReading
from ...models.values.chi_squared import squared_distance
from ...models.values.readings import TendonLengths
from ...models.values.time_series import low_pass_weight
from .pose_start import IMU_TURN_RAD
from .prediction import Prediction

MOST_APART = 0.25
"""Difference of both inclinations beyond which they contradict each other: 14 degrees."""
SLOW_EXCESS_M_PER_S2 = 0.5
"""Difference of the specific force from g below which the motion is slow."""
SLOW_RAD_PER_S = 0.1
"""Rate below which it is slow."""
TRUST_MEMORY_S = 0.5
"""Time constant of the mean difference."""
OUTVOTED_SIGMA = 5.0
"""Standard deviations by which a sensor differs from what the others leave for it when it is outvoted."""
DISPUTE_MEMORY_S = 0.2
"""Time constant of the sum of chi^2. Of two sensors, one whose rates were wrong by 9 rad/s from one frame on turned a
robot that hung by 600 mm within half a second, and chi^2 of a frame was no larger than 38."""
WHOLE_STEP_S = 0.02
"""Time between frames whose chi^2 counts once: the errors of shapes at higher rates are not independent."""
AGREE = 1.0
"""Chi^2 of all sensors together below which they agree."""


class ImuTrust:
    """Follows which sensors to trust, frame by frame."""

    def __init__(self, imus: int, rest_until_s: float, settings: PoseSettings) -> None:
        self.is_trusted = np.ones(imus, dtype=np.bool_)
        """(imus,)"""
        self.is_lost = np.zeros(imus, dtype=np.bool_)
        """(imus,) sensors that were silent or outvoted, and are not taken on again yet."""
        self._is_outvoted = np.zeros(imus, dtype=np.bool_)
        self._is_in_dispute = np.zeros(imus, dtype=np.bool_)
        self._was_cut_off = np.zeros(imus, dtype=np.bool_)
        self._is_given_up = np.zeros(imus, dtype=np.bool_)
        self._disagreed = np.zeros(imus)
        self._last_s = np.nan
        self._share = 1.0
        self._heard_s = np.full(imus, -np.inf)
        self._apart = np.zeros(imus)
        self._agreement = ImuAgreement(imus, rest_until_s, settings)
        self._rest_until_s = rest_until_s
        self._deformed_rad = settings.deformation_rad_per_s * settings.shape_holds_s
        tilt = settings.force_bias_m_per_s2 / GRAVITY_M_PER_S2
        self._most_apart_at_rest = CONTRADICTS_SIGMA * np.hypot(tilt, settings.misalignment_rad)

    @property
    def is_used(self) -> NDArray[np.bool_]:
        """(imus,) sensors that are trusted and not lost."""
        return self.is_trusted & ~self.is_lost

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """(imus,) sensors that contradict rods, gravity, themselves or the others, or whose rates were cut off."""
        return self._contradicted(self.is_trusted)

    @property
    def told_wrongly(self) -> NDArray[np.bool_]:
        """(imus,) those that may have been so from the start: not the ones that were given up, and are proven."""
        is_right = self._is_given_up & self._agreement.is_proven & self._agreement.moves_as_told
        return self._contradicted(self.is_trusted | is_right)

    def _contradicted(self, is_trusted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        disagree = self._is_outvoted | self._is_in_dispute
        return ~(is_trusted & self._agreement.has_size) | disagree | self._was_cut_off

    def start(self, imus: ImuArray, arm_m: NDArray[np.float64]) -> None:
        """Lose the sensors whose turn about their rods gravity does not tell, with (nodes, 3) nodes in world axes."""
        self.is_lost = self.is_lost | ~imus.is_inclined(arm_m)

    def give_up(self) -> None:
        """Trust no sensor any more that is used now."""
        self._is_given_up = self._is_given_up | self.is_used
        self.is_trusted = self.is_trusted & ~self.is_used

    def lose(self) -> None:
        """Lose the sensors that are used, until they rest and agree with their rods again."""
        self.is_lost = self.is_lost | self.is_used

    def used(self, samples: ImuSamples) -> ImuSamples:
        """Return the samples without those of sensors that are not used."""
        return samples if self.is_used.all() else replace(samples, count=np.where(self.is_used, samples.count, 0))

    def hear(self, t_s: float, samples: ImuSamples) -> None:
        """Learn from a frame which sensors are silent, and which contradict gravity or themselves."""
        is_heard = samples.count > 0
        self._heard_s[is_heard] = t_s
        if np.isfinite(self._last_s):
            self._disagreed *= np.exp(-(t_s - self._last_s) / DISPUTE_MEMORY_S)
            self._share = float(np.clip((t_s - self._last_s) / WHOLE_STEP_S, 0.0, 1.0))
        self._last_s = t_s
        is_silent = t_s - self._heard_s > READING_HOLDS_S
        self._agreement.forget(is_silent | samples.are_missing)
        self._agreement.observe(t_s, samples.rate_rad_per_s, samples.specific_force_m_per_s2, is_heard)
        self.is_trusted = self.is_trusted & self._agreement.moves_as_told
        self.is_lost = self.is_lost | is_silent | ~self._agreement.has_size
        self._was_cut_off = self._was_cut_off | samples.rate_is_cut_off

    def tells_gravity(self, samples: ImuSamples) -> NDArray[np.bool_]:
        """Return (imus,) which lost sensors move slowly, and nothing has contradicted their gravity so far."""
        return self.is_lost & ~self.contradicted & move_slowly(samples)

    def outvotes(self, imus: ImuArray, predicted: Prediction) -> bool:
        """Return whether a sensor is outvoted, which is lost then; what is expected of the frame needs it no longer.

        Args:
            imus: the sensors.
            predicted: what is expected of the frame, by the rates of all sensors that are used.
        """
        used = np.flatnonzero(self.is_used)
        if len(used) < 2:
            return False
        disagreed = self._disagreed.copy()
        excess = self._apart_from_others(imus, predicted, used) - 2.0
        disagreed[used] = np.maximum(disagreed[used] + self._share * excess, 0.0)
        second, first = used[np.argsort(disagreed[used])[-2:]]
        limit = OUTVOTED_SIGMA**2
        if disagreed[first] - disagreed[second] < limit:
            self._disagreed = disagreed
            self._is_in_dispute = self._is_in_dispute | (disagreed > limit)
            return False
        self.is_lost, self._is_outvoted = self.is_lost.copy(), self._is_outvoted.copy()
        self.is_lost[first] = self._is_outvoted[first] = True
        self._disagreed[first] = 0.0
        return True

    def _apart_from_others(self, imus: ImuArray, predicted: Prediction, used: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (used,) chi_i^2, how far the turn of each sensor's rod is from what the others leave for it."""
        rows = imus.direction_rows(predicted.placed, 1.0, used)
        variance = rows.variance + self._deformed_rad**2
        if rows.error**2 @ (1 / variance) < AGREE:  # no chi^2 is larger
            return np.zeros(len(used))
        S = rows.jacobian @ predicted.covariance @ rows.jacobian.T
        S[np.diag_indices(len(S))] += variance
        W = np.asarray(np.linalg.inv(S), dtype=np.float64)
        apart = (W @ rows.error).reshape(-1, 2)
        own = W.reshape(len(used), 2, len(used), 2)[range(len(used)), :, range(len(used))]
        return squared_distance(apart, own)

    def back(self, imus: ImuArray, arm_m: NDArray[np.float64], samples: ImuSamples) -> NDArray[np.int64]:
        """Return the lost sensors that are back, which are lost no longer: they move slowly and agree with their rods.

        Their rods are inclined, so that gravity tells how they are turned.

        Args:
            imus: the sensors.
            arm_m: (nodes, 3) the nodes in world axes.
            samples: of the sensors in the frame.
        """
        if not self.is_lost.any():
            return np.zeros(0, dtype=np.int64)
        slow, apart = move_slowly(samples) & imus.is_inclined(arm_m), _apart(imus, arm_m, samples)
        back = self.is_lost & self._agreement.has_size & (samples.count > 0) & slow & (apart < MOST_APART)
        self.is_lost, self._is_outvoted = self.is_lost & ~back, self._is_outvoted & ~back
        return np.flatnonzero(back)

    def observe(self, imus: ImuArray, placed: PlacedShape, samples: ImuSamples, t_s: float, step_s: float) -> None:
        """Learn from a frame.

        Args:
            imus: the sensors.
            placed: the shape in the world.
            samples: of the sensors in the frame.
            t_s: time of the frame.
            step_s: time since the frame before.
        """
        slow, apart = move_slowly(samples), _apart(imus, placed.arm_m, samples)
        weight = low_pass_weight(step_s, TRUST_MEMORY_S)
        self._apart += np.where(slow & ~self.is_lost, weight * (np.nan_to_num(apart) - self._apart), 0.0)
        most_apart = self._most_apart_at_rest if t_s < self._rest_until_s else MOST_APART
        self.is_trusted = self.is_trusted & (self._apart < most_apart)


def without_sensors(frames: Sequence[TendonLengths], imus: NDArray[np.bool_]) -> list[TendonLengths]:
    """Return frames without the readings of (imus,) some inertial sensors."""
    return [
        replace(lengths, aids=tuple(aid for aid in lengths.aids if not (isinstance(aid, ImuReading) and imus[aid.imu])))
        for lengths in frames
    ]


def taken_on_again(
    state: PoseState,
    covariance: NDArray[np.float64],
    back: NDArray[np.int64],
    imu_turn: NDArray[np.float64],
    settings: PoseSettings,
) -> tuple[PoseState, NDArray[np.float64], NDArray[np.float64]]:
    """Take on sensors that were silent.

    Args:
        state: the pose.
        covariance: (size, size) of its errors.
        back: the numbers of these sensors.
        imu_turn: (imus, 3, 3) their attitudes, by their rods and by gravity; those of other sensors are not used.
        settings: for what is not known of a sensor.

    Returns:
        The state, its covariance, and (size, size) F, the transition of the errors: those of a sensor's attitude become
        those of the body's.
    """
    at = state.layout
    F = np.eye(at.size)
    noise = np.zeros(at.size)
    turn = state.imu_turn.copy()
    turn[back] = imu_turn[back]
    for imu in map(int, back):
        place = at.of_imu(at.imu_turn, imu)
        F[place] = np.eye(3, at.size, at.turn.start)
        noise[place] = IMU_TURN_RAD**2
        noise[at.of_imu(at.rate_bias, imu)] = settings.rate_bias_rad_per_s**2
        noise[at.of_imu(at.force_bias, imu)] = settings.force_bias_m_per_s2**2
    return replace(state, imu_turn=turn), F @ covariance @ F.T + np.diag(noise), F


def move_slowly(samples: ImuSamples) -> NDArray[np.bool_]:
    """Return (imus,) which sensors neither turn nor are accelerated."""
    rate = np.linalg.norm(samples.rate_rad_per_s, axis=1)
    return np.asarray((samples.excess_m_per_s2 < SLOW_EXCESS_M_PER_S2) & (rate < SLOW_RAD_PER_S))


def is_still(samples: ImuSamples) -> bool:
    """Return whether all sensors that were read in a frame, one at least, neither turn nor are accelerated."""
    slow = move_slowly(samples)[samples.count > 0]
    return bool(len(slow) and slow.all())


def _apart(imus: ImuArray, arm_m: NDArray[np.float64], samples: ImuSamples) -> NDArray[np.float64]:
    """Return (imus,) how far sensors that move slowly contradict the inclination of their rods."""
    return np.asarray(np.abs(imus.inclination(samples) - imus.rod_direction(arm_m) @ UP))
