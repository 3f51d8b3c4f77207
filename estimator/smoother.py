"""Frame by frame with a short memory: iSAM2 over the last few frames, older ones marginalised into a prior."""

from collections import deque
from collections.abc import Iterable, Iterator

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..factors.keys import key_list
from ..models.settings import Settings
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape
from ..models.structure.structure import Structure
from ..models.values.errors import IndeterminateError
from ..models.values.readings import TendonLengths
from .branches import OtherBranch
from .drift import OwnDrift
from .graph import GraphBuilder, status_of
from .health import SensorHealth
from .uncertainty import FrameEvidence


class LiveSmoother:
    """Gives the newest frame's shape from this and all earlier frames, in bounded time and memory."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder)
        self._health = SensorHealth(self._builder, settings.health) if rest.mechanics else None
        self.drift = OwnDrift(self._builder, settings.drift)
        self._branches = OtherBranch(self._builder, settings.branch)
        self._lag = settings.smoother.lag
        self._isam = gtsam.ISAM2(_isam2_parameters(settings.smoother.relinearize_m))
        self._frame = 0
        self._times_s: deque[float] = deque(maxlen=3)
        self._positions: deque[NDArray[np.float64]] = deque([rest.node_position_m] * 2, maxlen=2)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame, as soon as it comes."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape at one more frame.

        Raises:
            IndeterminateError: when nothing holds some node.
        """
        read = self.drift.admit(lengths)
        lengths = self._health.admit(read) if self._health else read
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._times_s.append(lengths.t_s)
        self._builder.add_frame(graph, self._frame, lengths)
        self._builder.add_motion(graph, self._frame, self._times_s)
        keys = list(self._builder.keys(self._frame))
        if self._frame == 0 and not self._builder.rest.at_start:
            start_m = self._builder.minimum(lengths, self._builder.rest.node_position_m).node_position_m
            self._positions.extend([start_m] * 2)
        for key, position in zip(keys, self._predict(), strict=True):
            values.insertPoint3(key, position)
        try:
            self._isam.update(graph, values, self._update_parameters())
            position = np.array(gtsam.utilities.extractPoint3(self._isam.calculateEstimate(keys)))
            covariance, loads = self._evidence.assess(position, lengths)
        except RuntimeError as error:
            raise IndeterminateError(f"t = {lengths.t_s:.3f} s: {str(error).splitlines()[0]}") from error
        self._forget()
        self._frame += 1
        self._positions.append(position)
        status = status_of(lengths, self._builder.structure)
        shape = Shape(lengths.t_s, position, covariance, status, lengths, loads)
        if self._health:
            self._health.observe(shape, read)
        self.drift.observe(shape)
        return self._branches.told(shape)

    def _predict(self) -> NDArray[np.float64]:
        """Return where the nodes are if they keep their velocity."""
        before, last = self._positions
        if len(self._times_s) < 3:
            return last
        t0, t1, t2 = self._times_s
        return last + (last - before) * (t2 - t1) / (t1 - t0)

    def _update_parameters(self) -> gtsam.ISAM2UpdateParams:
        """Eliminate frames in order of age.

        The oldest is then a leaf to marginalise, the newest the root, and only the frames that the newest one touches
        are eliminated anew.
        """
        groups = gtsam.KeyGroupMap()
        oldest = max(self._frame - self._lag, 0)
        for frame in range(oldest, self._frame + 1):
            for key in self._builder.keys(frame):
                groups.insert2(key, frame - oldest)
        parameters = gtsam.ISAM2UpdateParams()
        parameters.constrainedKeys = groups
        return parameters

    def _forget(self) -> None:
        """Marginalise the frame that falls out of the lag."""
        if self._frame >= self._lag:
            self._isam.marginalizeLeaves(key_list(self._builder.keys(self._frame - self._lag)))


def _isam2_parameters(relinearize_m: float) -> gtsam.ISAM2Params:
    gauss_newton = gtsam.ISAM2GaussNewtonParams()
    gauss_newton.setWildfireThreshold(1e-5)
    parameters = gtsam.ISAM2Params()
    parameters.setOptimizationParams(gauss_newton)
    parameters.setRelinearizeThreshold(relinearize_m)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters
