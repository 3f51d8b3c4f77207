"""Frames of a run in space, as columns for Rerun: rods, tendons by strain, ellipsoids, loads."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure.reconstruction import Reconstruction
from ...models.structure.structure import Structure
from ...models.values.readings import Mode
from ..exports.solids import OPACITY, ROD_RADIUS, TENDON_RADIUS
from ..figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY_BLUE, color_of

MAGNIFICATIONS = (1, 5, 10)
"""Of the ellipsoids, which are small on a robot; the first is true size."""
STRAIN_COLORS = {0.0: SKY_BLUE, 0.1: BLUE, 0.2: "#002A42"}
"""Colour of a stretched tendon by its strain, with straight lines between: the same in every run."""
LOAD_M_PER_N = 0.03
"""Length of the arrow of a load, up to `LONGEST_LOAD`."""
LONGEST_LOAD = 1.0
"""Longest arrow, as a share of the mean length of the rods; its label tells the force."""
NODE_RADIUS = 0.004
"""Radius of a node, as a share of the mean length of the rods: less than a rod, so that its ellipsoid is seen."""
MARK_RADIUS = 0.015
"""The same for an anchor, and for the mark of a tendon."""
GHOST_RADIUS = 0.3
"""Radius of what is only compared with, the truth and the rest shape, as a share of that of the estimate."""


def space_columns(rerun: Any, result: Reconstruction, probability: float, load_threshold_n: float) -> dict[str, Any]:
    """Return what is seen in space, by the name of its entity, with a row for each frame.

    Args:
        rerun: the library.
        result: the frames.
        probability: of the ellipsoids.
        load_threshold_n: loads are shown that are certain to be larger, see `ExternalLoads.is_certain`.
    """
    s = result.structure
    unit_m = float(s.rod_length_m.mean())
    rod_colors = np.broadcast_to(bytes_of(BLACK), (len(result), len(s.rods), 4))
    columns = {
        "rods": _lines(rerun, result, s.rods, rod_colors, ROD_RADIUS * unit_m),
        "tendons": _lines(rerun, result, s.tendons, tendon_colors(result), TENDON_RADIUS * unit_m),
        "marked_tendons": _marked_tendons(rerun, result, unit_m),
        "nodes": _nodes(rerun, result, unit_m),
    }
    if np.isfinite(result.node_covariance_m2).all():
        for scale in MAGNIFICATIONS:
            columns[ellipsoids_name(scale)] = _ellipsoids(rerun, result, probability, scale)
    if result.loads is not None:
        columns["loads"] = _loads(rerun, result, load_threshold_n, unit_m)
    return columns


def ellipsoids_name(scale: int) -> str:
    """Return the name of the entity of ellipsoids that are drawn so many times as large as they are."""
    return "ellipsoids" if scale == 1 else f"ellipsoids_x{scale}"


def ghost_columns(rerun: Any, structure: Structure, node_position_m: NDArray[np.float64]) -> dict[str, Any]:
    """Return rods and tendons of the true shape, green and thin, without those whose nodes were hidden.

    Args:
        rerun: the library.
        structure: rods and tendons.
        node_position_m: (times, nodes, 3); nan where a node was hidden.
    """
    unit_m = float(structure.rod_length_m.mean())
    columns = {}
    for name, pairs, share in (("rods", structure.rods, ROD_RADIUS), ("tendons", structure.tendons, TENDON_RADIUS)):
        ends_m = node_position_m[:, pairs]
        seen = np.isfinite(ends_m).all(axis=(2, 3))
        values = rerun.LineStrips3D.columns(
            strips=list(ends_m[seen]),
            colors=np.tile(bytes_of(GREEN), (int(seen.sum()), 1)),
            radii=np.full(int(seen.sum()), GHOST_RADIUS * share * unit_m),
        )
        columns[name] = values.partition(seen.sum(axis=1))
    return columns


def rest_lines(rerun: Any, structure: Structure, node_position_m: NDArray[np.float64]) -> Any:
    """Return thin grey rods and tendons at (nodes, 3) the rest shape."""
    pairs = np.concatenate([structure.rods, structure.tendons])
    radius_m = GHOST_RADIUS * TENDON_RADIUS * float(structure.rod_length_m.mean())
    return rerun.LineStrips3D(list(node_position_m[pairs]), colors=bytes_of(GREY), radii=radius_m)


def tendon_colors(result: Reconstruction) -> NDArray[np.uint8]:
    """Return (frames, tendons, 4) colours by the strain of the shape; orange where bent, grey without a reading."""
    strain = result.predicted_m / result.structure.natural_length_m - 1
    knots = np.array([bytes_of(color) for color in STRAIN_COLORS.values()])
    channels = [np.interp(strain, list(STRAIN_COLORS), knots[:, channel]) for channel in range(4)]
    colors = np.round(np.stack(channels, axis=-1)).astype(np.uint8)
    colors[result.mode == Mode.BENDING] = bytes_of(ORANGE)
    colors[np.isnan(result.length_m)] = bytes_of(GREY)
    return colors


def bytes_of(color: str, opacity: float = 1.0) -> NDArray[np.uint8]:
    """Return (4,) red, green, blue and opacity, from 0 to 255, of a colour such as #0072B2."""
    return np.round(255 * np.array(color_of(color, opacity))).astype(np.uint8)


def _lines(
    rerun: Any, result: Reconstruction, pairs: NDArray[np.int64], colors: NDArray[np.uint8], radius_m: float
) -> Any:
    """Return a line between the nodes of each pair in every frame, with (frames, pairs, 4) colours."""
    strips = result.node_position_m[:, pairs].reshape(-1, 2, 3)
    values = rerun.LineStrips3D.columns(
        strips=list(strips), colors=colors.reshape(-1, 4), radii=np.full(len(strips), radius_m)
    )
    return values.partition([len(pairs)] * len(result))


def _marked_tendons(rerun: Any, result: Reconstruction, unit_m: float) -> Any:
    """Return a labelled point at the middle of each tendon that is bent or without a reading."""
    dead = np.isnan(result.length_m)
    frame, tendon = np.nonzero(dead | (result.mode == Mode.BENDING))
    words = np.where(dead[frame, tendon], "no reading", "bent")
    values = rerun.Points3D.columns(
        positions=result.node_position_m[frame[:, None], result.structure.tendons[tendon]].mean(axis=1),
        colors=np.where(dead[frame, tendon, None], bytes_of(GREY), bytes_of(ORANGE)),
        radii=np.full(len(frame), MARK_RADIUS * unit_m),
        labels=[f"{e} {word}" for e, word in zip(tendon, words, strict=True)],
        show_labels=np.ones(len(frame), dtype=bool),
    )
    return values.partition(np.bincount(frame, minlength=len(result)))


def _nodes(rerun: Any, result: Reconstruction, unit_m: float) -> Any:
    """Return a point at each node, green at anchors, whose number shows under the mouse."""
    s = result.structure
    colors = np.tile(bytes_of(BLACK), (s.node_count, 1))
    colors[s.anchors] = bytes_of(GREEN)
    radii_m = np.full(s.node_count, NODE_RADIUS * unit_m)
    radii_m[s.anchors] = MARK_RADIUS * unit_m
    values = rerun.Points3D.columns(
        positions=result.node_position_m.reshape(-1, 3),
        colors=np.tile(colors, (len(result), 1)),
        radii=np.tile(radii_m, len(result)),
        labels=[f"node {node}" for node in range(s.node_count)] * len(result),
        show_labels=np.zeros(s.node_count * len(result), dtype=bool),
    )
    return values.partition([s.node_count] * len(result))


def _ellipsoids(rerun: Any, result: Reconstruction, probability: float, scale: int) -> Any:
    """Return the ellipsoid of each free node in every frame, `scale` times as large as it is."""
    free = result.structure.free_nodes
    regions = result.ellipsoids(probability)
    count = len(free) * len(result)
    values = rerun.Ellipsoids3D.columns(
        centers=result.node_position_m[:, free].reshape(-1, 3),
        half_sizes=scale * regions.semi_axis_m[:, free].reshape(-1, 3),
        quaternions=regions.quaternion[:, free].reshape(-1, 4),
        colors=np.tile(bytes_of(RED, OPACITY), (count, 1)),
        fill_mode=[rerun.components.FillMode.Solid] * count,
    )
    return values.partition([len(free)] * len(result))


def _loads(rerun: Any, result: Reconstruction, load_threshold_n: float, unit_m: float) -> Any:
    """Return an arrow that ends at each loaded node, and tells its force."""
    assert result.loads is not None
    frame, node = np.nonzero(result.loads.is_certain(load_threshold_n))
    force_n = result.loads.force_n[frame, node]
    size_n = np.linalg.norm(force_n, axis=-1)
    push_m = force_n * np.minimum(LOAD_M_PER_N, LONGEST_LOAD * unit_m / size_n)[:, None]
    values = rerun.Arrows3D.columns(
        origins=result.node_position_m[frame, node] - push_m,
        vectors=push_m,
        colors=np.tile(bytes_of(PURPLE), (len(frame), 1)),
        radii=np.full(len(frame), ROD_RADIUS * unit_m),
        labels=[f"{newton:.1f} N" for newton in size_n],
    )
    return values.partition(np.bincount(frame, minlength=len(result)))
