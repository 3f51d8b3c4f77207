"""Tendons: their lengths as the sensors measure them, eqs. (5) and (7), and those of stiff cables that are taut."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..models.balance.statics import Statics
from ..models.structure.lengths import length_and_jacobian, length_jacobian, member_length_m
from ..models.structure.mechanics import Mechanics
from ..models.structure.structure import Structure
from ..models.values.readings import FactorRows
from .keys import NodeRows
from .noise import WeightedLengths, independent_rows, rounded_sigma_m, tendon_noises


def tendon_factors(
    structure: Structure, keys: Sequence[int], measured: WeightedLengths, robust: Literal["none", "huber", "cauchy"]
) -> list[gtsam.NonlinearFactor]:
    """Return (|x_a - x_b| - L_e) / sigma_e for each usable tendon e = a-b of a frame, whose errors are independent."""
    usable = np.flatnonzero(np.isfinite(measured.sigma_m))
    ends = structure.tendons[usable].tolist()
    length_m = measured.lengths.length_m[usable].tolist()
    models = tendon_noises(measured.sigma_m[usable], robust)
    return [
        gtsam.RangeFactor3(keys[a], keys[b], length, model)
        for (a, b), length, model in zip(ends, length_m, models, strict=True)
    ]


def correlated_tendon_rows(structure: Structure, measured: WeightedLengths, shared: NDArray[np.float64]) -> NodeRows:
    """Return the same of errors that sensors share, as rows whose errors are independent, see `independent_rows`.

    Args:
        structure: of the tendons.
        measured: their lengths in one frame.
        shared: (tendons,) see `WeightedLengths.shared`; a tendon between anchors shares nothing with those that move.
    """
    usable = np.flatnonzero(np.isfinite(measured.sigma_m))
    members = structure.tendons[usable]
    shared = np.where(structure.is_free_tendon, shared, 0.0)[usable]
    length_m = measured.lengths.length_m[usable]
    per_m = independent_rows(np.diag(1 / rounded_sigma_m(measured.sigma_m[usable])), shared)

    def residual(position: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(per_m @ (member_length_m(position, members) - length_m))

    def linearised(position: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        now_m, by_position = length_and_jacobian(position, members)
        return per_m @ (now_m - length_m), per_m @ by_position

    return NodeRows(len(usable), residual, linearised)


SLACK = 3.0
"""Number of standard deviations by which a cable that is slack is shorter than its natural length."""
LEAST_PULL_N = 0.3
"""Tension below which nothing says that a cable is taut: three standard deviations of the balance of forces."""


@dataclass(frozen=True, slots=True, eq=False)
class TautCables:
    """The lengths of stiff cables: each is L0 long where it is taut, and nothing is said of one that is slack.

    Its rows are l - L0 with the sigma of `Mechanics.cable_sigma_m`. A cable is slack where it is shorter by `SLACK` of
    them, or shorter at all and forces balance best with a tension below `LEAST_PULL_N`. The rows are those of a
    `NodeFactor`, and so in the graph, the covariance and the doubt of every method that takes factors.
    """

    members: NDArray[np.int64]
    """(stiff cables, 2) node pairs."""
    natural_length_m: NDArray[np.float64]
    """(stiff cables,) L0."""
    sigma_m: NDArray[np.float64]
    """(stiff cables,)"""
    statics: Statics | None
    """The balance of forces with the natural lengths of the rest, which tells whether they pull; None where the force
    of the floor, of a hand or of a motor decides."""

    @classmethod
    def of(cls, structure: Structure, mechanics: Mechanics, *, by_forces: bool) -> "TautCables":
        """Return those of a structure; `by_forces` where weight and tendons, as at rest, pull alone without a load."""
        cables = mechanics.stiff_cables
        statics = Statics(structure, mechanics) if by_forces else None
        return cls(structure.tendons[cables], structure.natural_length_m[cables], mechanics.cable_sigma_m, statics)

    def __str__(self) -> str:
        return "taut cables"

    def rows(self, t_s: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> FactorRows:
        """Return the rows of all stiff cables, nan where slack, see `NodeFactor`; they are the same at all times."""
        longer_m = member_length_m(node_position_m, self.members) - self.natural_length_m
        is_slack = longer_m < -SLACK * self.sigma_m
        if self.statics is not None:
            is_slack |= (longer_m < 0) & (self.statics.cable_tension_n(node_position_m) < LEAST_PULL_N)
        return FactorRows(
            residual=np.where(is_slack, np.nan, longer_m),
            jacobian=length_jacobian(node_position_m, self.members),
            sigma=np.where(is_slack, np.inf, self.sigma_m),
        )
