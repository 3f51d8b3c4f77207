"""Which marker is which node, where nobody said: the rigid fits of the shape to the markers, and the best of them."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from ..structure.reconstruction import Reconstruction
from ..structure.structure import Structure
from ..values.errors import InputError
from ..values.tracks import MarkerTracks
from .alignment import best_motions, interpolated_within
from .statistics import of_known

REACH = 0.1
"""Largest distance of a marker from its node, in proportion to the rods' median length. Nodes are further apart."""
SNAPSHOTS = 3
"""Number of instants of the capture at which fits are looked for; at each, as many markers as possible are seen."""
TRIPLES = 60
"""Most triples of markers that are laid onto triples of nodes at each instant."""
CANDIDATES = 24
"""Most fits that are followed over time. The shape of six rods can be turned in 12 ways that nearly fit itself."""
FRAMES = 300
"""Most frames in which a fit is followed."""
NEAR = 2.0
"""Ratio of the misfits of two assignments below which the capture does not tell which is right."""

BESIDE_M = 0.003
"""Distance above which a marker is not at its node, nor a rod as long as told: both are measured to 2 mm or better."""
SHOWN = 3
"""Most markers that are named where two assignments differ."""

HostTimes = Callable[[NDArray[np.int64]], NDArray[np.float64]]
"""(times,) of the capture on the host's clock, for (markers,) the node of each marker, or -1."""


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """The node of each marker, and how well the markers fit the shape there."""

    node: NDArray[np.int64]
    """(markers,) -1 for a marker that is on no node."""
    misfit_m: float
    """Root mean square distance of markers from their nodes, after the best rigid motion of each frame."""


def largest_reach_m(structure: Structure) -> float:
    """Return the largest distance of a marker from its node."""
    return REACH * float(np.median(structure.rod_length_m))


def assign_markers(
    tracks: MarkerTracks, estimate: Reconstruction, host_s: HostTimes
) -> tuple[Assignment, Assignment | None]:
    """Return the assignment that fits the estimated shapes best, and the next best.

    Raises:
        InputError: when no assignment fits, or two fit alike.
    """
    most_m = largest_reach_m(estimate.structure)
    fits: dict[bytes, Assignment] = {}
    for node in _candidates(tracks, estimate.node_position_m[0], most_m):
        fit = follow(tracks, estimate, node, host_s(node), most_m)
        key = fit.node.tobytes()
        if np.isfinite(fit.misfit_m) and (key not in fits or fit.misfit_m < fits[key].misfit_m):
            fits[key] = fit
    if not fits:
        raise InputError(
            f"no assignment of its {len(tracks.names)} markers to nodes fits the shape to {1e3 * most_m:.0f} mm: "
            "expected three markers or more at nodes; say which in [truth.markers] of trial.toml"
        )
    most = max(int((fit.node >= 0).sum()) for fit in fits.values())
    whole = [fit for fit in fits.values() if (fit.node >= 0).sum() == most]
    best, *others = sorted(whole, key=lambda fit: fit.misfit_m)
    if others and others[0].misfit_m < NEAR * best.misfit_m:
        raise InputError(_two_fits(tracks, best, others[0]))
    return best, others[0] if others else None


def follow(
    tracks: MarkerTracks, estimate: Reconstruction, node: NDArray[np.int64], host_s: NDArray[np.float64], reach_m: float
) -> Assignment:
    """Return an assignment that other markers have joined, and its misfit over all frames; nan where none is seen.

    A marker joins the node from which it is less than the reach, rms over time. Two markers are at one node only if
    they are never seen together, as pieces of one that was lost in between.

    Args:
        tracks: the capture.
        estimate: shapes on the host's clock.
        node: (markers,) see `Assignment`.
        host_s: (times,) of the capture on the host's clock.
        reach_m: largest distance of a marker from its node.
    """
    marker_m, shape_m = _at_frames(host_s, tracks.position_m, estimate)
    node_m = _laid_onto(marker_m, shape_m, node)
    square_m2 = np.sum((marker_m[:, :, None] - node_m[:, None]) ** 2, axis=-1)
    count = np.isfinite(square_m2).sum(axis=0)
    rms_m = np.sqrt(np.where(count > 0, np.nansum(square_m2, axis=0) / np.maximum(count, 1), np.inf))
    joined = _joined(rms_m, np.asarray(np.isfinite(tracks.position_m).all(axis=-1)), reach_m)
    on = np.flatnonzero(joined >= 0)
    seen = count[on, joined[on]]
    misfit_m = np.sqrt(np.sum(seen * rms_m[on, joined[on]] ** 2) / seen.sum()) if len(on) else np.nan
    return Assignment(joined, float(misfit_m))


def shape_misfit_m(host_s: NDArray[np.float64], node_m: NDArray[np.float64], estimate: Reconstruction) -> float:
    """Return the root mean square distance of captured nodes from an estimate, after the best motion of each frame.

    It is nan where no frame has three nodes.

    Args:
        host_s: (times,) of the capture on the host's clock.
        node_m: (times, nodes, 3) captured positions in any axes.
        estimate: shapes on the host's clock.
    """
    captured_m, shape_m = _at_frames(host_s, node_m, estimate)
    node = np.where(np.isfinite(node_m).any(axis=(0, 2)), np.arange(node_m.shape[1]), -1)
    square_m2 = np.sum((captured_m - _laid_onto(captured_m, shape_m, node)) ** 2, axis=-1)
    return float(np.sqrt(of_known(np.mean, square_m2)))


def _at_frames(
    host_s: NDArray[np.float64], position_m: NDArray[np.float64], estimate: Reconstruction
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return captured positions and estimated shapes at `FRAMES` times at most."""
    frames = np.unique(np.linspace(0, len(estimate.t_s) - 1, FRAMES).astype(np.int64))
    return interpolated_within(estimate.t_s[frames], host_s, position_m), estimate.node_position_m[frames]


def _joined(rms_m: NDArray[np.float64], seen: NDArray[np.bool_], reach_m: float) -> NDArray[np.int64]:
    """Return (markers,) the nodes, from (markers, nodes) distances and (times, markers) whether a marker is seen."""
    joined = np.full(len(rms_m), -1)
    nearest = rms_m.argmin(axis=1)
    distance_m = rms_m.min(axis=1)
    for marker in np.argsort(distance_m, kind="stable"):
        others = joined == nearest[marker]
        if distance_m[marker] < reach_m and not (seen[:, others].any(axis=1) & seen[:, marker]).any():
            joined[marker] = nearest[marker]
    return joined


def _laid_onto(
    marker_m: NDArray[np.float64], node_m: NDArray[np.float64], node: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the (frames, nodes, 3) shapes, each laid onto its markers; nan where fewer than three are seen."""
    on = np.flatnonzero(node >= 0)
    known = np.asarray(np.isfinite(marker_m[:, on]).all(axis=-1, keepdims=True))
    a, turn, b = best_motions(node_m[:, node[on]], marker_m[:, on], known)
    laid_m = (node_m - a) @ np.swapaxes(turn, 1, 2) + b
    return np.where(known.sum(axis=1, keepdims=True) >= 3, laid_m, np.nan)


def _candidates(tracks: MarkerTracks, shape_m: NDArray[np.float64], reach_m: float) -> list[NDArray[np.int64]]:
    """Return (markers,) nodes for each fit of a shape to the markers at some instants, those of most markers first."""
    seen = np.isfinite(tracks.position_m).all(axis=-1).sum(axis=1)
    found: dict[bytes, tuple[int, float, NDArray[np.int64]]] = {}
    for part in np.array_split(np.arange(len(tracks.t_s)), SNAPSHOTS):
        if len(part):
            marker_m = tracks.position_m[part[seen[part].argmax()]]
            for fit in _fits(marker_m, shape_m, reach_m):
                found.setdefault(fit[2].tobytes(), fit)
    best = sorted(found.values(), key=lambda fit: (-fit[0], fit[1]))[:CANDIDATES]
    return [node for _, _, node in best]


def _fits(
    marker_m: NDArray[np.float64], shape_m: NDArray[np.float64], reach_m: float
) -> list[tuple[int, float, NDArray[np.int64]]]:
    """Return number of markers, misfit and (markers,) nodes of rigid fits of a shape to markers, of which some are nan.

    Each triple of markers is laid onto each triple of nodes with like sides; every marker near a node then is there.
    """
    seen = np.flatnonzero(np.isfinite(marker_m).all(axis=1))
    nodes = np.array(list(permutations(range(len(shape_m)), 3)))
    node_sides_m = _sides_m(shape_m[nodes])
    triples = np.array(list(combinations(seen, 3)), dtype=np.int64).reshape(-1, 3)
    sides_m = _sides_m(marker_m[triples])
    possible = (sides_m < node_sides_m.max() + reach_m).all(axis=1) & (sides_m > node_sides_m.min() - reach_m).all(
        axis=1
    )
    triples, sides_m = triples[possible], sides_m[possible]
    fits = []
    for k in np.unique(np.linspace(0, len(triples) - 1, TRIPLES).astype(np.int64)) if len(triples) else []:
        alike = nodes[(np.abs(node_sides_m - sides_m[k]) < reach_m).all(axis=1)]
        node = np.full((len(alike), len(marker_m)), -1)
        node[:, triples[k]] = alike
        for _ in range(2):  # the second time with all markers that the first has found
            node, misfit_m = _nearest(marker_m, shape_m, node, reach_m)
        fits += [(int((n >= 0).sum()), float(m), n) for n, m in zip(node, misfit_m, strict=True) if (n >= 0).sum() >= 3]
    return fits


def _nearest(
    marker_m: NDArray[np.float64], shape_m: NDArray[np.float64], node: NDArray[np.int64], reach_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (fits, markers) the nodes within reach after a shape is laid onto the markers, and the rms distances.

    Args:
        marker_m: (markers, 3) nan where hidden.
        shape_m: (nodes, 3)
        node: (fits, markers) nodes of the markers by which the shape is laid, or -1.
        reach_m: largest distance of a marker from its node.
    """
    a, turn, b = best_motions(shape_m[node], marker_m, (node >= 0)[..., None])
    laid_m = (shape_m - a) @ np.swapaxes(turn, 1, 2) + b
    distance_m = np.linalg.norm(marker_m[:, None] - laid_m[:, None], axis=-1)
    distance_m = np.where(np.isnan(distance_m), np.inf, distance_m)
    nearest = distance_m.argmin(axis=2)
    own = distance_m.argmin(axis=1)  # a node has one marker, the nearest
    mutual = np.take_along_axis(own, nearest, axis=1) == np.arange(len(marker_m))
    distance_m = distance_m.min(axis=2)
    near = mutual & (distance_m < reach_m)
    square_m2 = np.where(near, distance_m, 0.0) ** 2
    return np.where(near, nearest, -1), np.sqrt(square_m2.sum(axis=1) / np.maximum(near.sum(axis=1), 1))


def _sides_m(triangle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3) the sides of (..., 3, 3) triangles."""
    return np.asarray(np.linalg.norm(triangle_m - np.roll(triangle_m, 1, axis=-2), axis=-1))


def _two_fits(tracks: MarkerTracks, best: Assignment, other: Assignment) -> str:
    differ = np.flatnonzero(best.node != other.node)
    more = f", and {len(differ) - SHOWN} more" if len(differ) > SHOWN else ""

    def nodes_of(fit: Assignment) -> str:
        nodes = [f"{tracks.names[k]} = {fit.node[k] if fit.node[k] >= 0 else 'no node'}" for k in differ[:SHOWN]]
        return f"{1e3 * fit.misfit_m:.2f} mm: {', '.join(nodes)}{more}"

    texts = [nodes_of(fit) for fit in (best, other)]
    what = "tell it" if best.misfit_m < BESIDE_M else "tell it, and beyond_m where markers stand beyond their nodes,"
    return f"two assignments of markers fit alike ({'; '.join(texts)}): {what} in [truth.markers] of trial.toml"
