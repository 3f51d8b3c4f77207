"""The sensor front end: resistance to strain to length, eqs. (2)-(4), with sigma, mode and flags."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from ..values.readings import (
    BENDING,
    MOST_STRETCH,
    STRETCHING,
    Flag,
    ModelError,
    ModeReadings,
    ResistanceFrame,
    RestLengths,
    TendonLengths,
    is_impossible_length,
    is_mode_uncertain,
)
from ..values.tables import Positive, Probability
from ..values.time_series import last_seen, value_before
from .bending import LagFree
from .reference_drift import ReferenceTendons, without_drift
from .sensor_model import SensorModel
from .stretching import MOTION_SHARE, Extrapolation, FastSwing, StrainSpread, StretchingSensors
from .taring import RestShift, Taring

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
class _Readings:
    """The readings of some frames, of which none but the first has a sensor whose loading history is new."""

    t_s: NDArray[np.float64]
    """(frames,)"""
    step_s: NDArray[np.float64]
    """(frames, 1) the time before each frame."""
    seen: NDArray[np.bool_]
    """(frames, tendons) which sensors have a reading."""
    change: NDArray[np.float64]
    """(frames, tendons) dR/R on the common curve, in which a missing value is replaced by the last one."""
    rate_per_s: NDArray[np.float64]
    """(frames, tendons) rate of dR/R; zero after a gap."""
    flags: NDArray[np.int64]
    """(frames, tendons) `Flag` bits."""
    resting: bool
    """Whether the structure still stands at its rest shape."""


@dataclass(frozen=True, slots=True, eq=False)
class _Strain:
    """Strain of all tendons, with its standard deviation."""

    value: NDArray[np.float64]
    """(frames, tendons)"""
    sigma: NDArray[np.float64]
    """(frames, tendons)"""
    model_sigma: NDArray[np.float64]
    """(frames, tendons) the part of sigma that comes from the model of stretched sensors."""
    after_motion: NDArray[np.float64]
    """(frames, tendons) see `ModelError`."""


class FrontEnd:
    """Converts frames of resistance to frames of length, one or many at a time; live and offline are the same."""

    def __init__(
        self,
        model: SensorModel,
        natural_resistance_ohm: NDArray[np.float64],
        natural_length_m: NDArray[np.float64],
        rest: RestLengths | None,
        settings: FrontEndSettings,
        frame_step_s: float,
        references: ReferenceTendons,
        *,
        is_held: bool,
    ) -> None:
        count = len(natural_length_m)
        self._model = model
        self._settings = settings
        self._gauge = model.gauge
        self._frame_step_s = frame_step_s
        self._R0 = natural_resistance_ohm
        self._L0 = natural_length_m
        self._references = references
        self._bending_log_odds = logit(settings.bending_share)
        self._bending = model.bending_curve(settings.bending_abscissa)
        self._taring = Taring(self._gauge, self._bending, rest, natural_length_m)
        self._mode = np.full(count, STRETCHING)
        self._stretching = StretchingSensors(model, count)
        self._spread = StrainSpread(count)
        self._extrapolation = Extrapolation(model, count)
        self._rest_shift = RestShift(self._taring.rest_strain)
        self._change = np.zeros(count)
        self._seen_s = np.full(count, -np.inf)
        self._was_seen = np.zeros(count, dtype=np.bool_)
        self._warm_s = np.full(count, np.nan)
        self._warm_sigma = np.full(count, settings.warm_up_sigma)
        self._swing = FastSwing(count, is_held=is_held)
        self._lag_free = LagFree(count)
        self._last_s = np.nan

    def lengths(self, frames: Sequence[ResistanceFrame]) -> list[TendonLengths]:
        """Return the lengths in more frames; the numbers are the same, however many frames are given at a time."""
        if len(frames) == 1:  # live, there is nothing to part
            return self._lengths_of(frames)
        lengths: list[TendonLengths] = []
        while len(lengths) < len(frames) and not self._taring.is_over(frames[len(lengths)].t_s):
            lengths += self._lengths_of([frames[len(lengths)]])
        for alike in self._parts(frames[len(lengths) :]):
            lengths += self._lengths_of(alike)
        return lengths

    def _parts(self, frames: Sequence[ResistanceFrame]) -> Iterator[Sequence[ResistanceFrame]]:
        """Yield the frames in parts, each from where the history of some sensor begins anew, after a gap."""
        if not frames:
            return
        t_s = np.array([frame.t_s for frame in frames])
        seen = np.isfinite([frame.resistance_ohm[: len(self._L0)] for frame in frames])
        begins = (seen[1:] & ~seen[:-1]).any(axis=1) | (np.diff(t_s) > self._settings.settle_after_s)
        for first, end in pairwise([0, *(1 + np.flatnonzero(begins)).tolist(), len(frames)]):
            yield frames[first:end]

    def _lengths_of(self, frames: Sequence[ResistanceFrame]) -> list[TendonLengths]:
        """Return the lengths in frames in which nothing begins anew after the first one."""
        drift = [self._references.step(frame) for frame in frames]
        frames = [
            without_drift(frame.first(len(self._L0)), found.common) for frame, found in zip(frames, drift, strict=True)
        ]
        change = [  # eq. (8)
            self._taring.common_change(frame.t_s, frame.resistance_ohm / self._R0 - 1) for frame in frames
        ]
        readings = self._readings(frames, np.array(change))
        lag_free, lag = self._lag_free.run(readings.change, readings.step_s)
        stretched = self._stretched(readings)  # f_3
        bent = self._bent(lag_free, lag)  # f_4
        if self._model.unified:  # one network for both modes
            bent = stretched
        probability = self._bending_probability(lag_free, readings)
        mode = self._modes(probability)
        strain = _in_its_mode(stretched, bent, mode, probability)  # eq. (3)
        swing, shaken = self._swing.run(strain.value, readings.seen, readings.step_s)
        flags = self._flags(readings, probability, (swing > 1.5 * strain.sigma) | shaken[:, None])
        strain = replace(strain, sigma=np.hypot(strain.sigma, swing))
        missing, flags = self._missing(frames, strain, flags)
        length_m = np.where(missing, np.nan, (1 + strain.value) * self._L0)  # eq. (4)
        sigma_m = np.where(missing, np.inf, strain.sigma * self._L0)
        rest_sigma_m = np.where(missing, 0.0, np.sqrt(1 - probability) * self._taring.rest_sigma * self._L0)
        model_error = self._model_error(strain, missing)
        modes = self._in_each_mode(stretched, bent, swing, probability)
        per_change_m = self._L0 * (1 + readings.change) / self._gauge.slope(np.maximum(strain.value, 0))
        taken_off = self._references.taken_off(drift, per_change_m, np.where(mode == STRETCHING, 1.0, 0.0))
        return [
            TendonLengths(
                t_s=frame.t_s,
                length_m=length_m[k],
                sigma_m=sigma_m[k],
                mode=mode[k],
                flags=flags[k],
                rest_sigma_m=rest_sigma_m[k],
                lag_s=self._model.lag_s,
                drift=taken_off[k],
                modes=modes.get(k),
                change_since_rest=change[k] - self._taring.rest_change,
                model_error=model_error[k],
                rest_in_doubt=self._taring.in_doubt or self._taring.moved,
            )
            for k, frame in enumerate(frames)
        ]

    def _readings(self, frames: Sequence[ResistanceFrame], change: NDArray[np.float64]) -> _Readings:
        """Return the readings of frames with (frames, tendons) dR/R; missing ones are held.

        The state of sensors that have a reading after a long gap begins anew.
        """
        t_s = np.array([frame.t_s for frame in frames])
        seen = np.isfinite(change)
        last_s = t_s[0] - self._frame_step_s if np.isnan(self._last_s) else self._last_s
        step_s = np.concatenate([t_s[:1] - last_s, t_s[1:] - t_s[:-1]])[:, None]
        fresh = seen[0] & (t_s[0] - self._seen_s > self._settings.settle_after_s)
        whole = last_seen(change, seen, self._change)
        seen_s = last_seen(t_s[:, None], seen, self._seen_s)
        self._begin_anew(whole[0], t_s[0], seen[0], fresh)
        follows = seen.copy()
        follows[0] &= ~fresh
        since_s = t_s[:, None] - np.where(follows, value_before(seen_s, self._seen_s), np.nan)
        rate = np.where(follows, (whole - value_before(whole, self._change)) / since_s, 0.0)
        self._last_s, self._change, self._seen_s, self._was_seen = t_s[-1], whole[-1], seen_s[-1], seen[-1]
        ranges = self._model.ranges
        in_range = (whole <= ranges.change[1]) & self._bending.in_range(whole)
        flags = np.array([frame.flags for frame in frames])
        flags |= np.where(np.abs(rate) > ranges.rate_per_s, int(Flag.TOO_FAST), 0)
        flags |= np.where(in_range, 0, int(Flag.OUT_OF_RANGE))
        resting = self._taring.is_resting(t_s[0])
        return _Readings(t_s, step_s, seen, whole, rate, flags, resting)

    def _begin_anew(
        self, change: NDArray[np.float64], t_s: float, seen: NDArray[np.bool_], fresh: NDArray[np.bool_]
    ) -> None:
        """Begin anew with sensors that have a reading again, and with `fresh` ones, which were silent for long."""
        returned = seen & ~self._was_seen
        if returned.any():
            self._lag_free.restart(returned)
            self._extrapolation.restart(returned)
        if fresh.any():
            self._swing.restart(fresh)
            self._stretching.settle(change, fresh, self._frame_step_s)
            rests = self._taring.tared & self._taring.is_resting(t_s)
            self._warm_s = np.where(fresh & ~rests, t_s, self._warm_s)
            after_gap = np.hypot(self._settings.gap_sigma, self._settings.gap_share * self._spread.value)
            known = np.isfinite(self._seen_s)
            self._warm_sigma = np.where(fresh & known, after_gap, self._warm_sigma)

    def _stretched(self, readings: _Readings) -> _Strain:
        """Return the strain of each tendon if it is stretched, f_3 of eq. (3)."""
        change, rate, step_s = readings.change, readings.rate_per_s, readings.step_s
        network = self._stretching.run(change, rate, step_s)
        strain = self._rest_shift.corrected(network.strain, readings.seen[0] & readings.resting)
        growth = self._extrapolation.run(change, rate, strain, step_s)
        spread = self._spread.run(strain, step_s)
        sigma = network.sigma * growth.factor * self._model.sigma_scale.at(spread)
        left = np.exp(-(readings.t_s[:, None] - self._warm_s) / self._settings.warm_up_s)
        warm_up = np.where(np.isnan(self._warm_s), 0.0, self._warm_sigma * left)
        parts = (sigma, self._taring.sigma(strain, change), network.curve_sigma, growth.added, warm_up)
        whole_sigma = np.asarray(np.sqrt(sum(part**2 for part in parts)))
        model_sigma = np.hypot(sigma, network.curve_sigma)
        return _Strain(strain, whole_sigma, model_sigma, MOTION_SHARE * spread / model_sigma)

    def _bent(self, lag_free: NDArray[np.float64], lag: NDArray[np.float64]) -> _Strain:
        """Return the strain of each tendon if it is bent, f_4 of eq. (3).

        Half of the lag correction is added to sigma.
        """
        strain, sigma = self._bending.strain(lag_free, np.hypot(self._settings.bending_sigma, 0.5 * lag))
        none = np.zeros_like(strain)
        return _Strain(strain, np.hypot(sigma, self._taring.motion_sigma), none, none)

    def _bending_probability(self, lag_free: NDArray[np.float64], readings: _Readings) -> NDArray[np.float64]:
        """Return (frames, tendons) the probability that each tendon is bent; at rest its mode is known."""
        probability = expit(self._model.mode_odds.at(lag_free) + self._bending_log_odds)
        known = np.isfinite(self._taring.rest_strain) & readings.resting
        return np.where(known, self._taring.rest_strain < 0, probability)

    def _modes(self, probability: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return (frames, tendons) the mode of each tendon, which changes with hysteresis."""
        modes = np.empty(probability.shape, dtype=np.int64)
        leave, enter = self._settings.leave_bending, self._settings.enter_bending
        for k, bent in enumerate(probability):
            limit = np.where(self._mode == BENDING, leave, enter)
            modes[k] = self._mode = np.where(bent > limit, BENDING, STRETCHING)
        return modes

    def _in_each_mode(
        self, stretched: _Strain, bent: _Strain, swing: NDArray[np.float64], probability: NDArray[np.float64]
    ) -> dict[int, ModeReadings]:
        """Return the lengths in both modes of the frames in which some mode is uncertain, by their number.

        In no mode is a length impossible.
        """
        asked = np.flatnonzero(is_mode_uncertain(probability).any(axis=-1))
        if not len(asked):
            return {}
        strain = np.stack([stretched.value[asked], bent.value[asked]], axis=1)
        sigma = np.hypot(np.stack([stretched.sigma[asked], bent.sigma[asked]], axis=1), swing[asked, None])
        length_m, sigma_m = (1 + strain) * self._L0, sigma * self._L0
        impossible = is_impossible_length(length_m, self._L0)
        bent_share = np.where(impossible[:, 0], 1.0, np.where(impossible[:, 1], 0.0, probability[asked]))
        of_frames = zip(length_m, sigma_m, bent_share, strict=True)
        return {k: ModeReadings(*each) for k, each in zip(asked.tolist(), of_frames, strict=True)}

    @property
    def exchanged(self) -> list[tuple[int, int]]:
        """Pairs of tendons whose sensors seem to be exchanged, from their readings at rest."""
        return self._taring.exchanged(self._R0)

    @property
    def misfits_at_rest(self) -> bool:
        """Whether at least half of the sensors do not fit the rest shape."""
        return self._taring.in_doubt

    @property
    def moved_at_rest(self) -> bool:
        """Whether the structure moved while its sensors were tared; sigma is then widened."""
        return self._taring.moved

    def _flags(
        self, readings: _Readings, probability: NDArray[np.float64], shaken: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Return the flags with ambiguous modes, warm-up, misfit at rest and shaking added."""
        ambiguous = np.minimum(probability, 1 - probability) > self._settings.ambiguous_probability
        warming_up = readings.t_s[:, None] - self._warm_s < self._settings.warm_up_s
        flags = readings.flags
        for flag, where in (
            (Flag.AMBIGUOUS, ambiguous),
            (Flag.WARMING_UP, warming_up),
            (Flag.MISFIT, self._taring.misfit),
            (Flag.SHAKEN, shaken),
        ):
            flags = flags | np.where(where, int(flag), 0)
        return flags

    def _missing(
        self, frames: Sequence[ResistanceFrame], strain: _Strain, flags: NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return (frames, tendons) which tendons have no length that one can have, and the flags that say so."""
        impossible = is_impossible_length((1 + strain.value) * self._L0, self._L0) | (strain.sigma > MOST_STRETCH)
        flags = flags | np.where(impossible, int(Flag.OUT_OF_RANGE), 0)
        no_reading = (flags & NO_LENGTH) != 0
        read = np.array([frame.flags for frame in frames])
        return no_reading | impossible, np.where(no_reading, read | (flags & int(Flag.MISFIT)), flags)

    def _model_error(self, strain: _Strain, missing: NDArray[np.bool_]) -> list[ModelError]:
        """Return the error of the sensor model in each frame; none where lengths are missing."""
        sigma_m = np.where(missing, 0.0, strain.model_sigma * self._L0)
        tared_length_m = np.where(self._taring.tared, (1 + self._taring.rest_strain) * self._L0, np.nan)
        reach_m = self._taring.reach * self._L0
        return [
            ModelError(of_frame_m, tared_length_m, reach_m, after_motion)
            for of_frame_m, after_motion in zip(sigma_m, strain.after_motion, strict=True)
        ]


def _in_its_mode(
    stretched: _Strain, bent: _Strain, mode: NDArray[np.int64], probability: NDArray[np.float64]
) -> _Strain:
    """Return the strain in the mode of each tendon; its sigma combines both modes, weighted by probability."""
    strain = np.where(mode == BENDING, bent.value, stretched.value)
    variance = (1 - probability) * (stretched.sigma**2 + (stretched.value - strain) ** 2)
    variance += probability * (bent.sigma**2 + (bent.value - strain) ** 2)
    return _Strain(strain, np.sqrt(variance), (1 - probability) * stretched.model_sigma, stretched.after_motion)
