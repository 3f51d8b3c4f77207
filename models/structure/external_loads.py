"""External forces at the nodes, as they are estimated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LOAD_THRESHOLD_N = 0.2
"""Threshold above which a node counts as loaded. On the development trials the estimated load at unloaded nodes is 0.03
to 0.06 N rms while nothing is pressed, and it exceeds the threshold at 0.5 to 2 % of them."""

SURE = 2.0
"""Ratio of a load to its sigma above which it is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class ExternalLoads:
    """Estimated external forces at the nodes; leading axes are frames."""

    force_n: NDArray[np.float64]
    """(..., nodes, 3) nan at anchors, and where a frame failed; zero along the rod if that part is not observable."""
    sigma_n: NDArray[np.float64]
    """(..., nodes) root mean square of the standard deviations along the observable directions; inf where the force is
    nan."""

    @classmethod
    def unknown(cls, node_count: int) -> "ExternalLoads":
        """Return the loads of a frame that tells nothing of them: nan, with a sigma of inf."""
        return cls(np.full((node_count, 3), np.nan), np.full(node_count, np.inf))

    def part(self, frames: int | slice) -> "ExternalLoads":
        """Return those of some frames."""
        return ExternalLoads(self.force_n[frames], self.sigma_n[frames])

    def is_certain(self, threshold_n: float) -> NDArray[np.bool_]:
        """Return (..., nodes) where a load is above a threshold, and above `SURE` times its sigma."""
        size_n = np.linalg.norm(np.nan_to_num(self.force_n), axis=-1)
        return np.asarray(size_n > np.maximum(threshold_n, SURE * self.sigma_n))

    def turned(self, turn: NDArray[np.float64]) -> "ExternalLoads":
        """Return the loads in the world, given (3, 3) the turn of the axes in which these are."""
        return ExternalLoads(self.force_n @ turn.T, self.sigma_n)
