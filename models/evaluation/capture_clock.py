"""The clock of a motion capture against the host's, from what of the motion no choice of axes changes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from ..values.errors import InputError

STEP_S = 0.05
"""Time step of the signals that are compared."""
LONGEST_MOTION_S = 10_000.0
"""Longest time of a motion from which a clock is found: signals of a day would take gigabytes."""
SMOOTH_S = 0.3
"""Standard deviation of the Gaussian that smooths them. In motion that is quicker an estimate is late, by the time
constants of its sensors of 0.1 to 0.3 s: without smoothing the offsets of three trials are 13 to 22 ms too large, with
it they are -1, 3 and 3 ms off."""
LAG_SIGMA_S = 0.025
"""Standard deviation of the lag of an estimate, which motion cannot tell from an offset. In batch it was -1, 3, 3 and
23 ms on anchored trials, and 19 ms on one of a robot that rolls; live it was 44 ms."""
BRIDGED_S = 0.5
"""Longest gap of a marker that is bridged before its motion is smoothed."""
PAIRS = 24
"""Most pairs of nodes that are used: those whose distances change most."""
APART_S = 0.5
"""Two offsets that differ by less are one."""
CLOCK_RATE = 1e-4
"""Standard deviation of the rate error of one quartz clock against another, before the motion is looked at."""
CLUSTER_S = 2.0
"""Residuals this far apart are taken as independent: presses, and the errors of an estimate with them, last so long."""
LEFT_OVER_WEIGHT = 2.0
"""Weight of what an offset leaves over: one that leaves more than a third of the motion over explains nothing."""
LEAST_EXPLAINED = 0.1
"""Least share of what some offset explains that the best explains: a few samples agree by chance."""
MISTAKEN = 5.0
"""Residual, in robust standard deviations, above which a signal is left out: a marker that was taken for another."""

NOTHING_IN_COMMON = "the capture and the estimate have no motion of a marker in common: give --offset"


@dataclass(frozen=True, slots=True)
class CaptureClock:
    """The capture's clock t on the host's: t + offset + rate (t - middle)."""

    offset_s: float
    """Host time minus capture time, at the middle of the common time."""
    offset_sigma_s: float
    """Standard deviation, with `LAG_SIGMA_S` for the lag of the estimate; 0 where the offset was given."""
    rate_ppm: float
    """How much faster the host's clock runs; 0 where the offset was given."""
    rate_sigma_ppm: float
    middle_s: float
    """Capture time at which the offset holds."""

    def host_s(self, capture_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the host's times at times of the capture."""
        return np.asarray(capture_s + self.offset_s + 1e-6 * self.rate_ppm * (capture_s - self.middle_s))


@dataclass(frozen=True, slots=True, eq=False)
class MotionSignals:
    """What of a motion no choice of axes changes, smoothed: distances between nodes, or the speeds of nodes."""

    t_s: NDArray[np.float64]
    """(times,) increasing by `STEP_S`, on the clock of the estimate or of the capture."""
    signal_m: NDArray[np.float64]
    """(times, signals) distances, or the ways of nodes in `SMOOTH_S`; nan where a node was hidden."""

    @classmethod
    def of_distances(
        cls, t_s: NDArray[np.float64], position_m: NDArray[np.float64], pairs: NDArray[np.int64]
    ) -> "MotionSignals":
        """Return the distances of (pairs, 2) pairs of points with (times, points, 3) positions."""
        difference_m = position_m[:, pairs[:, 0]] - position_m[:, pairs[:, 1]]
        return cls(*_smoothed(t_s, np.linalg.norm(difference_m, axis=-1)))

    @classmethod
    def of_speeds(cls, t_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> "MotionSignals":
        """Return the speeds of points with (times, points, 3) positions, each as the way in `SMOOTH_S`."""
        t_s, flat_m = _smoothed(t_s, position_m.reshape(len(t_s), -1))
        step_m = np.gradient(flat_m.reshape(len(t_s), -1, 3), axis=0)
        return cls(t_s, np.linalg.norm(step_m, axis=-1) * SMOOTH_S / STEP_S)


def _smoothed(t_s: NDArray[np.float64], value: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times in steps of `STEP_S` and series smoothed by `SMOOTH_S`; nan at the ends and in gaps.

    Raises:
        InputError: when the times do not last for two steps, or for more than `LONGEST_MOTION_S`.
    """
    lasts_s = float(t_s[-1] - t_s[0])
    if not STEP_S < lasts_s <= LONGEST_MOTION_S:
        bound = f"more than {STEP_S:g} s" if lasts_s <= STEP_S else f"at most {LONGEST_MOTION_S:g} s"
        lasts = f"got {lasts_s:.3g} s: are its times in seconds?"
        raise InputError(f"the clock is found from a motion of {bound}, {lasts}")
    even_s = np.arange(t_s[0], t_s[-1], STEP_S)
    sampled = np.stack([_bridged(even_s, t_s, column) for column in value.T], axis=1)
    width = SMOOTH_S / STEP_S
    return even_s, gaussian_filter1d(sampled, width, axis=0, mode="constant", cval=np.nan, truncate=2)


def _bridged(t_s: NDArray[np.float64], known_s: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a series at other times, by linear interpolation; nan outside and in gaps longer than `BRIDGED_S`."""
    known_s, value = known_s[np.isfinite(value)], value[np.isfinite(value)]
    if len(value) < 2:
        return np.full(len(t_s), np.nan)
    after = np.clip(np.searchsorted(known_s, t_s), 1, len(known_s) - 1)
    gap = known_s[after] - known_s[after - 1] > BRIDGED_S
    return np.where(gap, np.nan, np.interp(t_s, known_s, value, left=np.nan, right=np.nan))


@dataclass(frozen=True, slots=True)
class OffsetSearch:
    """How well offsets explain the motion."""

    offset_s: float
    """The offset that explains it best."""
    explained_m2: float
    """Sum of squares of the estimate's signals about their means that the capture explains at this offset."""
    unexplained_m2: float
    """Sum of squares that is left over at this offset."""
    other_offset_s: float
    """The offset that explains most of it `APART_S` or more away; nan where there is none."""
    other_explained_m2: float

    @property
    def unexplained_share(self) -> float:
        """Share of the motion that is left over at the best offset; all of it where nothing moves."""
        return self._left_over(self.explained_m2)

    @property
    def other_unexplained_share(self) -> float:
        """Share of the same motion that is left over at the next best offset."""
        return self._left_over(self.other_explained_m2)

    def _left_over(self, explained_m2: float) -> float:
        motion_m2 = self.explained_m2 + self.unexplained_m2
        return max(1 - max(explained_m2, 0.0) / motion_m2, 0.0) if motion_m2 > 0 else 1.0

    @property
    def is_clear(self) -> bool:
        """Whether the next best offset would leave over twice as much or more."""
        return self.explained_m2 - max(self.other_explained_m2, 0.0) > self.unexplained_m2


def moving_pairs(position_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (pairs, 2) pairs of nodes whose distances change most over (frames, nodes, 3), at most `PAIRS`."""
    first, second = np.triu_indices(position_m.shape[1], 1)
    distance_m = np.linalg.norm(position_m[:, first] - position_m[:, second], axis=-1)
    chosen = np.sort(np.argsort(distance_m.std(axis=0))[::-1][:PAIRS])
    return np.stack([first, second], axis=1)[chosen]


def search_offset(estimated: MotionSignals, captured: MotionSignals) -> OffsetSearch:
    """Return the offset at which the captured motion m explains most of the estimated motion e, and leaves little over.

    At each lag, over the time that both cover, m explains sum (e - mean e)^2 - sum (e - m - mean (e - m))^2 =
    2 S_em - S_mm, with S the sums of products about the means, and leaves S_ee - 2 S_em + S_mm over. A lag at which
    little is in common, or both are still, explains little. What is left over is taken off `LEFT_OVER_WEIGHT` times: a
    capture that ends in a press would explain more of the estimate if it were later, but not well. Where every lag
    leaves too much over, the one that explains most is the best.
    """
    e, m = estimated.signal_m, captured.signal_m
    s_em, s_mm, s_ee = _products_about_means(_about_mean(e), _about_mean(m))
    explained = 2 * s_em - s_mm
    offsets_s = estimated.t_s[0] - captured.t_s[0] + STEP_S * (np.arange(len(explained)) - len(m) + 1)
    score = explained - LEFT_OVER_WEIGHT * (s_ee - explained)
    score[explained < LEAST_EXPLAINED * explained.max()] = -np.inf
    best = int(np.argmax(score if score.max() > 0 else explained))
    peaks = 1 + np.flatnonzero((explained[1:-1] > explained[:-2]) & (explained[1:-1] > explained[2:]))
    others = peaks[np.abs(offsets_s[peaks] - offsets_s[best]) >= APART_S]
    other = others[np.argmax(explained[others])] if len(others) else None
    return OffsetSearch(
        offset_s=float(offsets_s[best]),
        explained_m2=float(explained[best]),
        unexplained_m2=float(s_ee[best] - explained[best]),
        other_offset_s=np.nan if other is None else float(offsets_s[other]),
        other_explained_m2=0.0 if other is None else float(explained[other]),
    )


def _about_mean(signal_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (times, signals) minus the mean of what is known of each signal, of which there may be nothing."""
    known = np.isfinite(signal_m)
    return np.asarray(signal_m - np.where(known, signal_m, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def _products_about_means(
    e: NDArray[np.float64], m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return S_em, S_mm and S_ee at every lag from 1 - len(m) to len(e) - 1, summed over signals; nan is left out."""
    size = len(e) + len(m) - 1
    known_e, known_m = np.isfinite(e), np.isfinite(m)
    e, m = np.where(known_e, e, 0.0), np.where(known_m, m, 0.0)
    spectra_e = [np.fft.rfft(x, size, axis=0) for x in (known_e, e, e**2)]
    spectra_m = [np.fft.rfft(x[::-1], size, axis=0) for x in (known_m, m, m**2)]

    def over_lags(power_e: int, power_m: int) -> NDArray[np.float64]:
        return np.asarray(np.fft.irfft(spectra_e[power_e] * spectra_m[power_m], size, axis=0))

    count = np.maximum(over_lags(0, 0), 1.0)
    sum_e, sum_m = over_lags(1, 0), over_lags(0, 1)
    s_em = over_lags(1, 1) - sum_e * sum_m / count
    s_mm = over_lags(0, 2) - sum_m**2 / count
    s_ee = over_lags(2, 0) - sum_e**2 / count
    return s_em.sum(axis=1), s_mm.sum(axis=1), s_ee.sum(axis=1)


class ClockFit:
    """Least squares of the captured motion m on the estimated one e at the same instants, r = m(t) - e(host(t)) - bias.

    The bias of each signal, by how markers sit on nodes, is its mean residual.

    Args:
        estimated: signals of the estimate.
        captured: the same signals of the capture.
        offset_s: first guess of the offset.

    Raises:
        InputError: when they have no time in common.
    """

    def __init__(self, estimated: MotionSignals, captured: MotionSignals, offset_s: float) -> None:
        known = np.isfinite(estimated.signal_m).all(axis=1)
        self._frame_s = estimated.t_s[known]
        self._signal = CubicSpline(self._frame_s, estimated.signal_m[known])
        self._slope = self._signal.derivative()
        self._captured = captured
        common_s = captured.t_s[self._covered(captured.t_s + offset_s)]
        if not len(common_s):
            raise InputError(NOTHING_IN_COMMON)
        self.middle_s = float(common_s.mean())
        self.start = np.array([offset_s, 0.0])

    def rows(self, clock: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (times, signals) residuals and (times, signals, 2) derivatives by offset and rate; nan where unknown.

        Args:
            clock: offset in s and rate, a pure number.
        """
        capture_s = self._captured.t_s
        after_s = capture_s - self.middle_s
        host_s = capture_s + clock[0] + clock[1] * after_s
        covered = self._covered(host_s)[:, None] & np.isfinite(self._captured.signal_m)
        residual = np.where(covered, self._captured.signal_m - self._signal(host_s), np.nan)
        slope_m_per_s = np.where(covered, -self._slope(host_s), np.nan)
        jacobian = slope_m_per_s[..., None] * np.stack([np.ones_like(after_s), after_s], axis=-1)[:, None]
        return residual, jacobian

    def solve(self) -> CaptureClock:
        """Return the clock with its standard deviations, by Gauss-Newton on the offset, then on offset and rate.

        Raises:
            InputError: when the motion that both have does not tell offset and rate.
        """
        x = self.start
        for free in (1, 1, 1, 2, 2, 2, 2):
            residual, jacobian = self._inliers(x)
            r, j = np.nan_to_num(residual).ravel(), np.nan_to_num(jacobian).reshape(-1, 2)
            information = j.T @ j
            if np.linalg.matrix_rank(information) < 2:
                raise InputError("the capture and the estimate have too little motion in common: give --offset")
            x = x.copy()
            x[:free] -= np.linalg.solve(information[:free, :free], j[:, :free].T @ r)
        block = ((self._captured.t_s - self._captured.t_s[0]) / CLUSTER_S).astype(np.int64)
        return self._with_prior(x, clustered_covariance(residual, jacobian, block))

    def _inliers(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals without bias and their derivatives, of signals that both have; outliers are nan."""
        residual, jacobian = _of_known(*self.rows(x))
        residual = residual - np.nanmedian(residual, axis=0)
        outlier = np.abs(residual) > MISTAKEN * 1.4826 * np.nanmedian(np.abs(residual))
        residual = np.where(outlier, np.nan, residual)
        jacobian = np.where(outlier[..., None], np.nan, jacobian)
        residual, jacobian = _of_known(residual, jacobian)
        return residual - np.nanmean(residual, axis=0), jacobian - np.nanmean(jacobian, axis=0)

    def _with_prior(self, x: NDArray[np.float64], covariance: NDArray[np.float64]) -> CaptureClock:
        """Return the clock after the prior of its rate, a Kalman update with a rate of zero, sigma `CLOCK_RATE`."""
        gain = covariance[:, 1] / (covariance[1, 1] + CLOCK_RATE**2)
        x = x - gain * x[1]
        covariance = covariance - np.outer(gain, covariance[1])
        offset_sigma_s = float(np.sqrt(covariance[0, 0] + LAG_SIGMA_S**2))
        rate_sigma_ppm = float(1e6 * np.sqrt(covariance[1, 1]))
        return CaptureClock(float(x[0]), offset_sigma_s, float(1e6 * x[1]), rate_sigma_ppm, self.middle_s)

    def _covered(self, host_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which times are within the frames, and not in a gap of theirs."""
        frame_s = self._frame_s
        after = np.clip(np.searchsorted(frame_s, host_s), 1, len(frame_s) - 1)
        inside = (host_s >= frame_s[0]) & (host_s <= frame_s[-1])
        return np.asarray(inside & (frame_s[after] - frame_s[after - 1] < 2 * STEP_S))


def _of_known(
    residual: NDArray[np.float64], jacobian: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the residuals of the signals that are known at any time, and their derivatives.

    Raises:
        InputError: when none is.
    """
    known = np.isfinite(residual).any(axis=0)
    if not known.any():
        raise InputError(NOTHING_IN_COMMON)
    return residual[:, known], jacobian[:, known]


def clustered_covariance(
    residual: NDArray[np.float64], jacobian: NDArray[np.float64], block: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the covariance H^-1 (sum g g^T) H^-1 of least squares with residuals alike in a block and in a signal.

    H = J^T J, and g = J^T r of each block of time and of each signal (Liang and Zeger, Biometrika
    73, 1986, in two ways).

    Args:
        residual: (times, signals) nan where unknown.
        jacobian: (times, signals, unknowns)
        block: (times,) number of the block of each time, from 0.
    """
    product = np.nan_to_num(residual[..., None] * jacobian)
    jacobian = np.where(np.isfinite(residual)[..., None], jacobian, 0.0)
    inverse = np.linalg.inv(np.einsum("tpi,tpj->ij", jacobian, jacobian))
    of_block = np.zeros((int(block.max()) + 1, jacobian.shape[-1]))
    np.add.at(of_block, block, product.sum(axis=1))
    of_signal = product.sum(axis=0)
    return np.asarray(inverse @ (of_block.T @ of_block + of_signal.T @ of_signal) @ inverse)
