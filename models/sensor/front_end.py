"""The sensor front end: resistance to strain to length, eqs. (2)-(4), with sigma, mode and flags."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from ..values.readings import Flag, Mode, ResistanceFrame, RestLengths, SensorDrift, TendonLengths
from ..values.tables import Positive, Probability
from .bending import LagFree
from .drift import ReferenceDrift, ReferenceTendons, without_drift
from .sensor_model import SensorModel
from .stretching import Extrapolation, StrainSpread, StretchingSensors
from .taring import RestTare, Taring


@dataclass(frozen=True, slots=True)
class FrontEndSettings:
    """How resistance becomes strain."""

    bending_abscissa: Literal["strain", "resistance"] = "strain"
    """Which quantity is x in eq. (9)."""
    bending_sigma: Positive = 0.01
    """Error of eq. (9), in dR/R."""
    settle_after_s: Positive = 0.5
    """After a gap this long a sensor's history is taken as unknown."""
    warm_up_sigma: Positive = 0.025
    """Strain sigma right after an unknown history, ..."""
    warm_up_s: Positive = 3.0
    """... and the time in which it falls by e."""
    bending_share: Probability = 0.05
    """How much of the time a tendon is bent, to the best of one's knowledge before the trial."""
    enter_bending: Probability = 0.7
    """Probability of bending above which a tendon is called bent, ..."""
    leave_bending: Probability = 0.3
    """... and below which it is called stretched again."""
    ambiguous_probability: Probability = 0.05
    """The less likely mode is mentioned from here on."""


class FrontEnd:
    """Turns frames of resistance into frames of length, one after another; the same live and offline."""

    def __init__(
        self,
        model: SensorModel,
        natural_resistance_ohm: NDArray[np.float64],
        natural_length_m: NDArray[np.float64],
        rest: RestLengths | None,
        settings: FrontEndSettings,
        frame_step_s: float,
        references: ReferenceTendons,
    ) -> None:
        count = len(natural_length_m)
        self._model, self._settings, self._gauge = model, settings, model.gauge
        self._frame_step_s = frame_step_s
        self._references = references
        self._R0, self._L0 = natural_resistance_ohm, natural_length_m
        self._bending = model.bending_curve(settings.bending_abscissa)
        self._taring = Taring(self._gauge, self._bending, rest, natural_length_m)
        self._mode = np.full(count, int(Mode.STRETCHING))
        self._stretching = StretchingSensors(model, count)
        self._spread, self._extrapolation = StrainSpread(count), Extrapolation(model, count)
        self._rest_tare = RestTare(self._taring.rest_strain)
        self._change = np.zeros(count)
        self._seen_s = np.full(count, -np.inf)
        self._warm_s = np.full(count, np.nan)
        self._lag_free = LagFree(count)
        self._last_s = np.nan

    def step(self, frame: ResistanceFrame) -> TendonLengths:
        """Return the lengths at one more frame."""
        step_s = frame.t_s - self._last_s if np.isfinite(self._last_s) else self._frame_step_s
        self._last_s = frame.t_s
        drift = self._references.step(frame)
        frame = without_drift(frame, drift.common)
        change = self._taring.common_change(frame.t_s, frame.resistance_ohm / self._R0 - 1)  # eq. (8)
        change, rate, flags = self._hold_missing(frame, change)
        lag_free, lag = self._lag_free.step(change, step_s)
        stretched, stretched_sigma = self._stretched(change, rate, frame.t_s, step_s)  # f_3
        bent, bent_sigma = self._bending.strain(lag_free, np.hypot(self._settings.bending_sigma, 0.5 * lag))  # f_4
        if self._model.unified:  # one network for both
            bent, bent_sigma = stretched, stretched_sigma
        probability = self._decide_mode(lag_free, frame.t_s)
        strain = np.where(self._mode == Mode.BENDING, bent, stretched)  # eq. (3)
        variance = (1 - probability) * (stretched_sigma**2 + (stretched - strain) ** 2)
        variance += probability * (bent_sigma**2 + (bent - strain) ** 2)
        ambiguous = np.minimum(probability, 1 - probability) > self._settings.ambiguous_probability
        flags |= np.where(ambiguous, Flag.AMBIGUOUS, 0)
        flags |= np.where(frame.t_s - self._warm_s < self._settings.warm_up_s, Flag.WARMING_UP, 0)
        flags |= np.where(self._taring.misfit, Flag.MISFIT, 0)
        missing = (flags & (Flag.MISSING | Flag.MISFIT)) != 0
        length = np.where(missing, np.nan, (1 + strain) * self._L0)  # eq. (4)
        sigma = np.where(missing, np.inf, np.sqrt(variance) * self._L0)
        rest_sigma = np.where(missing, 0.0, np.sqrt(1 - probability) * self._taring.rest_sigma * self._L0)
        flags = np.where(missing, frame.flags | (flags & Flag.MISFIT), flags)
        taken_off = self._taken_off(drift, change, strain)
        return TendonLengths(frame.t_s, length, sigma, self._mode, flags, rest_sigma, self._model.lag_s, taken_off)

    def _taken_off(
        self, drift: ReferenceDrift, change: NDArray[np.float64], strain: NDArray[np.float64]
    ) -> SensorDrift:
        """Return the drift in the form that goes with lengths."""
        per_change_m = self._L0 * (1 + change) / self._gauge.slope(np.maximum(strain, 0))
        return SensorDrift(
            change=np.full(len(change), drift.common),
            sigma=np.full(len(change), drift.common_sigma),
            per_change_m=np.where(self._mode == Mode.STRETCHING, per_change_m, 0.0),
            own_rate_per_s=drift.own_rate_per_s,
            references=drift.references,
        )

    @property
    def exchanged(self) -> list[tuple[int, int]]:
        """Pairs of tendons whose sensors look exchanged, by what they read at rest."""
        return self._taring.exchanged(self._R0)

    @property
    def rest_in_doubt(self) -> bool:
        """Whether most sensors do not fit the rest shape."""
        return self._taring.in_doubt

    def _decide_mode(self, lag_free: NDArray[np.float64], t_s: float) -> NDArray[np.float64]:
        """Return the probability that each tendon is bent, and set its mode, with hysteresis."""
        probability = expit(self._model.mode_odds.at(lag_free) + logit(self._settings.bending_share))
        if self._taring.is_resting(t_s):  # then the mode is known
            known = np.isfinite(self._taring.rest_strain)
            probability = np.where(known, self._taring.rest_strain < 0, probability)
        limit = np.where(self._mode == Mode.BENDING, self._settings.leave_bending, self._settings.enter_bending)
        self._mode = np.where(probability > limit, int(Mode.BENDING), int(Mode.STRETCHING))
        return np.asarray(probability)

    def _hold_missing(
        self, frame: ResistanceFrame, change: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Return dR/R with gaps held, its rate, and the flags; start sensors afresh that come back from long gaps."""
        seen = np.isfinite(change)
        fresh = seen & (frame.t_s - self._seen_s > self._settings.settle_after_s)
        change = np.where(seen, change, self._change)
        if fresh.any():
            self._stretching.settle(change, fresh, self._frame_step_s)
            self._warm_s = np.where(fresh & ~self._rests(frame.t_s), frame.t_s, self._warm_s)
        step_s = frame.t_s - np.where(seen & ~fresh, self._seen_s, np.nan)
        rate = np.nan_to_num((change - self._change) / step_s)
        self._change, self._seen_s = change, np.where(seen, frame.t_s, self._seen_s)
        flags = frame.flags | np.where(np.abs(rate) > self._model.ranges.rate_per_s, Flag.TOO_FAST, 0)
        in_range = (change <= self._model.ranges.change[1]) & self._bending.in_range(change)
        return change, rate, flags | np.where(in_range, 0, Flag.OUT_OF_RANGE)

    def _rests(self, t_s: float) -> NDArray[np.bool_]:
        return self._taring.tared & self._taring.is_resting(t_s)

    def _stretched(
        self, change: NDArray[np.float64], rate: NDArray[np.float64], t_s: float, step_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return strain and sigma of a stretched tendon, f_3 of eq. (3)."""
        strain, sigma = self._stretching.step(change, rate, step_s)
        strain = self._rest_tare.corrected(strain, self._taring.is_resting(t_s) & (self._seen_s == t_s))
        widening, beyond, _ = self._extrapolation.step(change, rate, strain, step_s)
        sigma = sigma * widening * self._model.sigma_scale.at(self._spread.step(strain, step_s))
        warm_for_s = np.nan_to_num(t_s - self._warm_s, nan=np.inf)
        warm_up = self._settings.warm_up_sigma * np.exp(-warm_for_s / self._settings.warm_up_s)
        curve = self._stretching.curve_sigma(change)
        parts = (sigma, self._taring.sigma(strain, change), curve, beyond, warm_up)
        return strain, np.asarray(np.sqrt(sum(part**2 for part in parts)))
