"""An unscented Kalman filter, for comparison.

This is the only module that imports filterpy; it is imported only when this method is chosen.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from ...factors.noise import tendon_sigma_m
from ...models.settings import Settings
from ...models.structure.lengths import member_length_m
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import IndeterminateError
from ...models.values.readings import TendonLengths
from ..graph import status_of


class UnscentedKalman:
    """An unscented Kalman filter of all node coordinates, which follow a random walk (Caluwaerts et al., ICRA 2016).

    Rods, tendons and anchors are measurements in each frame. The step of the random walk is derived from the motion
    prior: its sigma is q sqrt(dt) times 0.2 s, the time in which a hand changes its push. The covariance of the rest
    shape, from which lengths are tared, is added to the filter's.
    """

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._structure = structure
        self._noise = settings.noise
        self._members = np.concatenate([structure.rods, structure.tendons])
        self._last_s: float | None = None
        size = 3 * structure.node_count
        rods = len(structure.rods)
        anchor_coordinates = 3 * len(structure.anchors)
        points = MerweScaledSigmaPoints(size, alpha=1e-3, beta=2.0, kappa=3.0 - size)
        measurements = len(self._members) + anchor_coordinates
        self._filter = UnscentedKalmanFilter(size, measurements, 1.0, self._measure, lambda x, dt: x, points)
        self._filter.x = rest.node_position_m.ravel().copy()
        self._rest_covariance_m2 = rest.covariance_m2
        self._filter.P = rest.covariance_m2 + self._noise.anchor_m**2 * np.eye(size)
        self._fixed = np.concatenate([structure.rod_length_m, structure.anchor_position_m.ravel()])
        self._variance = np.concatenate(
            [np.full(rods, self._noise.rod_m**2), np.full(anchor_coordinates, self._noise.anchor_m**2)]
        )

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape in one more frame.

        Raises:
            IndeterminateError: when rounding errors have made an eigenvalue of the covariance negative.
        """
        step_s = lengths.t_s - self._last_s if self._last_s is not None else 0.02
        self._last_s = lengths.t_s
        sigma_m = tendon_sigma_m(lengths, self._noise)
        usable = np.isfinite(sigma_m)
        rods = len(self._structure.rods)
        predicted = self._structure.tendon_length_m(self._filter.x.reshape(-1, 3))
        # a missing length is replaced by its prediction with a sigma of one metre, which has no effect
        length_m = np.where(usable, lengths.length_m, predicted)
        variance = np.where(usable, sigma_m, 1.0) ** 2
        self._filter.Q = np.eye(len(self._filter.x)) * (self._noise.motion_m_per_s15 * 0.2) ** 2 * step_s
        z = np.concatenate([self._fixed[:rods], length_m, self._fixed[rods:]])
        self._filter.R = np.diag(np.concatenate([self._variance[:rods], variance, self._variance[rods:]]))
        try:
            self._filter.predict(dt=step_s)
            self._filter.update(z)
        except np.linalg.LinAlgError as error:
            raise IndeterminateError(
                f"t = {lengths.t_s:.3f} s: the filter's covariance is no longer positive definite"
            ) from error
        self._filter.P = 0.5 * (self._filter.P + self._filter.P.T) + 1e-12 * np.eye(len(self._filter.x))
        position = self._filter.x.reshape(-1, 3).copy()
        return Shape(
            t_s=lengths.t_s,
            node_position_m=position,
            covariance_m2=self._filter.P + self._rest_covariance_m2,
            status=status_of(lengths, self._structure),
            lengths=lengths,
        )

    def _measure(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the predicted measurements at a state: lengths of rods and tendons, coordinates of anchors."""
        position = x.reshape(-1, 3)
        return np.concatenate([member_length_m(position, self._members), position[self._structure.anchors].ravel()])
