"""Positions of markers as motion capture records them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class MarkerTracks:
    """Positions of markers on the capture's own clock and in its own axes, whichever of them points upward."""

    t_s: NDArray[np.float64]
    """(times,) increasing, capture clock."""
    names: tuple[str, ...]
    """Name of each marker, all different."""
    position_m: NDArray[np.float64]
    """(times, markers, 3); nan where a marker was hidden."""
