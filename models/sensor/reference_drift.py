"""The drift of the sensors: the relative change of resistance without strain, from tendons of known length.

A sensor reads R = R(strain) exp(d) with d = c + o, where c is common to all sensors (temperature, supply) and o is its
own. A tendon between two anchors keeps its length, so that its reading changes by d alone. Both parts are zero at the
start; their rates are forgotten within `memory_s`, and each sensor has a random walk as in calibration:

    dc = c' dt,   c' stationary with sigma s_c;     do_e = o_e' dt + walk,   o_e' stationary with sigma s_o

How fast sensors drift is not known beforehand. One Kalman filter runs for each pair (s_c, s_o), zero among them, and is
weighted by the likelihood of its predictions. A pair lasts for `regime_s` and is then any, by its prior probability: a
drift may begin after hours without one. Reference tendons that drift alike are evidence
of a common drift, those that drift apart of own drifts; a reading that jumps is evidence of neither and is not used. A
reference that stays where it jumped, as after a contact that slipped, begins anew there, with the drift found until
then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..values.chi_squared import squared_distance
from ..values.readings import ResistanceFrame, SensorDrift
from ..values.tables import NotNegative, Positive, Probability

RATES_PER_S = (0.0, 1e-4, 3e-4, 1e-3)
"""The rates s_c and s_o that are compared: none, and 0.6, 1.8 and 6 % in a minute."""
BASE_S = 2.0
"""Time over which the first readings of a reference are averaged. It needs no rest."""
JUMP_SIGMA = 6.0
"""A reading of a reference that differs from every prediction by more sigmas than this is not used."""


@dataclass(frozen=True, slots=True)
class DriftSettings:
    """What drift of the sensors is expected, in dR/R."""

    walk_per_sqrt_s: NotNegative = 3e-4
    """Random walk of each sensor, which its sigma contains: in calibration offsets differ by 0.003 over 100 s."""
    memory_s: Positive = 30.0
    """Time after which a rate of drift is forgotten: bodies of this size warm up in a minute."""
    regime_s: Positive = 300.0
    """Time for which the sensors go on to drift, or not to."""
    common_probability: Probability = 0.1
    """Prior probability that the sensors drift together."""
    own_probability: Probability = 0.1
    """Prior probability that each drifts by itself."""
    reading_sigma: Positive = 0.002
    """Standard deviation of a reference's reading, averaged over half a second: one code of 10 bits is 0.004."""
    update_every_s: Positive = 0.1
    """Shortest time between two updates."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceDrift:
    """The drift that the reference tendons show at one instant."""

    common: float
    """c, the relative change of resistance of all sensors."""
    common_sigma: float
    """Standard deviation of c."""
    own_rate_per_s: float
    """Standard deviation of a sensor's own rate; 0 while references drift apart no faster than in calibration."""
    own: NDArray[np.float64]
    """(references,) o of each reference tendon."""
    own_sigma: NDArray[np.float64]
    """(references,) standard deviation of the whole drift c + o of each reference tendon."""

    @property
    def references(self) -> int:
        """The number of the reference tendons."""
        return len(self.own)


class ReferenceTendons:
    """Estimates the drift of reference tendons, frame by frame, from the past alone.

    Args:
        tendons: (references,) their numbers.
        settings: what drift is expected.
        board: (tendons,) number of the board that reads each sensor; None where it is not known.
    """

    def __init__(
        self, tendons: NDArray[np.int64], settings: DriftSettings, board: NDArray[np.int64] | None = None
    ) -> None:
        self.tendons = tendons
        self._board = board
        self._settings = settings
        parts = 1 + len(tendons)
        rates = np.array(list(product(RATES_PER_S, RATES_PER_S)))
        self._rate_variance = np.hstack([rates[:, :1], np.repeat(rates[:, 1:], len(tendons), axis=1)]) ** 2
        self._own_rate = rates[:, 1]
        self._prior = _prior(rates[:, 0], settings.common_probability) * _prior(rates[:, 1], settings.own_probability)
        self._weight = self._prior
        self._mean = np.zeros((len(rates), 2 * parts))
        self._covariance = np.zeros((len(rates), 2 * parts, 2 * parts))
        rate_index = np.arange(parts, 2 * parts)
        self._covariance[:, rate_index, rate_index] = self._rate_variance
        self._reads = np.hstack([np.ones((len(tendons), 1)), np.eye(len(tendons)), np.zeros((len(tendons), parts))])
        self._base = _Mean(len(tendons))
        self._recent = _Mean(len(tendons))
        self._first_s = np.full(len(tendons), np.nan)
        self._jumped_s = np.zeros(len(tendons))
        self._begun = False
        self._updated_s = np.nan
        none = np.zeros(len(tendons))
        self._found = ReferenceDrift(0.0, 0.0, 0.0, none, none)

    def step(self, frame: ResistanceFrame) -> ReferenceDrift:
        """Return the drift after one more frame."""
        if not len(self.tendons):
            return self._found
        reading = np.log(frame.resistance_ohm[self.tendons])
        seen = np.isfinite(reading)
        self._first_s = np.where(seen & np.isnan(self._first_s), frame.t_s, self._first_s)
        starts = seen & (frame.t_s - self._first_s < BASE_S)
        if starts.any():  # one that starts late, or anew, has had the drift until then
            self._base.add(reading - self._found.common - self._found.own, starts)
        self._recent.add(reading, seen & ~starts)
        self._begun = self._begun or bool((frame.t_s - self._first_s >= BASE_S).any())
        if np.isnan(self._updated_s) or not self._begun:
            self._updated_s = frame.t_s
            return self._found
        step_s = frame.t_s - self._updated_s
        if step_s >= self._settings.update_every_s:
            self._predict(step_s)
            drift = self._recent.value - self._base.value
            used = self._update(drift, step_s)
            self._begin_anew(np.isfinite(drift) & ~used, np.isfinite(drift) & used, step_s)
            self._recent = _Mean(len(self.tendons))
            self._updated_s = frame.t_s
            self._found = self._mixture()
        return self._found

    def taken_off(
        self,
        found: Sequence[ReferenceDrift],
        per_change_m: NDArray[np.float64],
        stretched_share: NDArray[np.float64],
    ) -> list[SensorDrift]:
        """Return of each frame the drift that was taken off, with the change of length that it would make.

        Args:
            found: the drift in each frame, as `step` returns it.
            per_change_m: (frames, tendons) change of a stretched tendon's length for a relative change of resistance.
            stretched_share: (frames, tendons) see `SensorDrift`.
        """
        count = per_change_m.shape[-1]
        is_tendon = self.tendons < count  # and no reference strip
        tendons = self.tendons[is_tendon]
        counted_m = per_change_m.copy()
        counted_m[:, tendons] = 0.0  # their lengths are known, whatever their sensors read
        taken_off = []
        for one, of_frame_m, share in zip(found, counted_m, stretched_share, strict=True):
            total = np.full(count, one.common)
            sigma = np.full(count, one.common_sigma)
            total[tendons] += one.own[is_tendon]
            sigma[tendons] = one.own_sigma[is_tendon]
            taken_off.append(
                SensorDrift(total, sigma, of_frame_m, share, one.own_rate_per_s, one.references, self._board)
            )
        return taken_off

    def _begin_anew(self, jumped: NDArray[np.bool_], used: NDArray[np.bool_], step_s: float) -> None:
        """Begin anew with the (references,) whose readings have been where they `jumped` for `BASE_S`."""
        self._jumped_s = np.where(used, 0.0, self._jumped_s + np.where(jumped, step_s, 0.0))
        anew = self._jumped_s >= BASE_S
        self._base.clear(anew)
        self._first_s[anew] = np.nan
        self._jumped_s[anew] = 0.0

    def _predict(self, step_s: float) -> None:
        parts = self._rate_variance.shape[1]
        transition = drift_transition(parts, step_s, self._settings.memory_s)
        self._mean = self._mean @ transition.T
        self._covariance = transition @ self._covariance @ transition.T
        level = np.arange(parts)
        rate = level + parts
        self._covariance[:, level[1:], level[1:]] += self._settings.walk_per_sqrt_s**2 * step_s
        (of_level, of_both), (_, of_rate) = drift_noise(step_s, self._settings.memory_s)
        self._covariance[:, level, level] += of_level * self._rate_variance
        self._covariance[:, level, rate] += of_both * self._rate_variance
        self._covariance[:, rate, level] += of_both * self._rate_variance
        self._covariance[:, rate, rate] += of_rate * self._rate_variance
        stay = np.exp(-step_s / self._settings.regime_s)
        self._weight = stay * self._weight + (1 - stay) * self._prior

    def _update(self, drift: NDArray[np.float64], step_s: float) -> NDArray[np.bool_]:
        """Use the (references,) drift of the readings, nan where there are none; return which of them were used."""
        noise = self._settings.reading_sigma**2 * max(0.5 / step_s, 1.0)
        innovation = drift - self._mean @ self._reads.T
        spread = np.einsum("rj,hjk,rk->hr", self._reads, self._covariance, self._reads) + noise
        with np.errstate(invalid="ignore"):
            used = np.asarray((innovation**2 < JUMP_SIGMA**2 * spread).any(axis=0))
        seen = np.flatnonzero(used)
        if not len(seen):
            return used
        reads = self._reads[seen]
        innovation = innovation[:, seen]
        crossed = self._covariance @ reads.T
        expected = reads @ crossed + noise * np.eye(len(seen))
        gain = np.swapaxes(np.linalg.solve(expected, np.swapaxes(crossed, 1, 2)), 1, 2)
        squared = squared_distance(innovation, expected)
        log_likelihood = -0.5 * (squared + np.linalg.slogdet(expected).logabsdet)
        weight = self._weight * np.exp(log_likelihood - log_likelihood.max())
        self._weight = weight / weight.sum()
        self._mean = self._mean + np.einsum("hjr,hr->hj", gain, innovation)
        left = np.eye(self._mean.shape[1]) - gain @ reads  # Joseph's form stays symmetric and positive for hours
        covariance = left @ self._covariance @ np.swapaxes(left, 1, 2) + noise * gain @ np.swapaxes(gain, 1, 2)
        self._covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return used

    def _mixture(self) -> ReferenceDrift:
        weight = self._weight
        common = float(weight @ self._mean[:, 0])
        variance = weight @ (self._covariance[:, 0, 0] + (self._mean[:, 0] - common) ** 2)
        own_rate = float(np.sqrt(weight @ self._own_rate**2)) if weight[self._own_rate > 0].sum() > 0.5 else 0.0
        parts = 1 + len(self.tendons)
        levels = self._mean[:, 1:parts]
        own = weight @ levels
        whole = self._reads @ np.einsum("h,hij->ij", weight, self._covariance) @ self._reads.T
        read = self._mean @ self._reads.T
        spread = weight @ (read - weight @ read) ** 2
        own_sigma = np.sqrt(np.maximum(np.diag(whole) + spread, 0))
        return ReferenceDrift(common, float(np.sqrt(variance)), own_rate, own, own_sigma)


class _Mean:
    """The running mean of readings, nan where there was none."""

    def __init__(self, count: int) -> None:
        self._sum = np.zeros(count)
        self._count = np.zeros(count)

    def clear(self, chosen: NDArray[np.bool_]) -> None:
        """Forget the readings of the (count,) chosen references."""
        self._sum[chosen] = self._count[chosen] = 0.0

    def add(self, value: NDArray[np.float64], counted: NDArray[np.bool_]) -> None:
        """Add one (count,) reading of each of the (count,) references that are counted."""
        self._sum += np.where(counted, value, 0.0)
        self._count += counted

    @property
    def value(self) -> NDArray[np.float64]:
        """(count,) the means."""
        return np.where(self._count > 0, self._sum / np.maximum(self._count, 1), np.nan)


def without_drift(frame: ResistanceFrame, common: float) -> ResistanceFrame:
    """Return the frame that would be read without the common drift."""
    return replace(frame, resistance_ohm=frame.resistance_ohm * np.exp(-common))


def drift_transition(parts: int, step_s: float, memory_s: float) -> NDArray[np.float64]:
    """Return the (2 parts, 2 parts) transition of drifts and then rates over a step, which keeps a share of a rate."""
    keep = np.exp(-step_s / memory_s)
    transition = np.eye(2 * parts)
    transition[parts:, parts:] *= keep
    transition[:parts, parts:] = np.eye(parts) * memory_s * (1 - keep)
    return transition


def drift_noise(step_s: float, memory_s: float) -> NDArray[np.float64]:
    """Return (2, 2) the covariance that a step adds to a drift and its rate, over the variance of the rate.

    The rate forgets itself within T, the memory, and has the same variance at all times; with x = t / T and
    k = exp(-x), what it adds within t is

        Q = [[T^2 (2 x - 3 + 4 k - k^2), T (1 - k)^2], [T (1 - k)^2, 1 - k^2]]
    """
    x = step_s / memory_s
    keep = np.exp(-x)
    level, both = memory_s**2 * (2 * x - 3 + 4 * keep - keep**2), memory_s * (1 - keep) ** 2
    return np.array([[max(level, 0.0), both], [both, 1 - keep**2]])


def _prior(rate: NDArray[np.float64], probability: float) -> NDArray[np.float64]:
    """Return the prior probability of each rate; those that are not zero share `probability`."""
    return np.where(rate > 0, probability / (len(RATES_PER_S) - 1), 1 - probability)
