"""What is expected of one frame before its aids are read: the placed shape, and the covariance of its errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.pose.placed import PlacedShape


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A shape placed by the predicted state."""

    placed: PlacedShape
    transition: NDArray[np.float64]
    """(size, size) F, from the errors of the frame before."""
    covariance: NDArray[np.float64]
    """(size, size) P, of the errors of the state."""

    def then(self, placed: PlacedShape, F: NDArray[np.float64], variance: NDArray[np.float64]) -> "Prediction":
        """Return the prediction after a further change, F P F^T + V.

        Args:
            placed: the shape after it.
            F: (size, size) its derivative.
            variance: (size,) that it adds, the diagonal of V.
        """
        covariance = F @ self.covariance @ F.T
        covariance[np.diag_indices(len(variance))] += variance
        return Prediction(placed, F @ self.transition, covariance)
