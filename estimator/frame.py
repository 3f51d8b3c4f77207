"""The estimator of single frames: each frame has its own graph, optimised from the rest shape."""

from collections.abc import Iterable, Iterator

from ..factors.noise import weigh
from ..models.settings import Settings
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape, Status
from ..models.structure.structure import Structure
from ..models.values.readings import TendonLengths
from .branches import OtherBranch
from .graph import GraphBuilder, status_of
from .linear_frame import linearised
from .uncertainty import FrameEvidence


class FrameEstimator:
    """Estimates each frame without any other frame, by Levenberg-Marquardt."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder, settings.doubt)
        self._branch = OtherBranch(self._builder, settings.branch)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape of one frame.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        measured = weigh(lengths, self._builder.noise)
        minimum = self._builder.search(measured, self._builder.rest.node_position_m).finished()
        position = minimum.node_position_m
        assessment = self._evidence.assess(linearised(self._builder, position, measured), position)
        status = status_of(lengths, self._builder.structure) if minimum.converged else Status.NOT_CONVERGED
        shape = self._branch.with_other_at_once(assessment.shape(lengths, status), minimum.error)
        return shape.widened_by_step(self._builder.structure.free_coordinates, assessment.apart_m)
