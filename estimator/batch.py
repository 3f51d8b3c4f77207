"""The batch estimator: all frames of a trial in one graph, optimised by Levenberg-Marquardt."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ..factors.noise import WeightedLengths, weigh
from ..models.settings import Settings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import Shape, Status
from ..models.structure.structure import Structure
from ..models.structure.support import Support
from ..models.values.errors import IndeterminateError
from ..models.values.readings import Flag, TendonLengths
from .branches import OtherBranch
from .doubt import Doubt
from .graph import GraphBuilder, status_of
from .linear_frame import linearised
from .sensor_drift import DriftState, smoothed
from .smoother import LiveSmoother
from .uncertainty import Assessment, FrameEvidence

MAX_BATCH_ITERATIONS = 50
RELATIVE_DECREASE = 1e-3
PUSH_S = 0.12
"""Standard deviation of the Gaussian window that averages the loads. Its width at half its height is 0.3 s, the time in
which a push builds up."""
MIN_DAMPING = 1e2
"""Least damping above zero, in 1 / m^2: a prior of 0.1 m about the last values."""
MAX_DAMPING = 1e10
"""Largest damping, in 1 / m^2: a prior of 0.01 mm about the last values."""


class BatchOptimizer:
    """Estimates the shape in every frame from all frames of the trial, earlier and later ones."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder, settings.doubt)
        self._settings = settings

    def estimate(
        self, frames: Iterable[TendonLengths], progress: Callable[[int, float], None] = lambda iteration, error: None
    ) -> Iterator[Shape]:
        """Yield a shape for each frame, after all frames have been read.

        Args:
            frames: lengths, in order of time.
            progress: called after each iteration with its number and the graph's error.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        live = LiveSmoother(self._builder.structure, self._builder.rest, self._settings)
        live.keep()
        frames = without_lag(list(frames))
        yield from self.refined(frames, live, list(live.estimate(frames)), None, progress)

    def refined(
        self,
        frames: list[TendonLengths],
        live: LiveSmoother,
        shapes: list[Shape],
        supports: Sequence[Support] | None,
        progress: Callable[[int, float], None] = lambda iteration, error: None,
    ) -> Iterator[Shape]:
        """Yield a shape for each frame, from the live estimate.

        Args:
            frames: lengths, in order of time.
            live: the live smoother, which has kept what it learned, after the last frame.
            shapes: its shapes.
            supports: the force of gravity and floor in each frame; None where it is always the same.
            progress: see `estimate`.

        Raises:
            IndeterminateError: see `estimate`.
        """
        problem = self._problem(frames, live, shapes, supports)
        try:
            values, converged = _optimize(problem.graph, problem.start, progress)
            positions = np.array(gtsam.utilities.extractPoint3(values)).reshape(-1, self._builder.node_count, 3)
            assessments = [
                self._assessed(positions[k], problem.measured[k], problem.doubts[k], supports[k] if supports else None)
                for k in range(len(positions))
            ]
        except (RuntimeError, np.linalg.LinAlgError) as error:
            raise IndeterminateError(" ".join(str(error).split())) from error
        frames = [measured.lengths for measured in problem.measured]
        loads = _averaged_loads([assessment.loads for assessment in assessments], frames)
        branches = OtherBranch(self._builder, self._settings.branch)
        for k, lengths in enumerate(frames):
            reason = problem.doubts[k].reason
            shape = Shape(
                t_s=lengths.t_s,
                node_position_m=assessments[k].node_position_m,
                covariance_m2=assessments[k].covariance_m2,
                status=status_of(lengths, self._builder.structure, reason) if converged else Status.NOT_CONVERGED,
                lengths=lengths,
                loads=loads[k],
                doubt=reason,
            )
            yield branches.with_other(shape)

    def _assessed(
        self, position_m: NDArray[np.float64], measured: WeightedLengths, doubt: Doubt, support: Support | None
    ) -> Assessment:
        """Return the covariance and the loads of one frame."""
        if support is not None:
            self._builder.stand_on(support)
        self._builder.wind(measured.lengths.natural)
        self._builder.approach(position_m)
        return self._evidence.assess(linearised(self._builder, position_m, measured), position_m, doubt)

    def _problem(
        self,
        frames: list[TendonLengths],
        live: LiveSmoother,
        shapes: list[Shape],
        supports: Sequence[Support] | None,
    ) -> "_Problem":
        """Return the graph of all frames; its start is the live estimate of each frame."""
        problem = _Problem(gtsam.NonlinearFactorGraph(), gtsam.Values(), [], [])
        times_s = [lengths.t_s for lengths in frames]
        admitted = _admitted(live.modes.smoothed(frames), shapes, smoothed(live.drift.kept or []))
        problem.doubts.extend(live.doubt.smoothed(frames))
        for frame, (shape, lengths) in enumerate(zip(shapes, admitted, strict=True)):
            measured = weigh(lengths, self._builder.noise).scaled(problem.doubts[frame].length_scale)
            problem.measured.append(measured)
            if supports is not None:
                self._builder.stand_on(supports[frame])
            self._builder.approach(shape.node_position_m)
            self._builder.add_frame(problem.graph, frame, measured)
            self._builder.add_motion(problem.graph, frame, times_s[max(frame - 2, 0) : frame + 1])
            for key, position in zip(self._builder.keys(frame), shape.node_position_m, strict=True):
                problem.start.insertPoint3(key, position)
        return problem


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The graph of a whole trial, with the values at which its optimisation starts."""

    graph: gtsam.NonlinearFactorGraph
    start: gtsam.Values
    measured: list[WeightedLengths]
    """The lengths of each frame, without the sensors that the live estimate left out."""
    doubts: list[Doubt]
    """The doubt about the model in each frame."""


def _admitted(frames: list[TendonLengths], shapes: list[Shape], drift: list[DriftState]) -> list[TendonLengths]:
    """Return the lengths without the drift as estimated from all frames, and without those that live left out."""
    latest = np.searchsorted([state.t_s for state in drift], [lengths.t_s for lengths in frames], side="right") - 1
    admitted = []
    for lengths, shape, k in zip(frames, shapes, latest, strict=True):
        corrected = lengths
        if drift and lengths.drift is not None:
            first_s = frames[0].t_s
            before = drift[0].earlier((lengths.t_s - first_s) / (drift[0].t_s - first_s)) if k < 0 else drift[k]
            corrected = before.corrected(lengths)
        left_out = np.isinf(shape.lengths.sigma_m)
        flags = corrected.flags | (shape.lengths.flags & int(Flag.IMPLAUSIBLE))
        admitted.append(replace(corrected, sigma_m=np.where(left_out, np.inf, corrected.sigma_m), flags=flags))
    return admitted


def _averaged_loads(loads: list[ExternalLoads | None], frames: list[TendonLengths]) -> list[ExternalLoads | None]:
    """Return the loads averaged over the time in which a push builds up, see `PUSH_S`."""
    known_loads = [frame_loads for frame_loads in loads if frame_loads is not None]
    if len(known_loads) < 2 or len(known_loads) < len(loads):
        return loads
    step_s = float(np.median(np.diff([lengths.t_s for lengths in frames])))
    force_n = np.array([frame_loads.force_n for frame_loads in known_loads])
    averaged_n = gaussian_filter1d(force_n, PUSH_S / step_s, axis=0, mode="nearest")
    return [replace(frame_loads, force_n=force) for frame_loads, force in zip(known_loads, averaged_n, strict=True)]


def without_lag(frames: list[TendonLengths]) -> list[TendonLengths]:
    """Return the frames, each with the lengths of the later frame in which the sensors show its state."""
    t_s = np.array([lengths.t_s for lengths in frames])
    shown_s = t_s + [lengths.lag_s for lengths in frames]
    after = np.minimum(np.searchsorted(t_s, shown_s), len(t_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(shown_s - t_s[before] < t_s[after] - shown_s, before, after)
    return [
        replace(frames[later], t_s=lengths.t_s, aids=lengths.aids)
        for lengths, later in zip(frames, nearest, strict=True)
    ]


def _optimize(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, progress: Callable[[int, float], None]
) -> tuple[gtsam.Values, bool]:
    """Return the values of least error, and whether the optimisation converged, by Levenberg-Marquardt.

    The loop replaces gtsam's own optimiser, which is slow with factors that are written in Python: C++ gives such a
    factor a copy of all values at each call, 18 000 points for each of 1500 frames in every iteration.

    The loop ends when the error falls by less than one part in a thousand. Along the mechanism the error is so flat
    that a smaller bound would cost a hundred further iterations for one part in 1e5 of the error, which is a tenth of
    one standard deviation of one length.
    """
    error = graph.error(values)
    damping = 0.0
    for iteration in range(MAX_BATCH_ITERATIONS):
        linear = graph.linearize(values)
        before = error
        while damping <= MAX_DAMPING:
            candidate = values.retract(_damped(linear, values, damping).optimize())
            error = graph.error(candidate)
            if error <= before:
                break
            damping = max(10 * damping, MIN_DAMPING)
        else:
            return values, False
        values = candidate
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
