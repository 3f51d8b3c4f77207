"""A run as a recording of the viewer Rerun: shapes in space, and lengths over time."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure.reconstruction import Reconstruction
from ...models.values.extras import needs_extra
from ..figures.style import BLACK, RED, tendon_style
from .solids import OPACITY, ROD_RADIUS, TENDON_RADIUS, color_of


def write_rerun(result: Reconstruction, probability: float, path: Path) -> None:
    """Write rods, tendons and ellipsoids in space, and the length of each tendon as a scalar, on the timeline `t_s`.

    Args:
        result: the run.
        probability: of the ellipsoids.
        path: of the file.

    Raises:
        InputError: when Rerun is not installed.
    """
    with needs_extra("Rerun", "rerun"):
        import rerun
    recording = rerun.RecordingStream("tensegraph")
    recording.save(path)
    space = f"/{result.coordinate_frame}"
    recording.log(space, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    times = [rerun.TimeColumn("t_s", duration=result.t_s)]
    s = result.structure
    rod_colors = np.broadcast_to(_bytes(BLACK), (len(result), len(s.rods), 4))
    unit_m = float(s.rod_length_m.mean())
    columns = {
        f"{space}/rods": _lines(rerun, result, s.rods, rod_colors, ROD_RADIUS * unit_m),
        f"{space}/tendons": _lines(rerun, result, s.tendons, _tendon_colors(result), TENDON_RADIUS * unit_m),
        f"{space}/ellipsoids": _ellipsoids(rerun, result, probability),
        **{f"/length_m/{e}": rerun.Scalars.columns(scalars=result.length_m[:, e]) for e in range(len(s.tendons))},
    }
    for entity, values in columns.items():
        recording.send_columns(entity, times, values)
    recording.flush()
    recording.disconnect()


def _lines(
    rerun: Any, result: Reconstruction, pairs: NDArray[np.int64], colors: NDArray[np.uint8], radius_m: float
) -> Any:
    """Return a line between the nodes of each pair in every frame, with (frames, pairs, 4) colours."""
    strips = result.node_position_m[:, pairs].reshape(-1, 2, 3)
    values = rerun.LineStrips3D.columns(
        strips=list(strips), colors=colors.reshape(-1, 4), radii=np.full(len(strips), radius_m)
    )
    return values.partition([len(pairs)] * len(result))


def _tendon_colors(result: Reconstruction) -> NDArray[np.uint8]:
    """Return (frames, tendons, 4) colours by mode, grey without a reading."""
    styles = [
        _bytes(tendon_style(length_m, int(mode))["color"])
        for length_m, mode in zip(result.length_m.ravel(), result.mode.ravel(), strict=True)
    ]
    return np.array(styles).reshape(*result.mode.shape, 4)


def _ellipsoids(rerun: Any, result: Reconstruction, probability: float) -> Any:
    """Return the ellipsoid of each free node in every frame."""
    free = result.structure.free_nodes
    regions = result.ellipsoids(probability)
    count = len(free) * len(result)
    values = rerun.Ellipsoids3D.columns(
        centers=result.node_position_m[:, free].reshape(-1, 3),
        half_sizes=regions.semi_axis_m[:, free].reshape(-1, 3),
        quaternions=regions.quaternion[:, free].reshape(-1, 4),
        colors=np.tile(_bytes(RED, OPACITY), (count, 1)),
        fill_mode=[rerun.components.FillMode.Solid] * count,
    )
    return values.partition([len(free)] * len(result))


def _bytes(color: str, opacity: float = 1.0) -> NDArray[np.uint8]:
    return np.round(255 * np.array(color_of(color, opacity))).astype(np.uint8)
