"""Whether something that is taken as known has changed since the sensors were tared.

One of these may have changed, each a regime of a hidden Markov model beside that of no change:

- the length of a rod: its end slips in the cap, or it bows;
- the natural length of a tendon: its clamp slips, so that the strip reads a shorter tendon, and pulls less;
- the resistance of all sensors of one board by the same factor: its supply, its reference or a common plug.

The evidence of a frame is that of `change_evidence`. Errors of the lengths last for seconds, so that it counts once in
`correlation_s`. Of a change that is more probable than none, the status tells, and the ellipsoids contain what it moves
the shape by; which of several it is may not be told apart, and the shape is not corrected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.structure.shape import Reason, Shape
from ...models.structure.structure import Structure
from ...models.values.readings import SensorDrift, TendonLengths
from ...models.values.stamps import is_due
from ...models.values.time_series import Regimes
from ..doubt import evidence_share
from ..graph import GraphBuilder
from ..linear_frame import LinearFrame
from .change_evidence import ChangeEvidence, PossibleChanges, change_evidence

UPDATE_EVERY_S = 0.2
"""Shortest time between two looks, each of which takes a fifth of the time of a frame: evidence grows in seconds."""
CHANGED_SHARE = 0.04
"""Prior probability that something has changed, half of it by the boards: that of lengths which contradict each
other."""
CHANGED_MEMORY_S = 20.0
"""Time for which a change is believed without further evidence."""
CHANGED_M = 0.005
"""Standard deviation of a change of length: clamps and caps slip by millimetres."""
CHANGED_RESISTANCE = 0.02
"""Standard deviation of a change of all sensors of a board, in log resistance."""
FAULT_M = 0.1
"""Standard deviation of the error of a length whose sensor has a fault: it may be any."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """A change that is more probable than none."""

    reason: Reason
    shift_m: NDArray[np.float64]
    """(free,) rms of what it moves the estimate of the free coordinates by."""

    def doubted(self, shape: Shape, free: NDArray[np.int64]) -> Shape:
        """Return a shape in doubt for the reason, with the shift in its covariance.

        Args:
            shape: of a frame.
            free: (free,) its free coordinates.
        """
        return shape.widened(free, np.outer(self.shift_m, self.shift_m)).in_doubt(self.reason)


class ChangeWatch:
    """Follows what has changed, frame by frame."""

    def __init__(self, builder: GraphBuilder) -> None:
        self._builder = builder
        self._updated_s = np.nan
        self._regimes: Regimes | None = None
        self._evidence: ChangeEvidence | None = None
        self.kept: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] | None = None
        """Time, (1 + changes,) probabilities of none and of each, and (changes, free) shifts after each update, for a
        smoother that puts a list here."""

    @property
    def explains_more(self) -> NDArray[np.float64]:
        """(tendons,) by how much more of a frame's error one change explains than a fault of each tendon's sensor."""
        tendons = len(self._builder.structure.tendons)
        if self._evidence is None:
            return np.zeros(tendons)
        explained = self._evidence.explained
        return np.asarray(explained[:-tendons].max() - explained[-tendons:])

    def believe(self) -> None:
        """Learn that several frames exclude that nothing has changed, see `SensorHealth.something_changed`."""
        if self._regimes is not None and self._evidence is not None:
            self._regimes.update(_of_regimes(self._evidence, self._builder.structure, -np.inf))

    def doubted(self, shape: Shape) -> Shape:
        """Return the shape of the newest frame, in doubt if something has changed."""
        if self._regimes is None or self._evidence is None:
            return shape
        probability = self._regimes.probability
        change = self._change(probability, self._evidence.shift_m)
        return shape if change is None else change.doubted(shape, self._builder.structure.free_coordinates)

    def observe(self, frame: LinearFrame, shape: Shape, used_scale: float) -> None:
        """Learn from a frame.

        Args:
            frame: its factors, linearised at the estimate.
            shape: the estimate.
            used_scale: factor by which the sigmas of the measured lengths were multiplied in the frame.
        """
        step_s = shape.t_s - self._updated_s if np.isfinite(self._updated_s) else UPDATE_EVERY_S
        if self._builder.statics is None or not is_due(step_s, UPDATE_EVERY_S):
            return
        self._updated_s = shape.t_s
        self._evidence = None if shape.doubt is Reason.MOTION else self._evidence_of(frame, shape, used_scale)
        structure = self._builder.structure
        if self._regimes is None and self._evidence is not None:
            self._regimes = Regimes(_prior(structure, self._evidence), CHANGED_MEMORY_S)
        if self._regimes is not None:
            self._regimes.predict(step_s)
        if self._regimes is None or self._evidence is None:  # the inertia of a shaken robot changes every force
            return
        share = evidence_share(self._builder, frame, step_s)
        self._regimes.update(share * _of_regimes(self._evidence, structure, 0.0))
        if self.kept is not None:
            probability = self._regimes.probability
            self.kept.append((shape.t_s, probability, self._evidence.shift_m[: len(probability) - 1]))

    def smoothed(self, frames: Sequence[TendonLengths]) -> list[Change | None]:
        """Return what has changed in each frame, given all updates that were kept, later ones too."""
        if not self.kept or self._regimes is None:
            return [None] * len(frames)
        t_s = np.array([update[0] for update in self.kept])
        probability = self._regimes.smoothed(t_s, np.array([update[1] for update in self.kept]))
        latest = np.maximum(np.searchsorted(t_s, [lengths.t_s for lengths in frames], side="right") - 1, 0)
        return [self._change(probability[k], self.kept[k][2]) for k in latest]

    def _change(self, probability: NDArray[np.float64], shift_m: NDArray[np.float64]) -> Change | None:
        """Return the likeliest change if any is more probable than none.

        Args:
            probability: (1 + changes,) of no change, and of each.
            shift_m: (changes, free) what each moves the estimate by; more rows are not used.
        """
        if probability[0] > 0.5:
            return None
        structure, likeliest = self._builder.structure, int(np.argmax(probability[1:]))
        of_member = likeliest < len(structure.rods) + len(structure.tendons)
        return Change(Reason.CHANGE if of_member else Reason.BOARD, shift_m[likeliest])

    def _evidence_of(self, frame: LinearFrame, shape: Shape, used_scale: float) -> ChangeEvidence:
        """Return what a frame says of each change, with lengths as exact as their sigmas say."""
        weight_per_m = frame.weight_per_m.copy()
        weight_per_m[len(self._builder.structure.rods) :] *= used_scale
        drift_m2 = None if frame.drift_m2 is None else frame.drift_m2 / used_scale**2
        frame = replace(frame, weight_per_m=weight_per_m, drift_m2=drift_m2)
        return change_evidence(frame, self._possible(shape))

    def _possible(self, shape: Shape) -> PossibleChanges:
        """Return the changes of rods, of natural lengths, of the lengths that each board reads, and of each length."""
        structure, statics = self._builder.structure, self._builder.statics
        assert statics is not None, "changes need the balance of forces"
        boards = _sensors_of_board(shape.lengths)
        rods, tendons, free = len(structure.rods), len(structure.tendons), structure.free_tendons
        of_lengths = -np.eye(tendons)[free]
        of_rods = np.concatenate([-np.eye(rods), np.zeros((len(free), rods))])
        of_tendons = np.concatenate([of_lengths, boards[:, free].T, of_lengths], axis=1)
        of_tendons = np.concatenate([np.zeros((rods, of_tendons.shape[1])), of_tendons])
        force_n = np.zeros((len(statics.group), rods + of_tendons.shape[1]))
        force_n[:, rods : rods + tendons] = statics.mechanics_jacobian(shape.node_position_m)[1]
        sigmas = ((CHANGED_M, rods + tendons), (CHANGED_RESISTANCE, len(boards)), (FAULT_M, tendons))
        sigma = np.concatenate([np.full(count, sigma) for sigma, count in sigmas])
        return PossibleChanges(np.concatenate([of_rods, of_tendons], axis=1), force_n, sigma)


def _sensors_of_board(lengths: TendonLengths) -> NDArray[np.float64]:
    """Return (boards, tendons) the change of length by log resistance of what each board reads, and 0 for the rest."""
    drift: SensorDrift | None = lengths.drift
    if drift is None or drift.board is None:
        return np.zeros((0, len(lengths.length_m)))
    boards = np.arange(drift.board.max() + 1)
    return np.where(drift.board == boards[:, None], drift.of_length_m, 0.0)


def _of_regimes(evidence: ChangeEvidence, structure: Structure, of_none: float) -> NDArray[np.float64]:
    """Return (1 + changes,) the log evidence for no change, and for each; faults of single sensors are none."""
    return np.concatenate([[of_none], evidence.log_ratio[: -len(structure.tendons)]])


def _prior(structure: Structure, evidence: ChangeEvidence) -> NDArray[np.float64]:
    """Return (1 + changes,) the prior probability of no change, and of each."""
    members = len(structure.rods) + len(structure.tendons)
    boards = len(evidence.log_ratio) - members - len(structure.tendons)
    of_boards = 0.5 * CHANGED_SHARE if boards else 0.0
    each = [np.full(members, (CHANGED_SHARE - of_boards) / members), np.full(boards, of_boards / max(boards, 1))]
    return np.concatenate([[1 - CHANGED_SHARE], *each])
