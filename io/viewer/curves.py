"""Frames of a run over time, as columns for Rerun: lengths with bands, sigma, innovations, and the status."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure.reconstruction import Reconstruction
from ...models.structure.shape import Reason, Status
from ...models.structure.structure import Structure
from ..figures.style import BAND, BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY_BLUE
from .scene import bytes_of

LENGTH_LINES = {
    "measured": (BLUE, 2.0),
    "of the shape": (BLACK, 1.0),
    "95 % band, low": (SKY_BLUE, 1.0),
    "95 % band, high": (SKY_BLUE, 1.0),
}
"""Name, colour and width of each line in the panel of a tendon, in the order of the scalars."""
STATUS_COLORS = {
    Status.OK: GREEN,
    Status.PARTIAL: SKY_BLUE,
    Status.TWO_SHAPES: PURPLE,
    Status.DOUBT: ORANGE,
    Status.PRIOR_ONLY: GREY,
    Status.NOT_CONVERGED: RED,
    Status.FAILED: RED,
}


def curve_columns(rerun: Any, result: Reconstruction) -> dict[str, Any]:
    """Return the quantities over time, by the name of their entity, with a row for each frame.

    Of `length_m/TENDON` the scalars are those of `LENGTH_LINES`, nan where no length was measured; of `sigma_m` one for
    each free node; of `innovation` one for each tendon, (measured - predicted) / sigma of the difference. A run without
    covariance has neither of the last two.
    """
    half_m = BAND * np.where(np.isfinite(result.sigma_m), result.sigma_m, np.nan)
    lengths_m = [result.length_m, result.predicted_m, result.length_m - half_m, result.length_m + half_m]
    columns = {
        f"length_m/{e}": _scalars(rerun, np.stack([line[:, e] for line in lengths_m], axis=1))
        for e in range(len(result.structure.tendons))
    }
    if np.isfinite(result.node_covariance_m2).all():
        columns["sigma_m"] = _scalars(rerun, result.node_sigma_m[:, result.structure.free_nodes])
        innovation = (result.length_m - result.predicted_m) / result.innovation_sigma_m
        columns["innovation"] = _scalars(rerun, innovation)
    return columns


def curve_styles(rerun: Any, structure: Structure) -> dict[str, Any]:
    """Return names and colours of the lines, by the name of their entity."""
    lines = rerun.SeriesLines(
        names=list(LENGTH_LINES),
        colors=[bytes_of(color) for color, _ in LENGTH_LINES.values()],
        widths=[width for _, width in LENGTH_LINES.values()],
    )
    nodes = [f"node {node}" for node in structure.free_nodes]
    tendons = [f"tendon {e}" for e in range(len(structure.tendons))]
    words = {status_text(status, None): color for status, color in STATUS_COLORS.items()}
    words |= {status_text(Status.DOUBT, reason): ORANGE for reason in Reason}
    return {
        **{f"length_m/{e}": lines for e in range(len(tendons))},
        "sigma_m": rerun.SeriesLines(names=nodes),
        "innovation": rerun.SeriesLines(names=tendons),
        "status": rerun.StateConfiguration(values=list(words), colors=[bytes_of(color) for color in words.values()]),
    }


def status_text(status: Status, doubt: Reason | None) -> str:
    """Return a status, with the reason of a doubt."""
    return f"{status}: {doubt}" if doubt else str(status)


def status_changes(result: Reconstruction, before: str) -> tuple[NDArray[np.float64], list[str]]:
    """Return the times at which the status changes, and what it is from then on.

    Args:
        result: the frames.
        before: status of the frame before the first; empty if there was none.
    """
    doubts: Iterable[Reason | None] = result.doubts or (None,) * len(result)
    texts = [status_text(status, doubt) for status, doubt in zip(result.status, doubts, strict=True)]
    changed = [k for k, text in enumerate(texts) if text != (texts[k - 1] if k else before)]
    return result.t_s[changed], [texts[k] for k in changed]


def _scalars(rerun: Any, values: NDArray[np.float64]) -> Any:
    """Return the (frames, scalars) values of one entity."""
    return rerun.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
