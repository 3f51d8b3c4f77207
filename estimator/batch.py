"""A whole trial at once: all frames in one graph, Levenberg-Marquardt, covariances of every frame."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..factors.noise import WeightedLengths, weigh
from ..models.settings import Settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape, Status
from ..models.structure.structure import Structure
from ..models.values.errors import IndeterminateError
from ..models.values.readings import TendonLengths
from .branches import OtherBranch
from .graph import GraphBuilder, status_of
from .smoother import LiveSmoother
from .uncertainty import FrameEvidence

MAX_BATCH_ITERATIONS = 50
RELATIVE_DECREASE = 1e-3
PUSH_S = 0.12
"""Standard deviation of the Gaussian that averages loads: 0.3 s at half its height, as a push takes to build up."""
MIN_DAMPING = 1e2
"""In 1 / m^2: a prior of 0.1 m about the last values, ..."""
MAX_DAMPING = 1e10
"""... and one of 0.01 mm."""


class BatchOptimizer:
    """Estimates every frame from all frames, before and after."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder)
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
        problem = self._problem(_without_lag(list(frames)))
        try:
            values, converged = _optimize(problem.graph, problem.start, progress)
            positions = np.array(gtsam.utilities.extractPoint3(values)).reshape(-1, self._builder.node_count, 3)
            assessed = list(map(self._evidence.assess, positions, problem.measured))
        except RuntimeError as error:
            raise IndeterminateError(str(error).splitlines()[0]) from error
        frames = [measured.lengths for measured in problem.measured]
        loads = _over_pushes([assessment.loads for assessment in assessed], frames)
        branches = OtherBranch(self._builder, self._settings.branch)
        for k, lengths in enumerate(frames):
            shape = Shape(
                t_s=lengths.t_s,
                node_position_m=positions[k],
                covariance_m2=assessed[k].covariance_m2,
                status=status_of(lengths, self._builder.structure) if converged else Status.NOT_CONVERGED,
                lengths=lengths,
                loads=loads[k],
            )
            yield branches.with_other(shape)

    def _problem(self, frames: list[TendonLengths]) -> "_Problem":
        """Return the graph of all frames, the live estimate of each as its start."""
        problem = _Problem(gtsam.NonlinearFactorGraph(), gtsam.Values(), [])
        times_s = [lengths.t_s for lengths in frames]
        live = LiveSmoother(self._builder.structure, self._builder.rest, self._settings)
        for frame, shape in enumerate(live.estimate(frames)):
            measured = weigh(shape.lengths, self._builder.noise)
            problem.measured.append(measured)
            self._builder.add_frame(problem.graph, frame, measured)
            self._builder.add_motion(problem.graph, frame, times_s[max(frame - 2, 0) : frame + 1])
            for key, position in zip(self._builder.keys(frame), shape.node_position_m, strict=True):
                problem.start.insertPoint3(key, position)
        return problem


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The graph of a whole trial, with its start."""

    graph: gtsam.NonlinearFactorGraph
    start: gtsam.Values
    measured: list[WeightedLengths]
    """Of each frame, without the sensors that the live estimate left out."""


def _over_pushes(loads: list[ExternalLoads | None], frames: list[TendonLengths]) -> list[ExternalLoads | None]:
    """Return the loads averaged over the time in which a hand builds up a push."""
    known = [each for each in loads if each is not None]
    if len(known) < 2 or len(known) < len(loads):
        return loads
    step_s = float(np.median(np.diff([lengths.t_s for lengths in frames])))
    force_n = gaussian_filter1d(np.array([each.force_n for each in known]), PUSH_S / step_s, axis=0, mode="nearest")
    return [replace(each, force_n=force) for each, force in zip(known, force_n, strict=True)]


def _without_lag(frames: list[TendonLengths]) -> list[TendonLengths]:
    """Return the frames, each with the lengths of the one that is later by the sensors' lag: nobody waits here."""
    t_s = np.array([lengths.t_s for lengths in frames])
    wanted_s = t_s + [lengths.lag_s for lengths in frames]
    after = np.minimum(np.searchsorted(t_s, wanted_s), len(t_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(wanted_s - t_s[before] < t_s[after] - wanted_s, before, after)
    return [replace(frames[later], t_s=lengths.t_s) for lengths, later in zip(frames, nearest, strict=True)]


def _optimize(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, progress: Callable[[int, float], None]
) -> tuple[gtsam.Values, bool]:
    """Return the values at the least error, and whether it was reached: Levenberg-Marquardt.

    The loop is here and not in gtsam's own optimiser because a factor written in Python is handed a copy of all values
    whenever C++ calls it with values of its own: 18 000 points for each of 1500 frames in every iteration.

    It ends when the error falls by less than a part in a thousand: along the mechanism the error is so flat that it
    would creep for a hundred iterations after a part in 1e5 of it, a tenth of one standard deviation of one length.
    """
    error = graph.error(values)
    damping = 0.0
    for iteration in range(MAX_BATCH_ITERATIONS):
        linear = graph.linearize(values)
        before = error
        while damping <= MAX_DAMPING:
            moved = values.retract(_damped(linear, values, damping).optimize())
            error = graph.error(moved)
            if error <= before:
                break
            damping = max(10 * damping, MIN_DAMPING)
        else:
            return values, False
        values = moved
        damping = damping / 10 if damping > MIN_DAMPING else 0.0
        progress(iteration + 1, error)
        if before - error <= RELATIVE_DECREASE * before:
            return values, True
    return values, False


def _damped(linear: gtsam.GaussianFactorGraph, values: gtsam.Values, damping: float) -> gtsam.GaussianFactorGraph:
    """Return the linear graph with damping |delta_n|^2 added for every node n."""
    if damping == 0:
        return linear
    damped = gtsam.GaussianFactorGraph()
    damped.push_back(linear)
    identity = np.sqrt(damping) * np.eye(3)
    zero = np.zeros(3)
    unit = gtsam.noiseModel.Unit.Create(3)
    for key in values.keys():  # noqa: SIM118 (not a mapping)
        damped.add(gtsam.JacobianFactor(key, identity, zero, unit))
    return damped
