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
from ...models.values.readings import SensorDrift, TendonLengths
from ..doubt import Regimes
from ..graph import GraphBuilder
from ..linear_frame import LinearFrame
from .change_evidence import PossibleChanges, change_evidence

CHANGED_SHARE = 0.04
"""Prior probability that something has changed, half of it by the boards: that of lengths which contradict each
other."""
CHANGED_MEMORY_S = 20.0
"""Time for which a change is believed without further evidence."""
CHANGED_M = 0.005
"""Standard deviation of a change of length: clamps and caps slip by millimetres."""
CHANGED_RESISTANCE = 0.02
"""Standard deviation of a change of all sensors of a board, in log resistance."""


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
        covariance_m2 = shape.covariance_m2.copy()
        covariance_m2[np.ix_(free, free)] += np.outer(self.shift_m, self.shift_m)
        return replace(shape, covariance_m2=covariance_m2).in_doubt(self.reason)


class ChangeWatch:
    """Follows what has changed, frame by frame."""

    def __init__(self, builder: GraphBuilder, update_every_s: float) -> None:
        self._builder = builder
        self._update_every_s = update_every_s
        self._updated_s = np.nan
        self._regimes: Regimes | None = None
        self._shift_m = np.zeros((0, 0))
        self.kept: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] | None = None
        """Time, probabilities and shifts after each update, for a smoother that puts a list here."""

    @property
    def found(self) -> Change | None:
        """The change that is more probable than none, if there is one."""
        return None if self._regimes is None else self._change(self._regimes.probability, self._shift_m)

    def doubted(self, shape: Shape) -> Shape:
        """Return the shape of the newest frame, in doubt if something has changed."""
        change = self.found
        return shape if change is None else change.doubted(shape, self._builder.structure.free_coordinates)

    def observe(self, frame: LinearFrame, shape: Shape, used_scale: float) -> None:
        """Learn from a frame.

        Args:
            frame: its factors, linearised at the estimate.
            shape: the estimate.
            used_scale: factor by which the sigmas of the measured lengths were multiplied in the frame.
        """
        step_s = shape.t_s - self._updated_s if np.isfinite(self._updated_s) else self._update_every_s
        is_due = step_s >= 0.999 * self._update_every_s
        if self._builder.statics is None or not is_due or shape.doubt is Reason.MOTION:
            return
        self._updated_s = shape.t_s
        rods = len(self._builder.structure.rods)
        measured = float(np.mean(frame.weight_per_m[rods:] > 0))
        weight_per_m = frame.weight_per_m.copy()
        weight_per_m[rods:] *= used_scale
        boards = _sensors_of_board(shape.lengths)
        evidence = change_evidence(replace(frame, weight_per_m=weight_per_m), self._possible(shape, boards))
        if self._regimes is None:
            self._regimes = Regimes(_prior(len(evidence.log_ratio) - len(boards), len(boards)), CHANGED_MEMORY_S)
        share = measured * min(step_s / self._builder.noise.correlation_s, 1.0)
        self._regimes.predict(step_s)
        self._regimes.update(share * np.concatenate([[0.0], evidence.log_ratio]))
        self._shift_m = evidence.shift_m
        if self.kept is not None:
            likeliest = int(np.argmax(self._regimes.probability[1:]))
            self.kept.append((shape.t_s, self._regimes.probability, evidence.shift_m[likeliest]))

    def smoothed(self, frames: Sequence[TendonLengths]) -> list[Change | None]:
        """Return what has changed in each frame, given all updates that were kept, later ones too."""
        if not self.kept or self._regimes is None:
            return [None] * len(frames)
        t_s = np.array([update[0] for update in self.kept])
        probability = self._regimes.smoothed(t_s, np.array([update[1] for update in self.kept]))
        latest = np.maximum(np.searchsorted(t_s, [lengths.t_s for lengths in frames], side="right") - 1, 0)
        return [self._change(probability[k], self.kept[k][2][None]) for k in latest]

    def _change(self, probability: NDArray[np.float64], shift_m: NDArray[np.float64]) -> Change | None:
        """Return the likeliest change if any is more probable than none; of its shift, or the only one."""
        if probability[0] > 0.5:
            return None
        likeliest = int(np.argmax(probability[1:]))
        structure = self._builder.structure
        of_member = likeliest < len(structure.rods) + len(structure.tendons)
        return Change(Reason.CHANGE if of_member else Reason.BOARD, shift_m[min(likeliest, len(shift_m) - 1)])

    def _possible(self, shape: Shape, boards: NDArray[np.float64]) -> PossibleChanges:
        """Return the changes of rods, of natural lengths, and of the lengths that each board reads."""
        structure, statics = self._builder.structure, self._builder.statics
        assert statics is not None, "changes need the balance of forces"
        rods, tendons = len(structure.rods), len(structure.tendons)
        free = structure.free_tendons
        of_tendons = np.zeros((len(free), tendons))
        of_tendons[np.arange(len(free)), free] = -1.0
        length_error_m = np.zeros((rods + len(free), rods + tendons + len(boards)))
        length_error_m[:rods, :rods] = -np.eye(rods)
        length_error_m[rods:, rods : rods + tendons] = of_tendons
        length_error_m[rods:, rods + tendons :] = boards[:, free].T
        force_n = np.zeros((len(statics.group), length_error_m.shape[1]))
        force_n[:, rods : rods + tendons] = statics.mechanics_jacobian(shape.node_position_m)[1]
        sigma = np.concatenate([np.full(rods + tendons, CHANGED_M), np.full(len(boards), CHANGED_RESISTANCE)])
        return PossibleChanges(length_error_m, force_n, sigma)


def _sensors_of_board(lengths: TendonLengths) -> NDArray[np.float64]:
    """Return (boards, tendons) the change of length by log resistance of what each board reads, and 0 for the rest."""
    drift: SensorDrift | None = lengths.drift
    if drift is None or drift.board is None:
        return np.zeros((0, len(lengths.length_m)))
    boards = np.arange(drift.board.max() + 1)
    return np.where(drift.board == boards[:, None], drift.per_change_m, 0.0)


def _prior(members: int, boards: int) -> NDArray[np.float64]:
    """Return (1 + members + boards,) the prior probability of no change, and of each."""
    of_boards = 0.5 * CHANGED_SHARE if boards else 0.0
    of_members = CHANGED_SHARE - of_boards
    each = np.concatenate([np.full(members, of_members / members), np.full(boards, of_boards / max(boards, 1))])
    return np.concatenate([[1 - CHANGED_SHARE], each])
