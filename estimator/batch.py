"""A whole trial at once: all frames in one graph, Levenberg-Marquardt, covariances of every frame."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import gtsam
import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..models.settings import Settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape, Status
from ..models.structure.structure import Structure
from ..models.values.errors import IndeterminateError
from ..models.values.readings import TendonLengths
from .branches import OtherBranch
from .drift import DriftState, smoothed
from .graph import GraphBuilder, status_of
from .smoother import LiveSmoother
from .uncertainty import FrameEvidence

MAX_BATCH_ITERATIONS = 50
RELATIVE_DECREASE = 1e-3
PUSH_S = 0.12
"""Standard deviation of the Gaussian that averages loads: 0.3 s at half its height, as a push takes to build up."""
MIN_DAMPING, MAX_DAMPING = 1e2, 1e10
"""In 1 / m^2: from a prior of 0.1 m to one of 0.01 mm."""


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
        graph, values, admitted = self._graph(_without_lag(list(frames)))
        try:
            values, converged = _optimize(graph, values, progress)
            positions = np.array(gtsam.utilities.extractPoint3(values)).reshape(-1, self._builder.node_count, 3)
            assessed = [
                self._evidence.assess(position, lengths) for lengths, position in zip(admitted, positions, strict=True)
            ]
        except RuntimeError as error:
            raise IndeterminateError(str(error).splitlines()[0]) from error
        branches = OtherBranch(self._builder, self._settings.branch)
        all_loads = _over_pushes([loads for _, loads in assessed], admitted)
        for lengths, position, (covariance, _), loads in zip(admitted, positions, assessed, all_loads, strict=True):
            status = status_of(lengths, self._builder.structure) if converged else Status.NOT_CONVERGED
            yield branches.told(Shape(lengths.t_s, position, covariance, status, lengths, loads))

    def _graph(
        self, frames: list[TendonLengths]
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, list[TendonLengths]]:
        """Return the graph of all frames, the live estimate of each as the start, and the lengths that it admitted."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        times_s = [lengths.t_s for lengths in frames]
        live = LiveSmoother(self._builder.structure, self._builder.rest, self._settings)
        live.drift.kept = []
        shapes = list(live.estimate(frames))
        admitted = _without_drift(frames, shapes, smoothed(live.drift.kept))
        for frame, (shape, lengths) in enumerate(zip(shapes, admitted, strict=True)):
            self._builder.add_frame(graph, frame, lengths)
            self._builder.add_motion(graph, frame, times_s[max(frame - 2, 0) : frame + 1])
            for key, position in zip(self._builder.keys(frame), shape.node_position_m, strict=True):
                values.insertPoint3(key, position)
        return graph, values, admitted


def _without_drift(frames: list[TendonLengths], shapes: list[Shape], drift: list[DriftState]) -> list[TendonLengths]:
    """Return the lengths that the live estimates admitted, now without the drift that all updates tell of."""
    if not drift:
        return [shape.lengths for shape in shapes]
    latest = np.searchsorted([state.t_s for state in drift], [lengths.t_s for lengths in frames], side="right") - 1
    admitted = []
    for lengths, shape, k in zip(frames, shapes, latest, strict=True):
        known = drift[k].off(lengths) if k >= 0 else lengths
        sigma_m = np.where(np.isinf(shape.lengths.sigma_m), np.inf, known.sigma_m)
        admitted.append(replace(known, sigma_m=sigma_m, flags=shape.lengths.flags))
    return admitted


def _over_pushes(loads: list[ExternalLoads | None], frames: list[TendonLengths]) -> list[ExternalLoads | None]:
    """Return the loads averaged over the time in which a hand builds up a push."""
    known = [of for of in loads if of is not None]
    if len(known) < 2 or len(known) < len(loads):
        return loads
    step_s = float(np.median(np.diff([lengths.t_s for lengths in frames])))
    force_n = gaussian_filter1d(np.array([of.force_n for of in known]), PUSH_S / step_s, axis=0, mode="nearest")
    return [replace(of, force_n=force) for of, force in zip(known, force_n, strict=True)]


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
    error, damping = graph.error(values), 0.0
    for iteration in range(MAX_BATCH_ITERATIONS):
        linear, before = graph.linearize(values), error
        while damping <= MAX_DAMPING:
            moved = values.retract(_damped(linear, values, damping).optimize())
            error = graph.error(moved)
            if error <= before:
                break
            damping = max(10 * damping, MIN_DAMPING)
        else:
            return values, False
        values, damping = moved, damping / 10 if damping > MIN_DAMPING else 0.0
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
    identity, zero, unit = np.sqrt(damping) * np.eye(3), np.zeros(3), gtsam.noiseModel.Unit.Create(3)
    for key in values.keys():  # noqa: SIM118 (not a mapping)
        damped.add(gtsam.JacobianFactor(key, identity, zero, unit))
    return damped
