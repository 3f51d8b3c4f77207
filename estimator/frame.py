"""One frame, no memory: its own graph, optimised from the rest shape."""

from collections.abc import Iterable, Iterator

from ..models.settings import Settings
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape, Status
from ..models.structure.structure import Structure
from ..models.values.readings import TendonLengths
from .graph import GraphBuilder, status_of
from .uncertainty import FrameEvidence


class FrameEstimator:
    """Estimates each frame by itself with Levenberg-Marquardt."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape of one frame.

        Raises:
            IndeterminateError: when nothing holds some node.
        """
        found = self._builder.minimum(lengths, self._builder.rest.node_position_m)
        position = found.node_position_m
        covariance, loads = self._evidence.assess(position, lengths)
        status = status_of(lengths, self._builder.structure) if found.converged else Status.NOT_CONVERGED
        return Shape(lengths.t_s, position, covariance, status, lengths, loads)
