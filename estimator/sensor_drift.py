"""The drift of each sensor by itself: unknowns that rods and the balance of forces determine.

They are estimated once reference tendons show that sensors drift apart, or the lengths contradict each other. The
errors d of log resistance follow the model of `models.sensor.reference_drift`: their rates are stationary with sigma
s_o and forgotten slowly. The common drift, which a few references tell, is subtracted from all readings before; of
what remains, the rates have the covariance

    Cov(d'_e, d'_f) = s_o^2 (delta_ef + 1 / references)

The factors of one frame, with its shape eliminated, say of the errors b = h d of the lengths (h metres per dR/R)

    Lambda = W - W J (J^T W J + I)^-1 J^T W,     u = Lambda (b - b_used) at the minimum over shapes

where I is the information of rods, shape prior and forces. Frames in which some node is certainly loaded are not used:
there, errors of the sensor model and of the loads last as long as the load, and look like drift. The error of a length
lasts for `correlation_s`, and this much time counts as one frame. Live this is a Kalman filter, in batch its smoother.
That also has the evidence of the frames in which sensors were not yet known to drift apart.

The drifts of sensors have nothing to do with the board that reads them. Where those of one board differ from the others
in the mean by more than `BOARD_SIGMA` of what they differ by among themselves, it is the board that has changed, and
the estimated drifts are wrong.

Lengths that contradict each other may do so for another reason, as that a tendon has snapped. A drift explains them at
once: where they still contradict each other `EXPLAINS_WITHIN_S` after it was admitted, it is none, and is forgotten.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..factors.noise import WeightedLengths, tendon_sigma_m
from ..models.sensor.reference_drift import DriftSettings, drift_noise, drift_transition
from ..models.structure.shape import Shape
from ..models.values.readings import SensorDrift, TendonLengths
from .graph import GraphBuilder
from .linear_frame import linearised

LOADED = 2.0
"""Load over the standard deviation of the balance of forces above which a node is loaded, if that is certain."""
CONTRADICTED_RATE_PER_S = 5e-4
"""Sigma of the sensors' own rates when their lengths contradict each other: 1.8 % in a minute."""
CONTRADICTED = 0.2
"""Probability that the lengths are less exact than their sigmas say, above which sensors may drift apart."""
STILL_CONTRADICTED = 0.5
"""The same, above which the drift that was admitted for this does not explain them."""
EXPLAINS_WITHIN_S = 1.0
"""Time after which it has to: with drifts of the twin the probability is below 0.05 after a second, with a tendon that
has snapped above 0.7."""
BOARD_SIGMA = 5.0
"""Difference of the drifts of one board to those of the others, in standard deviations, from which the board changed:
1.5 at most in trials in which each sensor drifts by its own 3 %, 6 to 9 where the reference of one board sags."""

FEWEST_OF_A_BOARD = 6
"""Number of sensors on a board, and on all others, from which their drifts tell how much sensors differ."""


@dataclass(frozen=True, slots=True, eq=False)
class DriftState:
    """The drift of each sensor by itself and its rate, at one time."""

    t_s: float
    mean: NDArray[np.float64]
    """(2 tendons,) dR/R, then 1/s."""
    covariance: NDArray[np.float64]
    """(2 tendons, 2 tendons)"""

    def corrected(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths without this drift; its uncertainty is added to their sigma."""
        drift, count = lengths.drift, len(lengths.length_m)
        assert drift is not None, "own drift needs resistances"
        h, level, covariance = drift.of_length_m, self.mean[:count], self.covariance[:count, :count]
        covariance_m2 = h[:, None] * covariance * h
        own_variance = np.diag(covariance)
        share = np.where(drift.per_change_m > 0, drift.stretched_share, 0.0)
        modes = lengths.modes
        if modes is not None:  # drift is that of the reading as a stretched tendon
            stretched_m, bent_m = drift.per_change_m, np.zeros(count)
            length_m = modes.length_m - np.stack([stretched_m * level, bent_m])
            sigma_m = np.hypot(modes.sigma_m, np.stack([stretched_m * np.sqrt(own_variance), bent_m]))
            modes = replace(modes, length_m=length_m, sigma_m=sigma_m)
        return replace(
            lengths,
            modes=modes,
            length_m=lengths.length_m - h * level,
            sigma_m=np.sqrt(lengths.sigma_m**2 + np.diag(covariance_m2)),
            drift=replace(
                drift,
                change=drift.change + share * level,
                sigma=np.sqrt(drift.sigma**2 + share**2 * own_variance),
                covariance_m2=covariance_m2,
            ),
        )

    def earlier(self, t_s: float, first_s: float) -> "DriftState":
        """Return the drift at a time since `first_s`, when it was zero, if it grew evenly."""
        share = (t_s - first_s) / (self.t_s - first_s)
        scale = np.repeat([share, 1.0], len(self.mean) // 2)
        return DriftState(t_s, scale * self.mean, scale[:, None] * self.covariance * scale)


def is_of_a_board(drift: SensorDrift | None) -> bool:
    """Return whether the sensors of one board have drifted otherwise than all others, as far as each has its own."""
    if drift is None or drift.covariance_m2 is None or drift.board is None:
        return False
    known = np.isfinite(drift.change) & (drift.board >= 0)
    for board in range(drift.board.max() + 1):
        groups = [known & (drift.board == board), known & (drift.board != board)]
        if min(group.sum() for group in groups) < FEWEST_OF_A_BOARD:
            continue
        (one, of_one), (others, of_others) = (_mean_and_variance(drift, group) for group in groups)
        if (one - others) ** 2 > BOARD_SIGMA**2 * (of_one + of_others):
            return True
    return False


def _mean_and_variance(drift: SensorDrift, group: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean drift of (tendons,) some sensors, and its variance if they drift by themselves."""
    change, sigma = drift.change[group], drift.sigma[group]
    return float(change.mean()), float((np.var(change, ddof=1) + np.mean(sigma**2)) / len(change))


@dataclass(frozen=True, slots=True, eq=False)
class DriftUpdate:
    """One step of the filter, as the smoother needs it."""

    predicted: DriftState
    transition: NDArray[np.float64]
    """(2 tendons, 2 tendons) from the update before."""
    state: DriftState


_Evidence = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lambda and u of a frame, both of dR/R."""


class OwnDrift:
    """Estimates each sensor's own drift, frame by frame."""

    def __init__(self, builder: GraphBuilder, settings: DriftSettings) -> None:
        self._builder, self._settings = builder, settings
        self._count = len(builder.structure.tendons)
        self._rate_variance = 0.0
        self._least_rate_per_s = 0.0
        self._first_s = np.nan
        self._state: DriftState | None = None
        self._prediction: tuple[DriftState, NDArray[np.float64]] | None = None
        self._updated_s = np.nan
        self._judged_s = np.inf
        self._may_be_drift = True
        self._before: list[tuple[float, _Evidence | None]] = []  # at no drift; None where some node is loaded
        self._looked_s = np.nan
        self.begins = False
        """Whether the latest frame is the first that shows that sensors drift apart."""
        self.kept: list[DriftUpdate] | None = None
        """Every update, for a smoother that puts a list here; live, memory is bounded. Once sensors drift apart, those
        of the frames before are in it, too."""

    def admit(self, lengths: TendonLengths, inexact: float | None = 0.0) -> TendonLengths:
        """Return the lengths without the drift as estimated so far; unchanged while sensors do not drift apart.

        Args:
            lengths: of one frame.
            inexact: probability that the lengths contradict each other by more than their sigma; None where it is not
                known. If they do, sensors may drift apart although the references, by chance, do not.
        """
        if np.isnan(self._first_s):
            self._first_s = self._looked_s = lengths.t_s
        drift = lengths.drift
        self._prediction = None
        self.begins = False
        if drift is None or self._builder.statics is None:
            return lengths
        if inexact is not None:
            self._judge(lengths.t_s, inexact, drift.own_rate_per_s)
        rate_per_s = max(drift.own_rate_per_s, self._least_rate_per_s)
        self.begins = self._state is None and rate_per_s > 0
        if self._state is None and not self.begins:
            return lengths
        if self._before:
            self._begin_at_start(rate_per_s**2, drift.references)
        self._widen(lengths.t_s, rate_per_s**2, drift.references)
        assert self._state is not None
        step_s = lengths.t_s - self._state.t_s
        if np.isnan(self._updated_s) or step_s >= self._settings.update_every_s:
            self._prediction = self._predicted(lengths.t_s, rate_per_s**2, drift.references)
            self._state = self._prediction[0]
        return self._state.corrected(lengths)

    def observe(self, shape: Shape) -> None:
        """Learn from a frame whose lengths were admitted, unless some node is loaded."""
        if self._prediction is None:
            self._keep_evidence(shape)
            return
        self._learn(*self._prediction, self._evidence(shape))

    def _judge(self, t_s: float, inexact: float, own_rate_per_s: float) -> None:
        """Decide whether a drift is to explain that lengths contradict each other, and whether it has.

        Args:
            t_s: time of the frame.
            inexact: probability that they do.
            own_rate_per_s: what references tell of the sensors' own rates.
        """
        if self._may_be_drift and not self._least_rate_per_s and inexact > CONTRADICTED:
            self._least_rate_per_s = CONTRADICTED_RATE_PER_S
            self._judged_s = t_s + EXPLAINS_WITHIN_S
        elif t_s >= self._judged_s:
            self._judged_s = np.inf
            if inexact > STILL_CONTRADICTED and not own_rate_per_s:
                self._forget()

    def _forget(self) -> None:
        """Forget the drift, in the frames before, too: it is none."""
        self._may_be_drift = False
        self._least_rate_per_s = self._rate_variance = 0.0
        self._state = None
        if self.kept is not None:
            self.kept = []

    def _keep_evidence(self, shape: Shape) -> None:
        """Keep, for a smoother, what a frame says of drift while sensors are not known to drift apart."""
        if self.kept is None or self._state is not None:
            return
        if self._builder.statics is None or shape.lengths.drift is None:
            return
        if shape.t_s - self._looked_s >= self._settings.update_every_s:
            self._looked_s = shape.t_s
            self._before.append((shape.t_s, self._evidence(shape)))

    def _begin_at_start(self, rate_variance: float, references: int) -> None:
        """Begin with no drift in the first frame, and learn from the frames since then, whose evidence was kept.

        Sensors that begin to drift apart after a while do so at any rate, whatever it was until then.
        """
        self._widen(self._first_s, rate_variance, references)
        for t_s, evidence in self._before:
            predicted, transition = self._predicted(t_s, rate_variance, references)
            if evidence is not None:
                information, at_no_drift = evidence
                evidence = information, at_no_drift - information @ predicted.mean[: self._count]
            self._learn(predicted, transition, evidence)
        self._before = []
        assert self._state is not None
        any_rate = np.kron(np.diag([0.0, rate_variance]), _between_sensors(self._count, references))
        self._state = replace(self._state, covariance=self._state.covariance + any_rate)

    def _learn(self, predicted: DriftState, transition: NDArray[np.float64], evidence: _Evidence | None) -> None:
        """Take the state that the evidence of a frame makes of the predicted one."""
        self._state = predicted if evidence is None else self._updated(predicted, *evidence)
        self._updated_s = predicted.t_s
        if self.kept is not None:
            self.kept.append(DriftUpdate(predicted, transition, self._state))

    def _updated(
        self, predicted: DriftState, information: NDArray[np.float64], gradient: NDArray[np.float64]
    ) -> DriftState:
        """Return the state that the evidence of a frame makes of the predicted one."""
        since_s = self._settings.update_every_s if np.isnan(self._updated_s) else predicted.t_s - self._updated_s
        share = min(since_s / self._builder.noise.correlation_s, 1.0)
        n = self._count
        crossed = predicted.covariance[:, :n]
        inner = np.eye(n) + share * information @ predicted.covariance[:n, :n]
        solved = np.linalg.solve(inner, share * np.column_stack([information @ crossed.T, gradient]))
        covariance = predicted.covariance - crossed @ solved[:, :-1]
        mean = predicted.mean + crossed @ solved[:, -1]
        return DriftState(predicted.t_s, mean, 0.5 * (covariance + covariance.T))

    def _widen(self, t_s: float, rate_variance: float, references: int) -> None:
        """Add the covariance that the drift would have if the larger rate had been known from the start."""
        more = rate_variance - self._rate_variance
        if self._state is None:
            self._state = DriftState(t_s, np.zeros(2 * self._count), np.zeros((2 * self._count,) * 2))
        if more > 0:
            since_s = t_s - self._first_s
            memory_s = self._settings.memory_s
            moved_s = memory_s * (1 - np.exp(-since_s / memory_s))
            in_time = np.array([[2 * memory_s * (since_s - moved_s), moved_s], [moved_s, 1.0]])
            added = more * np.kron(in_time, _between_sensors(self._count, references))
            self._state = replace(self._state, covariance=self._state.covariance + added)
            self._rate_variance = rate_variance

    def _predicted(self, t_s: float, rate_variance: float, references: int) -> tuple[DriftState, NDArray[np.float64]]:
        assert self._state is not None
        n = self._count
        step_s, memory_s = t_s - self._state.t_s, self._settings.memory_s
        transition = drift_transition(n, step_s, memory_s)
        covariance = transition @ self._state.covariance @ transition.T
        covariance += rate_variance * np.kron(drift_noise(step_s, memory_s), _between_sensors(n, references))
        return DriftState(t_s, transition @ self._state.mean, covariance), transition

    def _evidence(self, shape: Shape) -> _Evidence | None:
        """Return what a frame says of the drift; None where some node is certainly loaded."""
        if shape.loads is not None and shape.loads.is_certain(LOADED * self._builder.noise.force_n).any():
            return None
        drift = shape.lengths.drift
        assert drift is not None
        information, gradient = length_evidence(self._builder, shape.node_position_m, shape.lengths)
        h = drift.of_length_m
        return h[:, None] * information * h, h * gradient


def length_evidence(
    builder: GraphBuilder, node_position_m: NDArray[np.float64], lengths: TendonLengths
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what a frame says of errors of its lengths: the (tendons, tendons) information and (tendons,) gradient.

    Args:
        builder: of the frame's factors, equilibrium among them.
        node_position_m: (nodes, 3) near the minimum.
        lengths: without the drift; its uncertainty does not count.
    """
    variance = tendon_sigma_m(lengths, builder.noise) ** 2
    if lengths.drift is not None and lengths.drift.covariance_m2 is not None:
        variance = variance - np.diag(lengths.drift.covariance_m2)
        lengths = replace(lengths, drift=None)
    frame = linearised(builder, node_position_m, WeightedLengths(lengths, np.sqrt(variance)))
    of_tendons = np.zeros((len(frame.length_error_m), len(variance)))
    of_tendons[len(builder.structure.rods) :] = np.eye(len(variance))[builder.structure.free_tendons]
    error, by_shape, by_length = frame.weighted_with(of_tendons)
    shape_information, shape_gradient = frame.with_forces()
    crossed = by_length.T @ by_shape
    solved = np.linalg.solve(shape_information, np.column_stack([crossed.T, shape_gradient]))
    return by_length.T @ by_length - crossed @ solved[:, :-1], crossed @ solved[:, -1] - by_length.T @ error


def smoothed_drift(updates: Sequence[DriftUpdate]) -> list[DriftState]:
    """Return the states given all updates, later ones too (Rauch, Tung and Striebel)."""
    if not updates:
        return []
    states = [updates[-1].state]
    for update, after in zip(updates[-2::-1], updates[:0:-1], strict=True):
        here, predicted = update.state, after.predicted
        crossed = after.transition @ here.covariance
        back = np.linalg.lstsq(predicted.covariance, crossed, rcond=1e-12)[0].T
        mean = here.mean + back @ (states[-1].mean - predicted.mean)
        covariance = here.covariance + back @ (states[-1].covariance - predicted.covariance) @ back.T
        states.append(DriftState(here.t_s, mean, covariance))
    return states[::-1]


def _between_sensors(count: int, references: int) -> NDArray[np.float64]:
    return np.eye(count) + 1 / max(references, 1)
