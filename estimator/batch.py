"""The batch estimator: all frames of a trial in one graph, optimised by Levenberg-Marquardt.

The graph is that of `GraphBuilder`, with every frame in it; `estimator/whole_trial/` holds its factors as stacked
arrays, because gtsam calls those that are written in Python once for each frame and iteration.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ..factors.motion import motion_rows
from ..factors.noise import WeightedLengths, weigh
from ..models.balance.support import Support
from ..models.settings import Settings
from ..models.structure.rest_shape import RestShape
from ..models.structure.shape import OtherShape, Reason, Shape, Status
from ..models.structure.structure import Structure
from ..models.values.errors import UNDETERMINED, IndeterminateError
from ..models.values.readings import Flag, TendonLengths
from ..models.values.stamps import is_due
from ..models.values.time_series import any_before, interpolated, median_step_s, parts
from .changes.change_watch import Change
from .doubt import Doubt
from .graph import GraphBuilder, status_of
from .lag_compensation import VELOCITY_HOLDS_S
from .lasting_errors import LastingErrors, frames_near
from .linear_frame import FrameData, linearised_frames
from .mode_choice import is_uncertain, stacked_modes
from .sensor_drift import DriftState, is_of_a_board, smoothed_drift
from .smoother import AHEAD_S, LiveSmoother
from .uncertainty import Assessment, FrameEvidence, Mixture
from .watches.past_motion import PastMotion
from .watches.rebound_watch import ReboundWatch
from .watches.steady_load import SteadyLoad
from .whole_trial.parts import STACKED, WINDOW
from .whole_trial.second_shapes import frames_to_search, second_shapes
from .whole_trial.trial_balance import TrialBalance
from .whole_trial.trial_chain import Progress, TrialChain, minimised, no_progress
from .whole_trial.trial_factors import TrialFactors

LEARN_EVERY_S = 0.2
"""Time between the frames of the live pass, from which modes, drift and health are learned."""
LEARN_EVERY_M = 0.0015
"""Change of a length after which the pass takes a frame sooner: where the robot is pressed fast, frames between would
start too far from their shapes, and fall into mirrored ones. With the time alone, a slack trial of the twin comes to
17.7 mm in place of 6.7."""
DOUBT_EVERY_S = 0.2
"""Time between two comparisons of explanations in the live pass: their evidence is counted by time, and changes in
seconds."""
FOUND_AFTER_S = 0.4
"""Time after which the live pass leaves out a sensor whose fault is found at once. Batch leaves it out in the frames
before, too, and with it some readings before a fault that begins later."""
DRIFT_EVERY_S = 0.5
"""Time between two updates of the drift in the live pass, which a smoother keeps: in this time a length drifts by
0.02 mm."""
SOFT = 3.0
"""Factor of the standard deviation of forces in the first steps. Between two frames of the live pass a node that is
pressed may start with the weight of a free one, and the kernel would keep it so: on `fault_01` without these steps the
error stays larger by 0.7 % and the shapes are worse by 5 %."""
SOFT_STEPS = 3
"""Number of these steps."""
MODE_STEPS = 2
"""Number of steps after them, after which the shapes of all frames tell the modes of the tendons."""
PUSH_S = 0.12
"""Standard deviation of the Gaussian window that averages the loads. Its width at half its height is 0.3 s, the time in
which a push builds up."""
FILTER_REACH = 4.0
"""Reach of this window to either side, in its standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """What a whole trial is estimated from."""

    start_m: NDArray[np.float64]
    """(frames, nodes, 3) the shapes at which the optimisation starts."""
    measured: list[WeightedLengths]
    """The lengths of each frame, without the sensors that the live pass left out."""
    doubts: list[Doubt]
    """The doubt about the model in each frame."""
    changes: list[Change | None]
    """What has changed in each frame since the sensors were tared."""
    balance: TrialBalance | None
    """The balance of forces near the start; None without mechanics."""

    @property
    def t_s(self) -> NDArray[np.float64]:
        """(frames,) their times."""
        return np.array([measured.lengths.t_s for measured in self.measured])

    @property
    def frames_per_push(self) -> float:
        """Number of frames in `PUSH_S`; 1 for a single frame."""
        return PUSH_S / median_step_s(self.t_s) if len(self.measured) > 1 else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Optimum:
    """The shapes of least error of a whole trial."""

    problem: _Problem
    node_position_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    converged: bool


class BatchOptimizer:
    """Estimates the shape in every frame from all frames of the trial, earlier and later ones."""

    def __init__(self, structure: Structure, rest: RestShape, settings: Settings) -> None:
        self._builder = GraphBuilder(structure, rest, settings.noise)
        self._evidence = FrameEvidence(self._builder, settings.doubt)
        self._settings = settings

    def estimate(self, frames: Iterable[TendonLengths], progress: Progress = no_progress) -> Iterator[Shape]:
        """Yield a shape for each frame, after all frames have been read.

        Args:
            frames: lengths, in order of time.
            progress: called after each iteration with its number and the graph's error.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        yield from self._shapes(self._after_live_pass(frames, progress))

    def refined(
        self,
        frames: list[TendonLengths],
        live: LiveSmoother,
        shapes: list[Shape],
        supports: Sequence[Support] | None,
        progress: Progress,
    ) -> Iterator[Shape]:
        """Yield a shape for each frame, from a live estimate.

        Args:
            frames: lengths, in order of time.
            live: the live smoother, which has kept what it learned, after the last frame.
            shapes: its shapes, in all frames or in some; the others start between these.
            supports: the force of gravity and floor in each frame; None where it is always the same.
            progress: see `estimate`.

        Raises:
            IndeterminateError: see `estimate`.
        """
        yield from self._shapes(self._optimum(frames, live, shapes, supports, progress))

    def _after_live_pass(self, frames: Iterable[TendonLengths], progress: Progress) -> _Optimum | None:
        """Return the optimum from a live pass; None without frames. What only the live pass needs is let go of."""
        live = LiveSmoother(self._builder.structure, self._builder.rest, _learning(self._settings))
        frames = without_lag(list(frames))
        is_dense = median_step_s([lengths.t_s for lengths in frames]) <= AHEAD_S
        live.keep(VELOCITY_HOLDS_S if is_dense else AHEAD_S)  # in the frames left out, little has changed
        shapes = [live.first_shape(lengths).without_covariance() for lengths in _some_of(frames)]
        return self._optimum(frames, live, shapes, None, progress)

    def _optimum(
        self,
        frames: list[TendonLengths],
        live: LiveSmoother,
        shapes: list[Shape],
        supports: Sequence[Support] | None,
        progress: Progress,
    ) -> _Optimum | None:
        """Return the optimum from a live estimate, see `refined`; None without frames."""
        if not frames:
            return None
        self._builder.starts_at_rest = live.builder.starts_at_rest
        problem = self._problem(frames, live, shapes, supports)
        try:
            if len(shapes) < len(frames) and self._builder.statics is not None:
                problem = self._nearer(problem, frames, live, shapes)
            position_m, converged = minimised(self._chain(problem), problem.start_m, progress)
        except np.linalg.LinAlgError as error:
            raise IndeterminateError(UNDETERMINED) from error
        return _Optimum(problem, position_m, converged)

    def _nearer(
        self, problem: _Problem, frames: list[TendonLengths], live: LiveSmoother, shapes: list[Shape]
    ) -> _Problem:
        """Return the problem with a start nearer to the shapes of all frames, and with the modes that these tell."""
        assert problem.balance is not None, "forces need mechanics"
        soft = replace(problem, balance=replace(problem.balance, sigma_n=SOFT * problem.balance.sigma_n))
        position_m, _ = minimised(self._chain(soft), problem.start_m, steps=SOFT_STEPS)
        problem = replace(problem, start_m=position_m)
        asked = np.array([k for k, one in enumerate(problem.measured) if is_uncertain(one.lengths)], dtype=np.int64)
        if not len(asked):
            return problem
        position_m, _ = minimised(self._chain(problem), problem.start_m, steps=MODE_STEPS)
        problem = replace(problem, start_m=position_m)
        evidence = np.zeros((len(frames), len(self._builder.structure.tendons)))
        for part in parts(len(asked), STACKED):
            numbers = asked[part]
            assessment = self._assessed_frames(problem, position_m, numbers)
            measured = [problem.measured[k] for k in numbers]
            evidence[numbers] = live.modes.evidence(
                assessment.node_position_m,
                assessment.covariance_m2,
                np.array([one.lengths.length_m for one in measured]),
                np.array([one.sigma_m for one in measured]),
                stacked_modes([one.lengths for one in measured]),
            )
        live.modes.kept = [(lengths.t_s, told) for lengths, told in zip(frames, evidence, strict=True)]
        return replace(problem, measured=self._measured(frames, live, shapes, problem.doubts))

    def _problem(
        self,
        frames: list[TendonLengths],
        live: LiveSmoother,
        shapes: list[Shape],
        supports: Sequence[Support] | None,
    ) -> _Problem:
        """Return the lengths as all frames tell them, and the shapes between those of the live estimate."""
        doubts = live.doubt.smoothed(frames)
        measured = self._measured(frames, live, shapes, doubts)
        start_m = interpolated(
            np.array([lengths.t_s for lengths in frames]),
            np.array([shape.t_s for shape in shapes]),
            np.array([shape.node_position_m for shape in shapes]),
        )
        balance = TrialBalance.of(self._builder, frames, supports)
        changes = live.changes.smoothed(frames)
        near = balance.near(self._builder, start_m) if balance else None
        return _Problem(start_m, measured, doubts, changes, near)

    def _measured(
        self, frames: list[TendonLengths], live: LiveSmoother, shapes: list[Shape], doubts: list[Doubt]
    ) -> list[WeightedLengths]:
        """Return the lengths with mode, drift, health and sigma as the live pass and later frames tell them."""
        frames = _without_stuck(live.modes.smoothed(frames), self._settings.gate.stuck_s)
        admitted = _admitted(frames, shapes, smoothed_drift(live.drift.kept or []))
        for lengths in admitted:
            self._builder.check_determined(lengths)
        return [
            weigh(lengths, self._builder.noise).scaled(doubt.length_scale)
            for lengths, doubt in zip(admitted, doubts, strict=True)
        ]

    def _chain(self, problem: _Problem) -> TrialChain:
        """Return the frames with the motion prior between them."""
        rest = self._builder.rest
        factors = TrialFactors(self._builder, problem.measured, problem.balance)
        sigma_m = rest.largest_sigma_m if self._builder.starts_at_rest else None
        rows = motion_rows(problem.t_s, self._builder.noise.motion_m_per_s15, sigma_m)
        return TrialChain(factors, rows, self._builder.structure.free_coordinates, rest.node_position_m)

    def _shapes(self, optimum: _Optimum | None) -> Iterator[Shape]:
        """Yield the shapes of all frames with their covariances, loads and second shapes; none without frames."""
        if optimum is None:
            return
        problem, position_m = optimum.problem, optimum.node_position_m
        balance = problem.balance.near(self._builder, position_m) if problem.balance else None
        trial = replace(problem, balance=balance)
        t_s = problem.t_s
        search = np.array(frames_to_search(t_s, self._settings.branch.look_every_s))
        rebounds, steady_load = self._of_loads(trial, position_m)
        read_s, past = self._past(trial, position_m)
        lasting = LastingErrors(self._builder.structure, self._builder.rest)
        velocity_m_per_s = np.gradient(position_m, t_s, axis=0) if len(t_s) > 1 else np.zeros_like(position_m)
        near = frames_near(t_s)
        of_a_board = any(is_of_a_board(one.lengths.drift) for one in trial.measured)  # as drift, at all times
        other: OtherShape | None = None
        for window in parts(len(t_s), WINDOW):
            assessment = self._assessed(trial, position_m, window)
            others = self._second_shapes(trial, assessment, window, search)
            for k in range(window.start, window.stop):
                other = others.get(k, other)
                shape = self._shape(trial, assessment[k - window.start], k, optimum.converged)
                change = trial.changes[k]
                if change is not None:
                    shape = change.doubted(shape, self._builder.structure.free_coordinates)
                shape = rebounds.widened(shape.in_doubt(Reason.BOARD) if of_a_board else shape)
                shape = steady_load.widened(shape)
                if shape.status is Status.PRIOR_ONLY:
                    shape = past.widened(shape, float(np.abs(read_s - shape.t_s).min(initial=np.inf)))
                velocities, error_scale = velocity_m_per_s[near[k]], trial.doubts[k].error_scale
                shape = lasting.of_trial(shape, velocity_m_per_s[k], velocities, error_scale)
                yield shape.beside(other)

    def _of_loads(self, trial: _Problem, position_m: NDArray[np.float64]) -> tuple[ReboundWatch, SteadyLoad]:
        """Return what all loads of the trial tell of the memory of the strips, and of the rest."""
        rest, finger_n = self._builder.rest, self._settings.doubt.load_n
        rebounds, steady_load = ReboundWatch(rest, finger_n), SteadyLoad(rest, finger_n)
        if trial.balance is None:
            return rebounds, steady_load
        force_n = averaged_forces(trial.balance.load_n(position_m), trial.t_s, trial.frames_per_push)
        for measured, doubt, loads_n, x_m in zip(trial.measured, trial.doubts, force_n, position_m, strict=True):
            rebounds.learn(measured.lengths, loads_n, in_motion=doubt.reason is Reason.MOTION)
            steady_load.learn(measured.lengths, loads_n, x_m)
        return rebounds, steady_load

    def _past(self, trial: _Problem, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], PastMotion]:
        """Return the times of all frames in which lengths were read, and what their shapes tell of those without."""
        structure = self._builder.structure
        has_lengths = [status_of(one.lengths, structure) is not Status.PRIOR_ONLY for one in trial.measured]
        past = PastMotion(structure.free_coordinates)
        past.learn(position_m[has_lengths])
        return trial.t_s[has_lengths], past

    def _shape(self, trial: _Problem, assessment: Assessment, k: int, converged: bool) -> Shape:
        """Return the shape of one frame, with the status that its lengths and the doubt about it give."""
        lengths, reason = trial.measured[k].lengths, trial.doubts[k].reason
        status = status_of(lengths, self._builder.structure, reason) if converged else Status.NOT_CONVERGED
        shape = assessment.shape(lengths, status, reason)
        return shape.widened_by_step(self._builder.structure.free_coordinates, assessment.apart_m)

    def _assessed(self, trial: _Problem, position_m: NDArray[np.float64], window: slice) -> Assessment:
        """Return the shapes of a window of frames, with their covariances and the loads averaged over `PUSH_S`."""
        frames_per_push = trial.frames_per_push
        reach = int(np.ceil(FILTER_REACH * frames_per_push))
        around = np.arange(max(window.start - reach, 0), min(window.stop + reach, len(position_m)))
        assessment = Assessment.joined(
            [self._assessed_frames(trial, position_m, around[part]) for part in parts(len(around), STACKED)]
        )
        if assessment.loads is not None:
            averaged_n = averaged_forces(assessment.loads.force_n, trial.t_s[around], frames_per_push)
            assessment = replace(assessment, loads=replace(assessment.loads, force_n=averaged_n))
        first = window.start - int(around[0])
        return assessment[first : first + window.stop - window.start]

    def _assessed_frames(
        self, trial: _Problem, position_m: NDArray[np.float64], frames: NDArray[np.int64]
    ) -> Assessment:
        """Return the shapes of some frames with their covariances, and the loads of each frame alone."""
        balance = trial.balance
        statics = balance.statics_of(frames) if balance else None
        force_sigma_n = balance.sigma_n[frames] if balance else np.zeros((len(frames), 0))
        data = FrameData.stacked([trial.measured[k] for k in frames], statics, force_sigma_n)
        linear = linearised_frames(self._builder, position_m[frames], data)
        mixture = Mixture.of([trial.doubts[k] for k in frames])
        return self._evidence.assess_frames(linear, position_m[frames], statics, mixture)

    def _second_shapes(
        self, trial: _Problem, assessment: Assessment, window: slice, search: NDArray[np.int64]
    ) -> dict[int, OtherShape | None]:
        """Return the second shape, or None, of each frame of a window in which one is searched for."""
        searched = search[(search >= window.start) & (search < window.stop)]
        if not self._builder.structure.is_square or not len(searched):
            return {}
        measured = [weigh(trial.measured[k].lengths, self._builder.noise) for k in searched]
        factors = TrialFactors(self._builder, measured, trial.balance.part(searched) if trial.balance else None)
        position_m = assessment.node_position_m[searched - window.start]
        found = second_shapes(self._builder.structure, self._settings.branch, factors, position_m)
        return dict(zip(searched.tolist(), found, strict=True))


def averaged_forces(
    force_n: NDArray[np.float64], t_s: NDArray[np.float64], frames_per_push: float
) -> NDArray[np.float64]:
    """Return (frames, nodes, 3) forces averaged over the time in which a push builds up, not across gaps."""
    stretches = np.split(force_n, np.flatnonzero(np.diff(t_s) > PUSH_S) + 1)
    averaged = [
        gaussian_filter1d(stretch, frames_per_push, axis=0, mode="nearest", truncate=FILTER_REACH)
        for stretch in stretches
    ]
    return np.concatenate(averaged)


def _learning(settings: Settings) -> Settings:
    """Return the settings of the live pass, with few updates of doubt and drift."""
    doubt, drift = settings.doubt, settings.drift
    return replace(
        settings,
        doubt=replace(doubt, update_every_s=max(doubt.update_every_s, DOUBT_EVERY_S)),
        drift=replace(drift, update_every_s=max(drift.update_every_s, DRIFT_EVERY_S)),
    )


def _some_of(frames: Sequence[TendonLengths]) -> Iterator[TendonLengths]:
    """Yield frames that are `LEARN_EVERY_S` or `LEARN_EVERY_M` apart, the first and the last ones included."""
    latest: TendonLengths | None = None
    for k, lengths in enumerate(frames):
        if (
            latest is None
            or is_due(lengths.t_s - latest.t_s, LEARN_EVERY_S)
            or (np.abs(lengths.length_m - latest.length_m) > LEARN_EVERY_M).any()
            or k == len(frames) - 1
        ):
            latest = lengths
            yield lengths


def _admitted(frames: list[TendonLengths], shapes: list[Shape], drift: list[DriftState]) -> list[TendonLengths]:
    """Return the lengths without the drift as estimated from all frames, and without those that live left out soon."""
    t_s = [lengths.t_s for lengths in frames]
    latest_drift = np.searchsorted([state.t_s for state in drift], t_s, side="right") - 1
    shape_s = np.array([shape.t_s for shape in shapes])
    left_out = np.array([shape.lengths.flags & int(Flag.IMPLAUSIBLE) for shape in shapes])
    first = np.searchsorted(shape_s, t_s, side="right") - 1
    end = np.searchsorted(shape_s, np.array(t_s) + FOUND_AFTER_S, side="right")
    admitted = []
    for lengths, k, looks in zip(frames, latest_drift, map(slice, first, end), strict=True):
        corrected = lengths
        if drift and lengths.drift is not None:
            before = drift[0].earlier(lengths.t_s, frames[0].t_s) if k < 0 else drift[k]
            corrected = before.corrected(lengths)
        implausible = np.bitwise_or.reduce(left_out[looks])
        if implausible.any():
            sigma_m = np.where(implausible > 0, np.inf, corrected.sigma_m)
            corrected = replace(corrected, sigma_m=sigma_m, flags=corrected.flags | implausible)
        admitted.append(corrected)
    return admitted


def _without_stuck(frames: list[TendonLengths], stuck_s: float) -> list[TendonLengths]:
    """Return the frames without the lengths of stuck sensors in the seconds before they were found.

    They are found after `GateSettings.stuck_s` at the soonest, later where the sensor often repeats itself.
    """
    t_s = np.array([lengths.t_s for lengths in frames])
    stuck = np.array([lengths.flags & int(Flag.STUCK) for lengths in frames]) > 0
    soon = any_before(stuck, np.searchsorted(t_s, t_s + stuck_s))
    return [
        replace(
            lengths,
            sigma_m=np.where(found, np.inf, lengths.sigma_m),
            flags=lengths.flags | np.where(found, int(Flag.STUCK | Flag.MISSING), 0),
        )
        if found.any()
        else lengths
        for lengths, found in zip(frames, soon, strict=True)
    ]


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
