"""The live estimator: iSAM2 over the last few frames; older frames are marginalised into a prior."""

from collections import deque
from collections.abc import Iterable, Iterator

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..factors.keys import key_list
from ..factors.noise import WeightedLengths, unit, weigh
from ..models.settings import Settings
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Reason, Shape
from ..models.structure.structure import Structure
from ..models.values.errors import UNDETERMINED, IndeterminateError
from ..models.values.readings import TendonLengths
from .branches import OtherBranch
from .changes.change_watch import ChangeWatch
from .doubt import ModelDoubt
from .graph import GraphBuilder, status_of
from .health import SensorHealth
from .lag_compensation import LagCompensation
from .lasting_errors import LastingErrors
from .linear_frame import LinearFrame, linearised
from .mode_choice import BATCH_SHARE, ModeChoice
from .sensor_drift import OwnDrift, is_of_a_board
from .uncertainty import FrameEvidence
from .watches.past_motion import PastMotion
from .watches.rebound_watch import ReboundWatch
from .watches.steady_load import SteadyLoad

FIRST_BYSTANDER = 2**60
"""Key of the first of `_bystanders`, beyond those of all frames."""
SETTLED_M = 0.001
"""Change of a position below which a frame is not updated again. After a second without frames, as when live is behind,
nodes of a robot that was pressed meanwhile have moved by centimetres, and one update leaves a fifth of it."""
MOST_UPDATES = 6
"""Largest number of iSAM2 updates for one frame. Where all frames are optimised later on, one is better: frames
that had settled were worse starts on seven of eight slack trials of the twin, by 1 to 6 % of the error."""
LONGEST_AHEAD = 10.0
"""Ratio of a time step to the one before it above which that was too short to tell a velocity: of two frames that are
0.1 ms apart, the noise of their positions is 10 m/s."""
AHEAD_S = 0.045
"""Time from one frame to the next up to which the next one starts ahead of the last shape. In a slower row a slack
structure that collapses has moved by centimetres, and the next start would be as far off: exact lengths at 10 Hz were
12 to 16 mm off in six of sixteen runs on four trials of the twin, and from the last shape they are 2.7 mm off at most.
"""

INDETERMINATE = "linear system detected while working near variable"
"""Words of gtsam's error when the factors leave a variable undetermined."""


class LiveSmoother:
    """Estimates the shape in the newest frame from this and all earlier frames, in bounded time and memory."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self.builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self.builder, settings.doubt)
        self._health = SensorHealth(self.builder, settings.health, settings.doubt.load_n) if rest.mechanics else None
        self.doubt = ModelDoubt(self.builder, settings.doubt)
        self.changes = ChangeWatch(self.builder)
        self.rebounds = ReboundWatch(rest, settings.doubt.load_n)
        self._steady_load = SteadyLoad(rest, settings.doubt.load_n)
        self._past = PastMotion(structure.free_coordinates)
        self._compensation = LagCompensation()
        self._lasting = LastingErrors(structure, rest)
        self.modes = ModeChoice(self.builder, settings.front_end.ambiguous_probability)
        self.drift = OwnDrift(self.builder, settings.drift)
        self._branches = OtherBranch(self.builder, settings.branch)
        # gtsam orders the nodes of an update by the age of their frames, and has no more ages than the update has nodes
        of_update = structure.node_count + len(structure.free_nodes)
        self._lag = max(min(settings.smoother.lag, of_update - 1), 2)
        self._most_updates = MOST_UPDATES
        self.ahead_s = AHEAD_S
        """Time to the next frame up to which that starts ahead of the last shape."""
        self._isam = gtsam.ISAM2(_isam2_parameters(settings.smoother.relinearize_m))
        self._isam.update(*_bystanders(structure.node_count))
        self.linear: LinearFrame | None = None
        """The factors of the newest frame, linearised at its shape."""
        self._frame = 0
        self._times_s: deque[float] = deque(maxlen=3)
        self._positions: deque[NDArray[np.float64]] = deque([rest.node_position_m] * 2, maxlen=2)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield the shape at the time of each frame, as soon as the frame arrives."""
        return map(self.now, map(self.update, frames))

    def now(self, shape: Shape) -> Shape:
        """Return the shape of the last `update` at the time of its frame, with the errors that last."""
        return self._lasting.observe(self._compensation.now(shape), self.doubt.present.error_scale)

    def keep(self, ahead_s: float = AHEAD_S) -> None:
        """Keep what is learned in each frame, for a smoother, and update each once; live, memory is bounded."""
        self._most_updates = 1
        self.ahead_s = ahead_s
        self.modes.kept, self.modes.share = [], BATCH_SHARE
        self.drift.kept = []
        self.doubt.kept = []
        self.changes.kept = []

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape that one more frame shows, with a second one where there is one.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        return self._branches.with_other(self.first_shape(lengths))

    def first_shape(self, lengths: TendonLengths) -> Shape:
        """Return the shape in one more frame, without the search for a second one.

        Raises:
            IndeterminateError: see `update`.
        """
        try:
            return self._first_shape(lengths)
        except np.linalg.LinAlgError as error:
            raise IndeterminateError(f"t = {lengths.t_s:.3f} s: {UNDETERMINED}") from error

    def _first_shape(self, lengths: TendonLengths) -> Shape:
        self.doubt.see(lengths)
        before = self.doubt.present
        scale = before.length_scale
        inexact = None if before.reason is Reason.MOTION else before.inexact
        steady = self.drift.admit(self.modes.choose(lengths), inexact)
        measured = weigh(steady, self.builder.noise).scaled(scale)
        if self._health and self.drift.begins:  # those that were left out before may have drifted
            self._health.use_all()
        admitted = self._health.admit(measured) if self._health else measured
        self._times_s.append(lengths.t_s)
        position = self._smoothed(admitted)
        frame = linearised(self.builder, position, admitted)
        self.linear = frame
        self.doubt.observe(lengths.t_s, frame, scale)
        doubt = self.doubt.present
        assessment = self._evidence.assess(frame, position, doubt)
        self._forget()
        self._frame += 1
        self._positions.append(position)
        status = status_of(admitted.lengths, self.builder.structure, doubt.reason)
        shape = assessment.shape(admitted.lengths, status, doubt.reason)
        self.changes.observe(frame, shape, scale)
        if self._health:
            self._health.observe(shape, measured, self.changes.explains_more)
            if self._health.something_changed:
                self.changes.believe()
        self.drift.observe(shape)
        self.builder.approach(position)
        self.modes.observe(shape, admitted)
        shape = shape.widened_by_step(self.builder.structure.free_coordinates, assessment.apart_m)
        shape = self.changes.doubted(shape)
        if is_of_a_board(shape.lengths.drift):
            shape = shape.in_doubt(Reason.BOARD)
        return self._past.observe(self._steady_load.observe(self.rebounds.observe(shape)))

    def _smoothed(self, measured: WeightedLengths) -> NDArray[np.float64]:
        """Add the newest frame to the graph, and return its (nodes, 3) positions."""
        graph = gtsam.NonlinearFactorGraph()
        if self._frame == 0:
            self.builder.begin(measured.lengths)
        self.builder.add_frame(graph, self._frame, measured)
        self.builder.add_motion(graph, self._frame, self._times_s)
        if self._frame == 0 and not self.builder.starts_at_rest:
            start_m = self.builder.search(measured, self.builder.rest.node_position_m).finished().node_position_m
            self._positions.extend([start_m] * 2)
        values = gtsam.Values()
        keys = list(self.builder.keys(self._frame))
        position = self._predict()
        for key, start_m in zip(keys, position, strict=True):
            values.insertPoint3(key, start_m)
        for _ in range(self._most_updates):
            before, position = position, self._updated(graph, values, keys)
            if np.abs(position - before).max() < SETTLED_M:
                break
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        return position

    def _updated(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int]) -> NDArray[np.float64]:
        """Return the (nodes, 3) positions of the newest frame after an update with more factors and nodes, or none."""
        try:
            self._isam.update(graph, values, self._update_parameters())
        except RuntimeError as error:
            if INDETERMINATE not in str(error):
                raise
            raise np.linalg.LinAlgError(UNDETERMINED) from error
        return np.array(gtsam.utilities.extractPoint3(self._isam.calculateEstimate(keys)))

    def _predict(self) -> NDArray[np.float64]:
        """Return the (nodes, 3) positions that the nodes reach at constant velocity; the last ones after `ahead_s`.

        Two frames that are close together tell no velocity, either.
        """
        before, last = self._positions
        if len(self._times_s) < 3:
            return last
        t0, t1, t2 = self._times_s
        if t2 - t1 > min(self.ahead_s, LONGEST_AHEAD * (t1 - t0)):
            return last
        return last + (last - before) * (t2 - t1) / (t1 - t0)

    def _update_parameters(self) -> gtsam.ISAM2UpdateParams:
        """Return parameters that eliminate the frames in order of their age.

        The oldest frame is then a leaf, which can be marginalised, and the newest frame is the root. Only the frames
        that share a factor with the newest one are eliminated again.
        """
        groups = gtsam.KeyGroupMap()
        oldest = max(self._frame - self._lag, 0)
        for frame in range(oldest, self._frame + 1):
            for key in self.builder.keys(frame):
                groups.insert2(key, frame - oldest)
        parameters = gtsam.ISAM2UpdateParams()
        parameters.constrainedKeys = groups
        return parameters

    def _forget(self) -> None:
        """Marginalise the frame that is now older than the lag."""
        if self._frame >= self._lag:
            self._isam.marginalizeLeaves(key_list(self.builder.keys(self._frame - self._lag)))


def _bystanders(node_count: int) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Return nodes that are in no frame, with which an update touches less than 65 % of all nodes.

    If it touches more, gtsam linearises all factors anew. Without anchors, an update touches two of three frames.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key in range(FIRST_BYSTANDER, FIRST_BYSTANDER + 1 + node_count // 12):
        values.insertPoint3(key, np.zeros(3))
        graph.addPriorPoint3(key, np.zeros(3), unit(3))
    return graph, values


def _isam2_parameters(relinearize_m: float) -> gtsam.ISAM2Params:
    gauss_newton = gtsam.ISAM2GaussNewtonParams()
    gauss_newton.setWildfireThreshold(1e-5)
    parameters = gtsam.ISAM2Params()
    parameters.setOptimizationParams(gauss_newton)
    parameters.setRelinearizeThreshold(relinearize_m)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters
