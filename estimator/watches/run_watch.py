"""What is watched in one run, whatever its method: lengths that are told, the rest, and factors of one's own."""

from ...models.sensor.gate import GateSettings
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.trial_description import TrialDescription
from ...models.values.readings import TendonLengths
from .factor_watch import FactorWatch
from .lengths_watch import AnchorWatch, RepeatWatch, RestWatch


class RunWatch:
    """Takes the lengths and the shapes of one run, and tells what is in doubt."""

    def __init__(self, trial: TrialDescription, rest: RestShape, settings: GateSettings) -> None:
        is_told = trial.source == "lengths"
        at_rest = is_told and trial.rest_seconds > 0 and trial.rest_position_m is not None
        self._rest_watch = RestWatch(rest.lengths(trial.rest_seconds)) if at_rest else None
        joins_anchors = trial.structure.joins_anchors
        self._anchor_watch = AnchorWatch(rest.lengths(0.0), joins_anchors) if is_told else None
        self._repeat_watch = RepeatWatch(trial.rest_seconds, settings) if is_told else None
        self._is_rest_shape_doubted = rest.is_doubted
        self._rest_in_doubt = False
        self.factors = FactorWatch()

    def take(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths of one more frame, which the estimator takes; the last ones tell of the rest."""
        self._rest_in_doubt = lengths.rest_in_doubt
        for watch in (self._rest_watch, self._anchor_watch):
            if watch:
                watch.observe(lengths)
        return lengths

    def observe(self, shape: Shape) -> Shape:
        """Return the shape of one more frame, in doubt where something speaks against it.

        What counts is what was known of the rest in the last frame that the estimator took: live that of the shape, and
        in batch the last of the trial.

        Raises:
            InputError: see `FactorWatch.observe`.
        """
        shape = self.factors.observe(shape)
        if self._repeat_watch:
            self._repeat_watch.observe(shape)
            if self._repeat_watch.in_doubt:
                shape = shape.in_doubt(Reason.SENSORS)
        if self._rest_in_doubt or self.misfits_at_rest:
            return shape.in_doubt(Reason.REST)
        anchors_are = self._anchor_watch is not None and self._anchor_watch.in_doubt
        if self._is_rest_shape_doubted or anchors_are:
            return shape.in_doubt(Reason.GEOMETRY)
        return shape.in_doubt(Reason.SENSORS) if self._is_wrong_length_used(shape.lengths) else shape

    def _is_wrong_length_used(self, lengths: TendonLengths) -> bool:
        """Return whether a length is used that was not that of the rest shape; `live` and `batch` leave it out."""
        return self._rest_watch is not None and bool((self._rest_watch.differs & lengths.usable).any())

    @property
    def misfits_at_rest(self) -> bool:
        """Whether lengths that are told do not fit the rest shape, see `RestWatch.in_doubt`."""
        return self._rest_watch is not None and self._rest_watch.in_doubt
