"""The truth with which an estimate is compared: positions, loads and faults. No estimator may use it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from ..trial_description import TrialDescription
from ..trial_tables import TruthTable
from ..values.errors import InputError
from .capture_clock import CaptureClock


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A sensor or a board that is known to have failed for some time."""

    kind: str
    where: str
    """`tendon 3` or `board 1`."""
    tendons: NDArray[np.int64]
    """(tendons,) numbers of the tendons whose readings the fault affects."""
    from_s: float
    until_s: float

    def during(self, t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return (times,) which times are within the fault."""
        return np.asarray((t_s >= self.from_s) & (t_s <= self.until_s))


@dataclass(frozen=True, slots=True, eq=False)
class TrueLoads:
    """External forces that are known to act."""

    t_s: NDArray[np.float64]
    """(times,) increasing, host clock."""
    force_n: NDArray[np.float64]
    """(times, nodes, 3) in the anchors' frame; nan where it was not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueContacts:
    """Which nodes the floor is known to carry."""

    t_s: NDArray[np.float64]
    """(times,) increasing, host clock."""
    standing: NDArray[np.bool_]
    """(times, nodes)"""

    def at(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (frames, nodes) 1 for a contact at the nearest known time, 0 for none; nan outside of these times."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        before_s, after_s = t_s - self.t_s[after - 1], self.t_s[after] - t_s
        nearest = np.where(before_s < after_s, after - 1, after)
        longest_s = self.t_s[after] - self.t_s[after - 1]
        known = np.minimum(np.abs(before_s), np.abs(after_s)) <= longest_s
        return np.where(known[:, None], self.standing[nearest], np.nan)


@dataclass(frozen=True, slots=True)
class MarkedNode:
    """A marker and the node at which it is."""

    marker: str
    """Name of the marker."""
    node: int
    beyond_m: float = 0.0
    """Distance of the marker's centre beyond the node, along the rod."""


@dataclass(frozen=True, slots=True)
class CaptureFit:
    """How a motion capture was laid onto the estimate."""

    clock: CaptureClock
    markers: tuple[MarkedNode, ...]
    """Which marker is which node."""
    found: bool
    """Whether the fit to the shape told it, and not trial.toml."""
    ignored: tuple[str, ...]
    """Names of the markers that are on no node."""
    misfit_m: float
    """Root mean square distance of markers from their nodes, after the best rigid motion of each frame."""
    next_misfit_m: float
    """The same for the next best assignment; nan where there is none."""
    rotation_deg: float
    """Angle by which the capture was turned."""
    farther_apart_m: float
    """How much farther apart the markers of a rod are than it is long, on average, after their `beyond_m` is taken off;
    nan where markers that stand beyond the nodes do not explain it."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The true node positions, from an independent measurement, with known loads and faults."""

    t_s: NDArray[np.float64]
    """(times,) increasing, host clock."""
    node_position_m: NDArray[np.float64]
    """(times, nodes, 3); nan where a node was not measured."""
    rest_seconds: float = 0.0
    """How long the structure stood at its rest shape, from the start of the trial on."""
    start_s: float | None = None
    """When the trial starts, on the host clock; with the first frame of the estimate if None."""
    faults: tuple[Fault, ...] = ()
    loads: TrueLoads | None = None
    contacts: TrueContacts | None = None
    capture: CaptureFit | None = None
    """How motion capture was laid onto the estimate; None for positions on the host's clock."""


def known_faults(truth: TruthTable, trial: TrialDescription, where: str) -> tuple[Fault, ...]:
    """Return the faults that a trial describes, with the tendons that they affect, for evaluation only.

    Raises:
        InputError: for a tendon or board that does not exist, or an interval that ends before it begins.
    """
    tendons = len(trial.structure.tendons)
    boards = len(trial.tendons_of_board)
    faults = []
    for index, fault in enumerate(truth.fault):
        name = f"{where}: truth.fault[{index}]"
        if not fault.from_s <= fault.until_s:
            raise InputError(f"{name}: expected until_s at from_s = {fault.from_s} or later, got {fault.until_s}")
        if fault.tendon is not None and fault.board is None:
            if not 0 <= fault.tendon < tendons:
                raise InputError(f"{name}.tendon: expected a tendon from 0 to {tendons - 1}, got {fault.tendon}")
            place = f"tendon {fault.tendon}"
            affected = np.array([fault.tendon])
        elif fault.board is not None and fault.tendon is None:
            if not 0 <= fault.board < boards:
                raise InputError(f"{name}.board: expected one of the trial's {boards} boards, got {fault.board}")
            place = f"board {fault.board}"
            wired = trial.tendons_of_board[fault.board]
            affected = wired[wired < tendons]
        else:
            raise InputError(f"{name}: expected either tendon or board")
        faults.append(Fault(fault.kind, place, affected, fault.from_s, fault.until_s))
    return tuple(faults)


def marked_nodes(truth: TruthTable, structure: Structure, where: str) -> tuple[MarkedNode, ...]:
    """Return which marker of a motion capture is which node, as a trial tells it, for evaluation only.

    Raises:
        InputError: for a node that does not exist, or a marker beyond a node that is on no rod, or whose rod has no
            marker at its other end, or is shorter than the marker is beyond it.
    """
    nodes = {marker.node for marker in truth.markers.values()}
    other = {int(a): int(b) for rod in structure.rods for a, b in (rod, rod[::-1])}
    rod_m = {int(node): float(m) for rod, m in zip(structure.rods, structure.rod_length_m, strict=True) for node in rod}
    for name, marker in truth.markers.items():
        here = f"{where}: truth.markers.{name}"
        if not 0 <= marker.node < structure.node_count:
            raise InputError(f"{here}.node: expected a node from 0 to {structure.node_count - 1}, got {marker.node}")
        if marker.beyond_m and marker.node not in other:
            raise InputError(f"{here}.beyond_m: expected a node of a rod, whose direction it tells, got {marker.node}")
        if marker.beyond_m and marker.beyond_m >= rod_m[marker.node]:
            raise InputError(
                f"{here}.beyond_m: expected less than the rod is long, {rod_m[marker.node]:g} m, got "
                f"{marker.beyond_m:g}: is the unit right?"
            )
        if marker.beyond_m and other[marker.node] not in nodes:
            raise InputError(
                f"{here}.beyond_m: expected a marker at node {other[marker.node]} too, which tells the rod's "
                "direction: without it, leave this marker out of truth.markers"
            )
    return tuple(MarkedNode(name, marker.node, marker.beyond_m) for name, marker in truth.markers.items())
