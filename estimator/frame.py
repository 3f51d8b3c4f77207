"""One frame, no memory: its own graph, optimised from the rest shape."""

from collections.abc import Iterable, Iterator

import gtsam
import numpy as np

from ..factors.noise import tendon_sigma_m
from ..models.readings import TendonLengths
from ..models.rest import RestShape
from ..models.settings import Settings
from ..models.shape import Shape, Status
from ..models.structure import Structure
from .graph import GraphBuilder, status_of
from .uncertainty import FrameEvidence

MAX_ITERATIONS = 100


class FrameEstimator:
    """Estimates each frame by itself with Levenberg-Marquardt."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(structure, rest, settings.noise)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape of one frame.

        Raises:
            IndeterminateError: when nothing holds some node.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._builder.add_frame(graph, 0, lengths)
        keys = list(self._builder.keys(0))
        for key, position in zip(keys, self._builder.rest.node_position_m, strict=True):
            values.insertPoint3(key, position)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(MAX_ITERATIONS)
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
        position = np.array(gtsam.utilities.extractPoint3(optimizer.optimize()))
        covariance, loads = self._evidence.assess(position, tendon_sigma_m(lengths, self._builder.noise))
        converged = optimizer.iterations() < MAX_ITERATIONS
        status = status_of(lengths, self._builder.structure) if converged else Status.NOT_CONVERGED
        return Shape(lengths.t_s, position, covariance, status, lengths, loads)
