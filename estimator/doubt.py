"""The doubt about the model: whether the readings of the last seconds fit it, and which other explanation fits better.

Two explanations are compared with the model, each as regimes of a hidden Markov model that last for some seconds:

- Many nodes are loaded at once (hands that hug, wind, inertia), in place of a few. In the model a few nodes have a load
  of sigma_L and all others balance to sigma_q; with many, all nodes have loads of one of several strengths.
- All lengths are k times less exact than their sigmas say (k = 1 in the model; below 1 they are more exact).

A regime i says which variances the balance of forces and the lengths have. Its evidence in one frame is, with the
factors linearised at the estimate x, H_i the Hessian of all factors, H_i0 that without the lengths, and E_i, E_i0 the
errors at their minima,

    log p_i = -(E_i - E_i0) - 1/2 (log |H_i| - log |H_i0|) - sum log k

which is the probability of the lengths, given what forces and shape prior say of the shape. Errors of the lengths last
for seconds, so that the evidence counts once in `correlation_s`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from ..models.estimation import DoubtSettings
from ..models.structure.shape import Reason
from ..models.values.readings import Flag, TendonLengths
from ..models.values.stamps import is_due
from ..models.values.time_series import Regimes, any_before
from .graph import GraphBuilder
from .linear_frame import LinearFrame

FEW = 6
"""Number of explanations by a few loads: by none, by the node with the largest unbalanced force, by the two with ..."""
OVER_QUIET = np.array([1.0, 10 / 3, 20 / 3, 40 / 3])
"""Standard deviations of the loads, when many nodes are loaded, over that of the balance without any (`quiet_n`)."""
SCALES = np.array([0.4, 0.55, 0.75, 1.0, 2.0, 4.0, 8.0, 16.0])
"""The factors k by which the sigmas of all lengths may be wrong."""
EXACT = SCALES <= 1
"""Which of them mean that the lengths are as exact as their sigmas say, or more."""
SHARE_OF_EXACT = np.array([0.05, 0.1, 0.25, 0.6])
"""The prior shares of these: without evidence the root mean square of k is 0.88."""
LEAST_WEIGHED = 0.8
"""Least factor of the sigmas with which lengths are weighed against forces. With 1, slack structures are 10 % further
off. Without a limit pressed ones are, because then the forces, too, are more exact than their sigma says."""
WEIGHED = np.maximum(SCALES, LEAST_WEIGHED)
"""The factors k as far as lengths are weighed by them."""
PER_SQUARE = WEIGHED**-2
"""1 / k^2 of these."""
WIDEST_M = 1.0
"""Standard deviation of the shape prior in the comparison, where the graph has none."""
SHAKEN = int(Flag.SHAKEN)
SHAKEN_SHARE = 0.4
"""Share of the tendons with the flag `SHAKEN`, above which the whole robot is shaken."""
STILL_SHARE = 0.1
"""Share below which it is shaken no more."""
SEEN_AFTER_S = 0.8
"""Time after which shaking is seen at the latest: sensors lag, and the mean square of their swings too."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """What the readings say against the model, at one time."""

    many_loads: float = 0.0
    """Probability that many nodes are loaded at once."""
    many_loads_n: float = 0.0
    """Standard deviation of these loads."""
    length_scale: float = 1.0
    """Factor of the sigmas of all lengths: one over the root mean square of 1 / k, with the k of `WEIGHED`."""
    inexact: float = 0.0
    """Probability that the lengths are less exact than their sigmas say."""
    reason: Reason | None = None
    """The explanation that is more probable than the model; None when there is none."""
    error_scale: float = 1.0
    """Factor of the errors of a frame over what its covariance says, if the lengths are as exact as their sigmas say or
    more: the root mean square of k, over what such lengths are weighed by. It is 1 where there is a reason to doubt, or
    no balance of forces with which lengths agree."""


class ModelDoubt:
    """Follows the doubt about the model, frame by frame."""

    def __init__(self, builder: GraphBuilder, settings: DoubtSettings) -> None:
        self._builder = builder
        self._settings = settings
        self._loads = Regimes(np.array([1 - settings.many_share, settings.many_share]), settings.many_memory_s)
        prior = np.full(len(SCALES), settings.inexact_share / np.sum(~EXACT))
        prior[EXACT] = (1 - settings.inexact_share) * SHARE_OF_EXACT
        self._scale = Regimes(prior, settings.inexact_memory_s)
        self._updated_s = np.nan
        self._shaken = False
        self.kept: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] | None = None
        """Time and probabilities after each update, for a smoother that puts a list here; live, memory is bounded."""
        self._forgotten: list[int] = []
        """Numbers of kept updates before which hands took the robot, and loads were forgotten."""

    def see(self, lengths: TendonLengths) -> None:
        """Take note of whether the robot is shaken in one more frame."""
        self._shaken = self._is_shaken(lengths, self._shaken)

    def forget_loads(self) -> None:
        """Take note that hands have just taken the robot: they loaded none of its nodes before.

        Whether they have let it go is not known.
        """
        self._loads.forget()
        if self.kept is not None:
            self._forgotten.append(len(self.kept))

    @property
    def present(self) -> Doubt:
        """The doubt about the newest frame."""
        return self._doubt(self._shaken, self._loads.probability, self._scale.probability)

    def observe(self, t_s: float, frame: LinearFrame, used_scale: float) -> None:
        """Learn from a frame.

        Args:
            t_s: its time.
            frame: its factors, linearised at the estimate.
            used_scale: factor by which the sigmas of the measured lengths were multiplied in the frame.
        """
        statics = self._builder.statics
        step_s = t_s - self._updated_s if np.isfinite(self._updated_s) else self._settings.update_every_s
        if statics is None or not is_due(step_s, self._settings.update_every_s):
            return
        self._updated_s = t_s
        self._loads.predict(step_s)
        self._scale.predict(step_s)
        share = evidence_share(self._builder, frame, step_s)
        if share > 0:
            self._update(frame, used_scale, share)
        if self.kept is not None:
            self.kept.append((t_s, self._loads.probability, self._scale.probability))

    def smoothed(self, frames: Sequence[TendonLengths]) -> list[Doubt]:
        """Return the doubt about each frame, given all updates that were kept, later ones too."""
        times_s = np.array([lengths.t_s for lengths in frames])
        shaken = self._shaken_in(frames, times_s)
        if not self.kept:
            return [self._doubt(bool(shakes), self._loads.probability, self._scale.probability) for shakes in shaken]
        t_s = np.array([update[0] for update in self.kept])
        loads = np.array([update[1] for update in self.kept])
        stretches = [slice(*ends) for ends in pairwise([0, *self._forgotten, len(t_s)])]
        loads = np.concatenate([self._loads.smoothed(t_s[stretch], loads[stretch]) for stretch in stretches])
        scales = self._scale.smoothed(t_s, np.array([update[2] for update in self.kept]))
        latest = np.maximum(np.searchsorted(t_s, times_s, side="right") - 1, 0)
        return [self._doubt(bool(shakes), loads[k], scales[k]) for shakes, k in zip(shaken, latest, strict=True)]

    def _shaken_in(self, frames: Sequence[TendonLengths], times_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the robot is shaken in each frame, as the frames until `SEEN_AFTER_S` later tell."""
        seen = list(accumulate(frames, lambda before, lengths: self._is_shaken(lengths, before), initial=False))
        return any_before(np.array(seen[1:]), np.searchsorted(times_s, times_s + SEEN_AFTER_S, side="right"))

    def _is_shaken(self, lengths: TendonLengths, before: bool) -> bool:
        swings = lengths.flags[self._builder.structure.free_tendons] & SHAKEN
        return int(np.count_nonzero(swings)) > (STILL_SHARE if before else SHAKEN_SHARE) * len(swings)

    def _doubt(self, shaken: bool, loads: NDArray[np.float64], scales: NDArray[np.float64]) -> Doubt:
        many_loads = float(loads[1])
        many_loads_n = self._settings.many_loads_n
        inexact = float(scales[~EXACT].sum())
        length_scale, error_scale = float(1 / np.sqrt(scales @ PER_SQUARE)), 1.0
        reason = None
        if shaken:  # inertia loads every node
            many_loads = 1.0
            many_loads_n = self._settings.shaken_n
            reason = Reason.MOTION
        elif inexact > 0.5:
            reason = Reason.SENSORS
        elif many_loads > 0.5:
            reason = Reason.LOADS
        elif self._builder.rest.is_doubted:
            reason = Reason.GEOMETRY
        if reason is not None:  # then the readings are no evidence that lengths are more exact than their sigmas say
            length_scale = max(length_scale, 1.0)
        elif self._builder.statics is not None:
            exact = scales[EXACT] / scales[EXACT].sum()
            error_scale = min(float(np.sqrt((exact @ SCALES[EXACT] ** 2) * (exact @ PER_SQUARE[EXACT]))), 1.0)
        return Doubt(many_loads, many_loads_n, length_scale, inexact, reason, error_scale)

    def _update(self, frame: LinearFrame, used_scale: float, share: float) -> None:
        few, log_prior = self._few_loads(frame)
        many = np.maximum(few[0], (self._settings.quiet_n * OVER_QUIET[:, None]) ** 2)
        variance = np.concatenate([few, many])
        rods = len(self._builder.structure.rods)
        scale = WEIGHED[[np.argmax(self._scale.probability)]] / used_scale
        evidence = log_evidence(frame, rods, variance, scale)
        evidence += np.concatenate([log_prior, np.full(len(many), -np.log(len(many)))])
        of_few, of_many = np.split(evidence, [len(few)])
        self._loads.update(share * np.array([np.logaddexp.reduce(of_few), np.logaddexp.reduce(of_many)]))
        best = variance[[np.argmax(evidence)]]
        evidence = log_evidence(frame, rods, best, SCALES / used_scale)
        self._scale.update(share * evidence)

    def _few_loads(self, frame: LinearFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (choices, rows) variances of the balance with a few loads, and (choices,) the log of their prior.

        The last choice is a load at the node with the smallest unbalanced force. It stands for all choices that are
        not listed, with what is left of the prior: lengths that say little of loads are then no evidence for many.
        """
        statics = self._builder.statics
        assert statics is not None, "loads need the balance of forces"
        settings = self._settings
        quiet_n = np.sqrt(frame.force_sigma_n**2 - self._builder.noise.force_n**2 + settings.quiet_n**2)
        squared = np.add.reduceat(frame.force_n**2, statics.group_start)
        rank = np.argsort(np.argsort(-squared))[statics.group]
        loads = np.arange(min(FEW, len(squared) + 1))
        largest = rank < loads[:, None]
        least = rank == len(squared) - 1
        variance = np.where(np.concatenate([largest, least[None]]), settings.load_n**2, quiet_n**2)
        share = settings.loaded_share
        log_prior = loads * np.log(share) + (len(squared) - loads) * np.log1p(-share)
        left = max(1 - np.exp(log_prior).sum(), np.finfo(np.float64).tiny)  # none where a single node can be loaded
        return variance, np.append(log_prior, np.log(left))


def evidence_share(builder: GraphBuilder, frame: LinearFrame, step_s: float) -> float:
    """Return how much the evidence of a frame counts: by the share of lengths that are read, once in `correlation_s`.

    Args:
        builder: of the frame.
        frame: its factors.
        step_s: time since the last frame whose evidence was counted.
    """
    of_tendons = frame.weight_per_m[len(builder.structure.rods) :] > 0
    measured = float(of_tendons.mean()) if len(of_tendons) else 0.0
    return measured * min(step_s / builder.noise.correlation_s, 1.0)


def log_evidence(
    frame: LinearFrame, rods: int, force_variance: NDArray[np.float64], length_scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (regimes,) the log evidence of a frame's lengths in several regimes, up to a common constant.

    Args:
        frame: the factors of the frame.
        rods: number of the rods, with which the members begin; their sigma is the same in all regimes.
        force_variance: (regimes, rows) variance of each row of the balance of forces, or (1, rows) that of all regimes.
        length_scale: (regimes,) factor of the sigma of the measured lengths, or (1,) that of all regimes.
    """
    prior_m = min(frame.prior_m, WIDEST_M)  # without any prior, forces alone leave some motion free
    prior = np.eye(len(frame.from_prior_m)) / prior_m**2
    weighted = frame.force_jacobian / force_variance[:, :, None]
    without = np.swapaxes(weighted, 1, 2) @ frame.force_jacobian + prior
    slope_without = (frame.force_n / force_variance) @ frame.force_jacobian + frame.from_prior_m / prior_m**2
    if len(frame.own_error):
        own_information, own_gradient = frame.own
        without += own_information
        slope_without += own_gradient
    error, jacobian = frame.weighted_lengths
    weight = np.ones((len(length_scale), len(error)))
    weight[:, rods:] /= length_scale[:, None]
    error = error * weight
    jacobian = jacobian * weight[:, :, None]
    information = without + np.swapaxes(jacobian, 1, 2) @ jacobian
    slope = slope_without + (error[:, None] @ jacobian)[:, 0]
    gain, log_root = _at_minimum(np.concatenate([information, without]), np.concatenate([slope, slope_without]))
    regimes = len(information)
    measured = int(np.sum(frame.weight_per_m[rods:] > 0))
    least = 0.5 * np.sum(error**2, axis=1) - gain[:regimes] + gain[regimes:]
    return np.asarray(-least - log_root[:regimes] + log_root[regimes:] - measured * np.log(length_scale))


def _at_minimum(
    information: NDArray[np.float64], gradient: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (n,) by how much errors are less at their minima, and (n,) the logs of the roots of |H|.

    The lower Cholesky factor of H, bordered by g, has L^-1 g in its last row, and g^T H^-1 g is the square of that.

    Args:
        information: (n, free, free) H, whose eigenvalues are 1 / `WIDEST_M`^2 or more.
        gradient: (n, free) g.
    """
    size = gradient.shape[-1]
    bordered = np.empty((len(gradient), size + 1, size + 1))
    bordered[:, :size, :size] = information
    bordered[:, size, :size] = bordered[:, :size, size] = gradient
    bordered[:, size, size] = 1 + 2 * WIDEST_M**2 * np.sum(gradient**2, axis=1)  # more than g^T H^-1 g
    root = np.linalg.cholesky(bordered)
    gain = 0.5 * np.sum(root[:, size, :size] ** 2, axis=1)
    return gain, np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)[:, :size]), axis=1)
