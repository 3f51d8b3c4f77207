"""The sensor front end: resistance to strain to length, eqs. (2)-(4), with sigma, mode and flags."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from ..values.readings import (
    MOST_STRETCH,
    Flag,
    Mode,
    ModelError,
    ModeReadings,
    ResistanceFrame,
    RestLengths,
    SensorDrift,
    TendonLengths,
    is_impossible_length,
    is_mode_uncertain,
)
from ..values.tables import Positive, Probability
from .bending import LagFree
from .reference_drift import ReferenceDrift, ReferenceTendons, without_drift
from .sensor_model import SensorModel
from .stretching import Extrapolation, FastSwing, StrainSpread, StretchingSensors
from .taring import MOTION_SHARE, RestShift, Taring

NO_LENGTH = int(Flag.MISSING | Flag.MISFIT)
"""Flags with which a tendon has no length."""


@dataclass(frozen=True, slots=True)
class FrontEndSettings:
    """How resistance is converted to strain."""

    bending_abscissa: Literal["strain", "resistance"] = "strain"
    """Which quantity is x in eq. (9)."""
    bending_sigma: Positive = 0.01
    """Standard deviation of the error of eq. (9), in dR/R."""
    settle_after_s: Positive = 0.5
    """Length of a gap in the readings after which the loading history of a sensor counts as unknown."""
    warm_up_sigma: Positive = 0.025
    """Standard deviation of strain that is added in quadrature directly after an unknown history."""
    gap_sigma: Positive = 0.002
    """The same after a gap, for a sensor that rested before it."""
    gap_share: Positive = 0.13
    """The same for a sensor that moved, over the standard deviation of its strain in the last half minute. In the
    calibration recordings, sensors that are taken as settled in the middle of a motion are wrong by 0.13 of it."""
    warm_up_s: Positive = 3.0
    """Time in which the added standard deviation falls by a factor of e."""
    bending_share: Probability = 0.05
    """Prior probability that a tendon is bent."""
    enter_bending: Probability = 0.7
    """Probability of bending above which the mode of a stretched tendon changes to bending."""
    leave_bending: Probability = 0.3
    """Probability of bending below which the mode of a bent tendon changes to stretching."""
    ambiguous_probability: Probability = 0.05
    """Probability of the less likely mode above which the reading is flagged as ambiguous."""


@dataclass(frozen=True, slots=True, eq=False)
class _HeldChange:
    """dR/R on the common curve, in which a missing value is replaced by the last one (zero-order hold)."""

    change: NDArray[np.float64]
    """(tendons,)"""
    rate_per_s: NDArray[np.float64]
    """(tendons,) rate of dR/R; zero after a gap."""
    fresh: NDArray[np.bool_]
    """(tendons,) True for a sensor whose loading history is unknown, because this is its first reading after a gap."""
    returned: NDArray[np.bool_]
    """(tendons,) True for a sensor that has a reading again, and had none in the frame before."""
    flags: NDArray[np.int64]
    """(tendons,) `Flag` bits."""


@dataclass(frozen=True, slots=True, eq=False)
class _Strain:
    """Strain of all tendons, with its standard deviation."""

    value: NDArray[np.float64]
    """(tendons,)"""
    sigma: NDArray[np.float64]
    """(tendons,)"""
    model_sigma: NDArray[np.float64] | float = 0.0
    """(tendons,) the part of sigma that comes from the model of stretched sensors."""


class FrontEnd:
    """Converts frames of resistance to frames of length, one after another; live and offline are the same."""

    def __init__(
        self,
        model: SensorModel,
        natural_resistance_ohm: NDArray[np.float64],
        natural_length_m: NDArray[np.float64],
        rest: RestLengths | None,
        settings: FrontEndSettings,
        frame_step_s: float,
        references: ReferenceTendons,
        board: NDArray[np.int64] | None = None,
        *,
        is_held: bool = True,
    ) -> None:
        count = len(natural_length_m)
        self._model = model
        self._settings = settings
        self._gauge = model.gauge
        self._frame_step_s = frame_step_s
        self._R0 = natural_resistance_ohm
        self._L0 = natural_length_m
        self._references = references
        self._board = board
        self._bending_log_odds = logit(settings.bending_share)
        self._bending = model.bending_curve(settings.bending_abscissa)
        self._taring = Taring(self._gauge, self._bending, rest, natural_length_m)
        self._mode = np.full(count, int(Mode.STRETCHING))
        self._stretching = StretchingSensors(model, count)
        self._spread = StrainSpread(count)
        self._extrapolation = Extrapolation(model, count)
        self._rest_shift = RestShift(self._taring.rest_strain)
        self._change = np.zeros(count)
        self._seen_s = np.full(count, -np.inf)
        self._was_seen = np.zeros(count, dtype=np.bool_)
        self._warm_s = np.full(count, np.nan)
        self._warm_sigma = np.full(count, settings.warm_up_sigma)
        self._strain_spread = np.zeros(count)
        self._swing = FastSwing(count, is_held=is_held)
        self._lag_free = LagFree(count)
        self._last_s = np.nan

    def step(self, frame: ResistanceFrame) -> TendonLengths:
        """Return the lengths in one more frame."""
        step_s = frame.t_s - self._last_s if np.isfinite(self._last_s) else self._frame_step_s
        self._last_s = frame.t_s
        drift = self._references.step(frame)
        frame = without_drift(frame.first(len(self._L0)), drift.common)
        change = self._taring.common_change(frame.t_s, frame.resistance_ohm / self._R0 - 1)  # eq. (8)
        held = self._hold_missing(frame, change)
        self._lag_free.restart(held.returned)
        self._extrapolation.restart(held.returned)
        lag_free, lag = self._lag_free.step(held.change, step_s)
        stretched = self._stretched(held, frame.t_s, step_s)  # f_3
        bent = self._bent(lag_free, lag)  # f_4
        if self._model.unified:  # one network for both modes
            bent = stretched
        probability = self._decide_mode(lag_free, frame.t_s)
        strain = self._in_its_mode(stretched, bent, probability)  # eq. (3)
        swing = self._swing.step(strain.value, self._seen_s == frame.t_s, held.fresh, step_s)
        flags = self._flags(held.flags, probability, frame.t_s)
        shaken = (swing > 1.5 * strain.sigma) | self._swing.robot_is_shaken
        flags = flags | np.where(shaken, int(Flag.SHAKEN), 0)
        strain = _Strain(strain.value, np.hypot(strain.sigma, swing), strain.model_sigma)
        lengths = self._lengths(frame, strain, probability, flags)  # eq. (4)
        return replace(
            lengths,
            drift=self._taken_off(drift, held.change, strain.value),
            modes=self._in_each_mode(stretched, bent, swing, probability),
            change_since_rest=change - self._taring.rest_change,
        )

    def _in_each_mode(
        self, stretched: _Strain, bent: _Strain, swing: NDArray[np.float64], probability: NDArray[np.float64]
    ) -> ModeReadings | None:
        """Return the lengths in both modes; None where no mode is uncertain. In no mode is a length impossible."""
        if not is_mode_uncertain(probability).any():
            return None
        length_m = (1 + np.stack([stretched.value, bent.value])) * self._L0
        impossible = is_impossible_length(length_m, self._L0)
        probability = np.where(impossible[0], 1.0, np.where(impossible[1], 0.0, probability))
        return ModeReadings(
            length_m=length_m,
            sigma_m=np.hypot(np.stack([stretched.sigma, bent.sigma]), swing) * self._L0,
            bending_probability=probability,
        )

    def _taken_off(
        self, drift: ReferenceDrift, change: NDArray[np.float64], strain: NDArray[np.float64]
    ) -> SensorDrift:
        """Return the drift with the change of length that it would make; a bent tendon's is not counted."""
        per_change_m = self._L0 * (1 + change) / self._gauge.slope(np.maximum(strain, 0))
        counted = self._mode == Mode.STRETCHING
        total = np.full(len(change), drift.common)
        sigma = np.full(len(change), drift.common_sigma)
        is_tendon = self._references.tendons < len(change)
        tendons = self._references.tendons[is_tendon]
        total[tendons] += drift.own[is_tendon]
        sigma[tendons] = drift.own_sigma[is_tendon]
        counted[tendons] = False  # their lengths are known, whatever their sensors read
        return SensorDrift(
            change=total,
            sigma=sigma,
            per_change_m=np.where(counted, per_change_m, 0.0),
            own_rate_per_s=drift.own_rate_per_s,
            references=drift.references,
            board=self._board,
        )

    @property
    def exchanged(self) -> list[tuple[int, int]]:
        """Pairs of tendons whose sensors seem to be exchanged, from their readings at rest."""
        return self._taring.exchanged(self._R0)

    @property
    def rest_in_doubt(self) -> bool:
        """Whether at least half of the sensors do not fit the rest shape."""
        return self._taring.in_doubt

    @property
    def moved_at_rest(self) -> bool:
        """Whether the structure moved while its sensors were tared; sigma is then widened."""
        return self._taring.moved

    def _decide_mode(self, lag_free: NDArray[np.float64], t_s: float) -> NDArray[np.float64]:
        """Return the probability that each tendon is bent, and set its mode, with hysteresis."""
        probability = expit(self._model.mode_odds.at(lag_free) + self._bending_log_odds)
        if self._taring.is_resting(t_s):  # at rest the mode is known
            known = np.isfinite(self._taring.rest_strain)
            probability = np.where(known, self._taring.rest_strain < 0, probability)
        limit = np.where(self._mode == Mode.BENDING, self._settings.leave_bending, self._settings.enter_bending)
        self._mode = np.where(probability > limit, int(Mode.BENDING), int(Mode.STRETCHING))
        return np.asarray(probability)

    def _hold_missing(self, frame: ResistanceFrame, change: NDArray[np.float64]) -> _HeldChange:
        """Return dR/R with missing values held; reset the state of sensors that have a reading after a long gap."""
        seen = np.isfinite(change)
        fresh = seen & (frame.t_s - self._seen_s > self._settings.settle_after_s)
        change = np.where(seen, change, self._change)
        if fresh.any():
            self._stretching.settle(change, fresh, self._frame_step_s)
            self._warm_s = np.where(fresh & ~self._rests(frame.t_s), frame.t_s, self._warm_s)
            after_gap = np.hypot(self._settings.gap_sigma, self._settings.gap_share * self._strain_spread)
            known = np.isfinite(self._seen_s)
            self._warm_sigma = np.where(fresh & known, after_gap, self._warm_sigma)
        follows = seen & ~fresh
        step_s = frame.t_s - np.where(follows, self._seen_s, np.nan)
        rate = np.where(follows, (change - self._change) / step_s, 0.0)
        self._change = change
        self._seen_s = np.where(seen, frame.t_s, self._seen_s)
        returned, self._was_seen = seen & ~self._was_seen, seen
        flags = frame.flags | np.where(np.abs(rate) > self._model.ranges.rate_per_s, int(Flag.TOO_FAST), 0)
        in_range = (change <= self._model.ranges.change[1]) & self._bending.in_range(change)
        return _HeldChange(change, rate, fresh, returned, flags | np.where(in_range, 0, int(Flag.OUT_OF_RANGE)))

    def _rests(self, t_s: float) -> NDArray[np.bool_]:
        return self._taring.tared & self._taring.is_resting(t_s)

    def _stretched(self, held: _HeldChange, t_s: float, step_s: float) -> _Strain:
        """Return the strain of each tendon if it is stretched, f_3 of eq. (3)."""
        strain, sigma = self._stretching.step(held.change, held.rate_per_s, step_s)
        strain = self._rest_shift.corrected(strain, self._taring.is_resting(t_s) & (self._seen_s == t_s))
        widening, beyond, _ = self._extrapolation.step(held.change, held.rate_per_s, strain, step_s)
        self._strain_spread = self._spread.step(strain, step_s)
        sigma = sigma * widening * self._model.sigma_scale.at(self._strain_spread)
        left = np.exp(-(t_s - self._warm_s) / self._settings.warm_up_s)
        warm_up = np.where(np.isnan(self._warm_s), 0.0, self._warm_sigma * left)
        curve = self._stretching.curve_sigma
        parts = (sigma, self._taring.sigma(strain, held.change), curve, beyond, warm_up)
        return _Strain(strain, np.asarray(np.sqrt(sum(part**2 for part in parts))), np.hypot(sigma, curve))

    def _bent(self, lag_free: NDArray[np.float64], lag: NDArray[np.float64]) -> _Strain:
        """Return the strain of each tendon if it is bent, f_4 of eq. (3).

        Half of the lag correction is added to sigma.
        """
        strain, sigma = self._bending.strain(lag_free, np.hypot(self._settings.bending_sigma, 0.5 * lag))
        return _Strain(strain, np.hypot(sigma, self._taring.motion_sigma))

    def _in_its_mode(self, stretched: _Strain, bent: _Strain, probability: NDArray[np.float64]) -> _Strain:
        """Return the strain in the mode of each tendon; its sigma combines both modes, weighted by probability."""
        strain = np.where(self._mode == Mode.BENDING, bent.value, stretched.value)
        variance = (1 - probability) * (stretched.sigma**2 + (stretched.value - strain) ** 2)
        variance += probability * (bent.sigma**2 + (bent.value - strain) ** 2)
        return _Strain(strain, np.sqrt(variance), (1 - probability) * stretched.model_sigma)

    def _flags(self, flags: NDArray[np.int64], probability: NDArray[np.float64], t_s: float) -> NDArray[np.int64]:
        """Return the flags with ambiguous modes, warm-up and misfit at rest added."""
        ambiguous = np.minimum(probability, 1 - probability) > self._settings.ambiguous_probability
        warming_up = t_s - self._warm_s < self._settings.warm_up_s
        for flag, where in (
            (Flag.AMBIGUOUS, ambiguous),
            (Flag.WARMING_UP, warming_up),
            (Flag.MISFIT, self._taring.misfit),
        ):
            flags = flags | np.where(where, int(flag), 0)
        return flags

    def _lengths(
        self, frame: ResistanceFrame, strain: _Strain, probability: NDArray[np.float64], flags: NDArray[np.int64]
    ) -> TendonLengths:
        length_m = (1 + strain.value) * self._L0
        impossible = is_impossible_length(length_m, self._L0) | (strain.sigma > MOST_STRETCH)
        flags = flags | np.where(impossible, int(Flag.OUT_OF_RANGE), 0)
        no_reading = (flags & NO_LENGTH) != 0
        missing = no_reading | impossible
        rest_sigma_m = np.sqrt(1 - probability) * self._taring.rest_sigma * self._L0
        return TendonLengths(
            t_s=frame.t_s,
            length_m=np.where(missing, np.nan, length_m),
            sigma_m=np.where(missing, np.inf, strain.sigma * self._L0),
            mode=self._mode,
            flags=np.where(no_reading, frame.flags | (flags & int(Flag.MISFIT)), flags),
            rest_sigma_m=np.where(missing, 0.0, rest_sigma_m),
            model_error=ModelError(
                sigma_m=np.where(missing, 0.0, strain.model_sigma * self._L0),
                tared_length_m=np.where(self._taring.tared, (1 + self._taring.rest_strain) * self._L0, np.nan),
                reach_m=self._taring.reach * self._L0,
                after_motion_m=MOTION_SHARE * self._strain_spread * self._L0,
            ),
            lag_s=self._model.lag_s,
        )
