"""A whole trial at once: all frames in one graph, Levenberg-Marquardt, covariances of every frame."""

from collections.abc import Callable, Iterable, Iterator

import gtsam
import numpy as np

from ..factors.noise import tendon_sigma_m
from ..models.errors import IndeterminateError
from ..models.readings import TendonLengths
from ..models.rest import RestShape
from ..models.settings import Settings
from ..models.shape import Shape, Status
from ..models.structure import Structure
from .branches import OtherBranch
from .graph import GraphBuilder, status_of
from .live import LiveSmoother
from .uncertainty import FrameEvidence

MAX_ITERATIONS = 50
RELATIVE_DECREASE = 1e-3


class BatchOptimizer:
    """Estimates every frame from all frames, before and after."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(structure, rest, settings.noise)
        self._settings = settings

    def estimate(
        self, frames: Iterable[TendonLengths], progress: Callable[[int, float], None] = lambda iteration, error: None
    ) -> Iterator[Shape]:
        """Yield a shape for each frame, once all have been read.

        Args:
            frames: lengths, in order of time.
            progress: called after each iteration with its number and the graph's error.

        Raises:
            IndeterminateError: when nothing holds some node.
        """
        frames = list(frames)
        graph, values = self._graph(frames)
        try:
            optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, gtsam.LevenbergMarquardtParams())
            converged = _optimize(optimizer, progress)
            branches = OtherBranch(self._builder, self._settings.branch)
            positions = np.array(gtsam.utilities.extractPoint3(optimizer.values())).reshape(len(frames), -1, 3)
            for lengths, position in zip(frames, positions, strict=True):
                covariance, loads = self._evidence.assess(position, tendon_sigma_m(lengths, self._builder.noise))
                status = status_of(lengths, self._builder.structure) if converged else Status.NOT_CONVERGED
                yield branches.told(Shape(lengths.t_s, position, covariance, status, lengths, loads))
        except (RuntimeError, np.linalg.LinAlgError) as error:
            raise IndeterminateError(str(error).splitlines()[0]) from error

    def _graph(self, frames: list[TendonLengths]) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Return the graph of all frames, and the live estimate of each as the start."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        times_s = [lengths.t_s for lengths in frames]
        live = LiveSmoother(self._builder.structure, self._builder.rest, self._settings)
        for frame, shape in enumerate(live.estimate(frames)):
            self._builder.add_frame(graph, frame, shape.lengths)
            self._builder.add_motion(graph, frame, times_s[max(frame - 2, 0) : frame + 1])
            for key, position in zip(self._builder.keys(frame), shape.node_position_m, strict=True):
                values.insertPoint3(key, position)
        return graph, values


def _optimize(optimizer: gtsam.LevenbergMarquardtOptimizer, progress: Callable[[int, float], None]) -> bool:
    """Iterate until the error falls by less than a part in a thousand; return whether it did.

    Along the mechanism the error is so flat that the optimiser would creep for a hundred iterations after a part in
    1e5 of it, which is a tenth of one standard deviation of one length.
    """
    error = optimizer.error()
    for iteration in range(MAX_ITERATIONS):
        optimizer.iterate()
        before, error = error, optimizer.error()
        progress(iteration + 1, error)
        if before - error <= RELATIVE_DECREASE * before:
            return True
    return False
