"""Motion capture laid onto an estimate: which marker is which node, on which clock, and in which axes."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..structure.lengths import member_length_m
from ..structure.reconstruction import Reconstruction
from ..structure.structure import Structure
from ..values.errors import InputError
from ..values.tracks import MarkerTracks, StampedPositions
from .alignment import interpolated_within, rigid_alignment
from .capture_clock import CaptureClock, ClockFit, MotionSignals, OffsetSearch, moving_pairs, search_offset
from .marker_assignment import BESIDE_M, assign_markers, largest_reach_m, shape_misfit_m
from .statistics import of_known
from .truth import CaptureFit, MarkedNode

CLOCK_OFF_S = 0.15
"""Offset above which stamped positions seem to be on another clock: an estimate is late by 0.05 s."""
ROD_APART = 0.15
"""Share of a rod's length by which it is not as long in the truth: its nodes are others."""
PLACED_S = 1.0
"""Time at the start by which the capture of a free-standing structure is placed in the world, at least."""
SAME_PLACE_M = 0.02
"""Distance of two markers of one node above which one of them is elsewhere."""
LINE_M = 0.005
"""Least rms distance of the markers, as they move, from the line through them: else axes turn freely about the line."""


def lay_onto(
    tracks: MarkerTracks,
    estimate: Reconstruction,
    *,
    marked: tuple[MarkedNode, ...] = (),
    offset_s: float | None = None,
    rest_seconds: float = 0.0,
) -> tuple[StampedPositions, CaptureFit]:
    """Return the positions of nodes that a motion capture gives, on the host's clock and in the estimate's axes.

    Args:
        tracks: the capture.
        estimate: the shapes with which it will be compared.
        marked: which marker is which node; if none is given, the best fit to the shapes tells it.
        offset_s: host time minus capture time; if None, the motion tells it.
        rest_seconds: how long a free-standing structure stands at its start.

    Raises:
        InputError: when the capture does not tell its clock or its markers, or covers too little.
    """
    estimate.structure.check_unit("motion capture", tracks.position_m)
    found, next_misfit_m = not marked, np.nan
    if found:
        best, other = assign_markers(tracks, estimate, lambda node: _roughly(tracks, estimate, node, offset_s))
        marked = _marks(tracks, best.node)
        next_misfit_m = other.misfit_m if other else np.nan
    _check_names(tracks, marked)
    node_m = node_positions(tracks, marked, estimate.structure)
    try:
        clock = _given(offset_s) if offset_s is not None else find_clock(tracks.t_s, node_m, estimate)
    except InputError:
        check_rods(estimate.structure, "motion capture", node_m)  # a marker of another node moves otherwise, too
        raise
    host_s = clock.host_s(tracks.t_s)
    placed_m, rotation_deg = _in_axes_of(host_s, node_m, estimate, max(rest_seconds, PLACED_S))
    fit = CaptureFit(
        clock=clock,
        markers=marked,
        found=found,
        ignored=tuple(name for name in tracks.names if name not in {mark.marker for mark in marked}),
        misfit_m=shape_misfit_m(host_s, placed_m, estimate),
        next_misfit_m=next_misfit_m,
        rotation_deg=rotation_deg,
        farther_apart_m=farther_apart_m(node_m, estimate.structure),
    )
    return StampedPositions(host_s, placed_m), fit


def find_clock(t_s: NDArray[np.float64], node_m: NDArray[np.float64], estimate: Reconstruction) -> CaptureClock:
    """Return the capture's clock, by the motion of its nodes: by distances, or by speeds of a free-standing structure.

    Args:
        t_s: (times,) capture clock.
        node_m: (times, nodes, 3) in any axes; nan where a node was not captured.
        estimate: shapes on the host's clock.

    Raises:
        InputError: when two offsets explain the motion nearly as well, or none does.
    """
    estimated, captured = _motions(t_s, node_m, estimate)
    search = search_offset(estimated, captured)
    if not search.is_clear:
        raise InputError(_unclear(search))
    return ClockFit(estimated, captured, search.offset_s).solve()


def other_offset_s(t_s: NDArray[np.float64], node_m: NDArray[np.float64], estimate: Reconstruction) -> float:
    """Return what to add to the times of true positions, by their motion; nan where they are in time, or do not tell.

    Args:
        t_s: (times,) on the host's clock, as far as is known.
        node_m: (times, nodes, 3) nan where a node was not measured.
        estimate: shapes on the host's clock.
    """
    try:
        offset_s = find_clock(t_s, node_m, estimate).offset_s
    except InputError:  # it is too short, or of a single node
        return np.nan
    return offset_s if abs(offset_s) > CLOCK_OFF_S else np.nan


def node_positions(tracks: MarkerTracks, marked: tuple[MarkedNode, ...], structure: Structure) -> NDArray[np.float64]:
    """Return the (times, nodes, 3) positions in the capture's axes; nan where a node has no marker or it was hidden.

    A marker stands beyond its node, in the direction from the marker at the rod's other end.
    """
    raw_m = np.full((len(tracks.t_s), structure.node_count, 3), np.nan)
    for mark in marked:  # several markers of one node are pieces of one track
        piece_m = tracks.position_m[:, tracks.names.index(mark.marker)]
        raw_m[:, mark.node] = np.where(np.isfinite(piece_m), piece_m, raw_m[:, mark.node])
    beyond_m = np.zeros(structure.node_count)
    beyond_m[[mark.node for mark in marked]] = [mark.beyond_m for mark in marked]
    other = np.arange(structure.node_count)
    other[structure.rods] = structure.rods[:, ::-1]
    along_m = raw_m - raw_m[:, other]
    length_m = np.linalg.norm(along_m, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        moved_m = raw_m - beyond_m[:, None] * along_m / length_m
    return np.where(beyond_m[:, None] > 0, moved_m, raw_m)


def check_rods(structure: Structure, name: str, true_m: NDArray[np.float64]) -> None:
    """Check that rods are as long as those of the structure.

    Args:
        structure: with its rods.
        name: of the positions, for the error text.
        true_m: (times, nodes, 3), nan where a node was not measured.

    Raises:
        InputError: for the first that is not.
    """
    length_m = member_length_m(true_m, structure.rods)
    for (i, j), told_m, true_lengths_m in zip(structure.rods, structure.rod_length_m, length_m.T, strict=True):
        true_length_m = of_known(np.median, true_lengths_m)
        if abs(true_length_m - told_m) > ROD_APART * told_m:
            raise InputError(
                f"{name}: nodes {i} and {j}: expected as far apart as their rod is long, {told_m:.3g} m, got "
                f"{true_length_m:.3g} m: is the order of the nodes right?"
            )


def farther_apart_m(node_m: NDArray[np.float64], structure: Structure) -> float:
    """Return how much farther apart the captured ends of a rod are than it is long, on average over the rods.

    It is nan where no rod has both ends captured, and where markers beyond the nodes do not explain it: where it is
    less than 3 mm, less than the rods differ among themselves, or more than two markers may be from their nodes.

    Args:
        node_m: (times, nodes, 3) captured positions in any axes; nan where a node was not captured.
        structure: with the lengths of its rods.
    """
    apart_m = np.linalg.norm(np.diff(node_m[:, structure.rods], axis=2)[:, :, 0], axis=-1)
    excess_m = np.array([of_known(np.median, of_rod) for of_rod in apart_m.T]) - structure.rod_length_m
    mean_m, differ_m = of_known(np.mean, excess_m), of_known(np.ptp, excess_m)
    return mean_m if max(BESIDE_M, differ_m) < mean_m < 2 * largest_reach_m(structure) else np.nan


def _marks(tracks: MarkerTracks, node: NDArray[np.int64]) -> tuple[MarkedNode, ...]:
    """Return the markers that are at nodes, of (markers,) nodes or -1."""
    return tuple(MarkedNode(tracks.names[k], int(node[k])) for k in np.flatnonzero(node >= 0))


def _check_names(tracks: MarkerTracks, marked: tuple[MarkedNode, ...]) -> None:
    for mark in marked:
        if mark.marker not in tracks.names:
            got = ", ".join(tracks.names)
            raise InputError(f"truth.markers: no marker is called '{mark.marker}': expected one of {got}")
    for one, other in combinations(marked, 2):
        if one.node == other.node:
            pieces_m = [tracks.position_m[:, tracks.names.index(mark.marker)] for mark in (one, other)]
            apart_m = of_known(np.median, np.linalg.norm(pieces_m[0] - pieces_m[1], axis=1))
            if apart_m > SAME_PLACE_M:
                raise InputError(
                    f"truth.markers: {one.marker} and {other.marker}: expected pieces of one track at node {one.node}, "
                    f"got two markers {apart_m:.3g} m apart"
                )


def _roughly(
    tracks: MarkerTracks, estimate: Reconstruction, node: NDArray[np.int64], offset_s: float | None
) -> NDArray[np.float64]:
    """Return the (times,) capture times on the host's clock, to a step of the search, for markers at such nodes."""
    if offset_s is None:
        node_m = node_positions(tracks, _marks(tracks, node), estimate.structure)
        offset_s = search_offset(*_motions(tracks.t_s, node_m, estimate)).offset_s
    return tracks.t_s + offset_s


def _motions(
    t_s: NDArray[np.float64], node_m: NDArray[np.float64], estimate: Reconstruction
) -> tuple[MotionSignals, MotionSignals]:
    """Return the motions of the estimate and of the capture: speeds where the structure moves about, else distances."""
    nodes = np.flatnonzero(np.isfinite(node_m).any(axis=2).any(axis=0))
    estimated_m, captured_m = estimate.node_position_m[:, nodes], node_m[:, nodes]
    if estimate.structure.is_free_standing:
        return MotionSignals.of_speeds(estimate.t_s, estimated_m), MotionSignals.of_speeds(t_s, captured_m)
    if len(nodes) < 2:
        raise InputError(f"expected markers of two nodes or more, got {len(nodes)}")
    pairs = moving_pairs(estimated_m)
    return (
        MotionSignals.of_distances(estimate.t_s, estimated_m, pairs),
        MotionSignals.of_distances(t_s, captured_m, pairs),
    )


def _unclear(search: OffsetSearch) -> str:
    left = f"{search.offset_s:.2f} s leaves {search.unexplained_share:.0%} of the motion unexplained"
    if np.isfinite(search.other_offset_s):
        left += f", {search.other_offset_s:.2f} s {search.other_unexplained_share:.0%}"
    return f"the motion does not show the offset of the capture's clock ({left}): give --offset"


def _given(offset_s: float) -> CaptureClock:
    return CaptureClock(offset_s, 0.0, 0.0, 0.0, 0.0)


def _in_axes_of(
    host_s: NDArray[np.float64],
    node_m: NDArray[np.float64],
    estimate: Reconstruction,
    placed_s: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the positions after the rigid motion that lays them onto the estimate best, and its angle in degrees.

    Anchored structures are laid on in all frames; a free-standing one at its start, so that its drift shows.
    """
    true_m = interpolated_within(estimate.t_s, host_s, node_m)
    known = np.asarray(np.isfinite(true_m).all(axis=-1))
    frames = np.flatnonzero(known.any(axis=1))
    if not len(frames):
        raise InputError(
            f"the capture from {host_s[0]:.3f} to {host_s[-1]:.3f} s of the host's clock covers no frame of the "
            f"estimate, {estimate.t_s[0]:.3f} to {estimate.t_s[-1]:.3f} s"
        )
    if estimate.structure.is_free_standing:
        known[estimate.t_s > estimate.t_s[frames[0]] + placed_s] = False
    points_m = true_m[known]
    if len(points_m) < 3 or _off_line_m(points_m) < LINE_M:
        raise InputError(
            "the markers are on one line: expected a third node, to tell how the capture's axes are turned"
        )
    rotation, shift_m = rigid_alignment(points_m, estimate.node_position_m[known])
    return node_m @ rotation.as_matrix().T + shift_m, float(np.rad2deg(rotation.magnitude()))


def _off_line_m(points_m: NDArray[np.float64]) -> float:
    """Return the rms distance of points from the line that fits them best, along the farther of its two normals."""
    values = np.linalg.eigvalsh(np.cov(points_m.T))
    return float(np.sqrt(max(values[1], 0.0)))
