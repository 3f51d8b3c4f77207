"""Positions of nodes and of markers at known times."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class StampedPositions:
    """Positions of nodes with the times at which they were measured or estimated, as in shape.csv and truth.csv."""

    t_s: NDArray[np.float64]
    """(times,) increasing, host clock."""
    node_position_m: NDArray[np.float64]
    """(times, nodes, 3); nan where a node was not measured."""

    def without_coinciding(self) -> "StampedPositions":
        """Return the positions, nan for nodes at the very place of another, as programs write what was out of sight."""
        x = self.node_position_m
        same = (x[:, :, None] == x[:, None]).all(axis=-1) & ~np.eye(x.shape[1], dtype=bool)
        return StampedPositions(self.t_s, np.where(same.any(axis=-1)[..., None], np.nan, x))


@dataclass(frozen=True, slots=True, eq=False)
class MarkerTracks:
    """Positions of markers on the capture's own clock and in its own axes, whichever of them points upward."""

    t_s: NDArray[np.float64]
    """(times,) increasing, capture clock."""
    names: tuple[str, ...]
    """Name of each marker, all different."""
    position_m: NDArray[np.float64]
    """(times, markers, 3); nan where a marker was hidden."""
