"""The pipeline from counts to resistance, strain, length and shape; here io and the estimators meet."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .estimator.baselines.least_squares import LeastSquares
from .estimator.batch import BatchOptimizer
from .estimator.frame import FrameEstimator
from .estimator.free_standing.estimators import FreeStandingOptimizer, FreeStandingSmoother
from .estimator.hanging.hanging_estimators import HangingOptimizer, HangingSmoother
from .estimator.rest.rest_step import rest_shape_of
from .estimator.smoother import LiveSmoother
from .estimator.watches.moving_base import MovingBase
from .estimator.watches.run_watch import RunWatch
from .estimator.whole_trial.trial_chain import Progress
from .factors.tendon import TautCables
from .io.model_file import read_sensor_model
from .io.reports.run_lines import rest_complaints
from .io.trial_directory import Trial, open_trial
from .models.plug_ins import PlugIn, plug_ins
from .models.pose.aid_intake import AidIntake
from .models.pose.robot import FreeStandingRobot, HangingRobot, Robot
from .models.sensor.frames import FrameAssembler, LengthPauses
from .models.sensor.front_end import FrontEnd
from .models.sensor.reference_drift import ReferenceTendons
from .models.sensor.sensor_model import SensorModel
from .models.settings import Settings, checked_settings
from .models.strain_front_end import StrainFrontEnd, StrainModelFactory
from .models.structure.mechanics import Mechanics
from .models.structure.natural_lengths import Winding, strip_length_m
from .models.structure.possible import PossibleShapes
from .models.structure.reconstruction import Reconstruction
from .models.structure.rest_shape import RestShape
from .models.structure.shape import Shape
from .models.structure.structure import Structure
from .models.told_lengths import ToldLengths, lengths_at_rest
from .models.told_readings import check_other, check_resistance
from .models.trial_description import TrialDescription
from .models.values.aids import AidReading
from .models.values.errors import IndeterminateError, InputError
from .models.values.readings import (
    BoardReading,
    NaturalLengthReading,
    NodeFactor,
    OtherReading,
    Reading,
    ResistanceFrame,
    ResistanceReading,
    TendonLengths,
)
from .models.values.stamps import RestClock
from .models.values.threads import one_thread

OFFLINE_FRAMES = 500
"""Number of frames whose lengths are computed at a time where nobody waits for the first."""
AnySensorModel = SensorModel | StrainModelFactory
"""A sensor model, or what makes the one that another package brings."""


class Estimator(Protocol):
    """An estimator of shapes from frames of lengths; any object with this method can be used in the pipeline."""

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        ...


def unscented_kalman(structure: Structure, rest: RestShape, settings: Settings) -> Estimator:
    """Return an `UnscentedKalman`; its module is imported here because only this method needs filterpy."""
    from .estimator.baselines.unscented_kalman import UnscentedKalman

    return UnscentedKalman(structure, rest, settings)


def recurrent_network(structure: Structure, rest: RestShape, settings: Settings) -> Estimator:
    """Return a `RecurrentNetwork` with the weights that ship with the package; it has no settings."""
    from .estimator.baselines.recurrent_network import RecurrentNetwork
    from .io.shape_network_file import read_shape_network

    return RecurrentNetwork(read_shape_network(), structure, rest)


EstimatorFactory = Callable[[Structure, RestShape, Settings], Estimator]

ESTIMATORS: dict[str, EstimatorFactory] = {
    "batch": BatchOptimizer,
    "live": LiveSmoother,
    "frame": FrameEstimator,
    "least-squares": LeastSquares,
    "ukf": unscented_kalman,
    "network": recurrent_network,
}
"""The estimator of each method, by name. To add one: `tensegraph.pipeline.ESTIMATORS["mine"] = MyEstimator`; after that
`reconstruct`, `stream` and the comparison of methods can use it in this process. An entry point of the group
`tensegraph.estimators` adds one for all processes."""


WITH_FACTORS = ("batch", "live", "frame")
"""The methods that use factors of one's own; the others would leave them out and not say so."""

NOT_HELD = ("batch", "live")
"""The methods for a structure with less than three anchors."""

WITH_POSE: dict[type[Robot], dict[str, Callable[[RestShape, Any, Settings], Estimator]]] = {
    FreeStandingRobot: {"batch": FreeStandingOptimizer, "live": FreeStandingSmoother},
    HangingRobot: {"batch": HangingOptimizer, "live": HangingSmoother},
}
"""The estimators by these methods of a robot that stands on a floor, and of one that hangs from one or two anchors."""


def estimator_plug_ins() -> dict[str, PlugIn]:
    """Return the estimators that other packages bring, by the name of their method."""
    return plug_ins("estimators", [*ESTIMATORS, "graph"])  # on the command line, `graph` is `batch`


def estimator_of(method: str) -> EstimatorFactory:
    """Return what makes the estimator of a method.

    Raises:
        InputError: for a method that is neither in `ESTIMATORS` nor brought by another package, or that cannot be
            imported.
    """
    others = estimator_plug_ins()
    if method in ESTIMATORS:
        return ESTIMATORS[method]
    if method not in others:
        raise InputError(f"method '{method}': expected one of {', '.join([*ESTIMATORS, *others])}")
    factory: EstimatorFactory = others[method].load()
    return factory


def _estimated(estimator: Any, frames: Iterable[TendonLengths], progress: Progress | None) -> Iterator[Shape]:
    """Return an estimator's shapes; `progress` is passed on to estimators that take it."""
    tells = progress is not None and "progress" in signature(estimator.estimate).parameters
    shapes: Iterator[Shape] = estimator.estimate(frames, progress=progress) if tells else estimator.estimate(frames)
    return shapes


def _estimated_from_rest(
    estimator_from: Callable[[float], Estimator], frames: Iterable[TendonLengths], progress: Progress | None
) -> Iterator[Shape]:
    """Yield the shapes of an estimator that is made when the first frame arrives, from its t_s; none without frames."""
    later = iter(frames)
    first = next(later, None)
    if first is not None:
        yield from _estimated(estimator_from(first.t_s), chain([first], later), progress)


class Pipeline:
    """The processing from the readings of one trial to its shapes, set up once from the trial's description."""

    def __init__(self, trial: TrialDescription, settings: Settings, model: AnySensorModel) -> None:
        self.trial = trial
        self.settings = settings = settings.for_robot(trial.structure, trial.mechanics)
        """The settings that were given, for this robot."""
        self._described_rest = rest_shape_of(trial, settings.rest)
        self.rest = self._described_rest
        """The rest shape: that of the description, or of the lengths at rest of the latest run, see `after_rest`."""
        self._lengths_misfit = self._lengths_moved = False
        self.factors: tuple[NodeFactor, ...] = tuple(factor.factor(trial.structure) for factor in trial.factors)
        if trial.mechanics is not None and len(trial.mechanics.stiff_cables):
            self.factors += (self._taut_cables(trial.mechanics),)
        self.watch = RunWatch(trial, self.rest, settings.gate)
        """Of the latest run."""
        self.aids = AidIntake(
            self.rest,
            trial.rest_seconds,
            settings.pose.position_m,
            imus=len(trial.imus),
            ranges=len(trial.beacon_position_m),
            positions=trial.world_positions,
            own_frames=trial.own_frames,
        )
        self.boards = trial.boards(settings.clock) if trial.source == "counts" else None
        tendons = len(trial.structure.tendons)
        strips = np.arange(tendons, tendons + trial.reference_strips)
        natural_ohm = trial.natural_resistance_ohm
        if len(strips):  # a strip of the same make; only the relative change of what it reads counts
            natural_ohm = np.append(natural_ohm, np.full(len(strips), np.nanmedian(natural_ohm)))
        self.winding = Winding(
            trial.structure, trial.motors, trial.rest_seconds, reads_strips=trial.source != "lengths"
        )
        wound = [tendon for motors in trial.motors for tendon in motors.tendons]
        references = np.setdiff1d(np.flatnonzero(trial.structure.joins_anchors & trial.structure.is_sensed), wound)
        longest_s = model.ranges.step_s[1] if isinstance(model, SensorModel) else np.inf
        rolls = bool(trial.imus) and not self.rest.structure.is_held
        if rolls:  # it turns too far from one slow row to the next
            longest_s = 0.0
        sources = max(len(trial.tendons_of_board), 1)
        self._frames = FrameAssembler(natural_ohm, sources, settings.frames, settings.gate, longest_s)
        natural_m = trial.structure.natural_length_m  # of a cable that a motor winds, it may be very short
        full_m = np.maximum(natural_m, trial.structure.tendon_length_m(self.rest.node_position_m))
        self._told = ToldLengths(settings.gate, trial.structure, full_m, trial.rest_seconds, settings.noise.unstated_m)
        self._pauses = LengthPauses(tendons, settings.frames, bridges=rolls)
        drift = ReferenceTendons(np.concatenate([references, strips]), settings.drift, trial.board_of_tendon)
        self.front_end = self._front_end(model, drift)

    def _taut_cables(self, mechanics: Mechanics) -> TautCables:
        """Return what stiff cables say of the nodes.

        Raises:
            InputError: when a motor winds one, whose length is then not known.
        """
        for number, motors in enumerate(self.trial.motors):
            for tendon in set(motors.tendons) & set(mechanics.stiff_cables.tolist()):
                raise InputError(f"motor[{number}].tendons: expected no stiff cable, got tendon {tendon}")
        structure = self.rest.structure
        tared = self.rest.mechanics or mechanics
        by_forces = structure.is_held and not self.trial.motors  # which change what the cables pull
        return TautCables.of(structure, tared, by_forces=by_forces)

    def _front_end(self, model: AnySensorModel, references: ReferenceTendons) -> FrontEnd | StrainFrontEnd:
        trial, settings = self.trial, self.settings
        natural_ohm, natural_m = trial.natural_resistance_ohm, strip_length_m(trial.structure, trial.motors)
        rest = self.winding.strips(self.rest.lengths(trial.rest_seconds)) if trial.rest_seconds > 0 else None
        if not isinstance(model, SensorModel):
            return StrainFrontEnd(model, natural_ohm, natural_m, rest)
        if trial.source != "lengths":
            model.check_rate(settings.frames.rate_hz)
        return FrontEnd(
            model=model,
            natural_resistance_ohm=natural_ohm,
            natural_length_m=natural_m,
            rest=rest,
            settings=settings.front_end,
            frame_step_s=1 / settings.frames.rate_hz,
            references=references,
            is_held=trial.structure.is_held,
        )

    def estimate(self, readings: Iterable[Reading], method: str = "batch") -> Iterator[Shape]:
        """Yield the shape in every frame; the live method yields each as soon as its frame is complete."""
        return self.shapes(self.lengths(readings), method)

    def shapes(self, frames: Iterable[TendonLengths], method: str, progress: Progress | None = None) -> Iterator[Shape]:
        """Yield the shape in every frame of lengths, from the first of the trial on.

        Args:
            frames: lengths, in order of time.
            method: see `reconstruct`.
            progress: called by methods that optimise over all frames.

        Raises:
            InputError: for a method that is none, or is not for such a structure, or such readings.
        """
        factory = estimator_of(method)
        self._check_method(method)
        return self._shapes_from_rest(frames, method, factory, progress)

    def _shapes_from_rest(
        self, frames: Iterable[TendonLengths], method: str, factory: EstimatorFactory, progress: Progress | None
    ) -> Iterator[Shape]:
        yield from self._watched(self.after_rest(frames), method, factory, progress)

    def shapes_by(
        self,
        factory: EstimatorFactory,
        method: str,
        frames: Iterable[TendonLengths],
    ) -> Iterator[Shape]:
        """Yield the shape in every frame of lengths that `after_rest` returns, by a method whose factory is known.

        Raises:
            InputError: for a method that is not for such a structure, or such readings.
        """
        self._check_method(method)
        return self._watched(frames, method, factory, None)

    def _check_method(self, method: str) -> None:
        """Raise InputError for a method that is not for such a structure, or such readings."""
        if self.trial.factors and method not in WITH_FACTORS:
            raise InputError(
                f"method '{method}': expected one of {', '.join(WITH_FACTORS)}, which use the trial's [[factor]]"
            )
        structure = self.rest.structure
        if not structure.is_held and method not in NOT_HELD:
            fewer = "without anchors" if structure.is_free_standing else "with one or two anchors"
            raise InputError(f"method '{method}': expected one of {', '.join(NOT_HELD)} for a structure {fewer}")

    @property
    def _lengths_tell_rest(self) -> bool:
        """Whether the lengths at the start tell the rest shape: they are told, and it was not measured."""
        is_told = self.trial.source == "lengths" and self.trial.rest_seconds > 0
        return is_told and self.trial.rest_position_m is None

    def after_rest(self, frames: Iterable[TendonLengths]) -> Iterator[TendonLengths]:
        """Read the frames of the rest, estimate the rest shape from their lengths, and return all frames.

        Each frame says so where the structure moved meanwhile, or where no shape has such lengths: then the rest shape
        stays that of the description. Nothing is read where lengths do not tell the rest.
        """
        later = iter(frames)
        if not self._lengths_tell_rest:
            return later
        clock, taken = RestClock(self.trial.rest_seconds), []
        for lengths in later:
            taken.append(lengths)
            clock.count_frame(lengths.t_s)
            if not clock.is_at_rest(lengths.t_s):
                break
        resting = [lengths for lengths in taken if clock.is_at_rest(lengths.t_s)]
        self.rest, self._lengths_misfit, self._lengths_moved = self._described_rest, False, False
        if not any(lengths.usable.any() for lengths in resting):
            return chain(taken, later)
        at_rest, moved = lengths_at_rest(resting, self.trial.rest_seconds)
        try:
            with one_thread():
                rest = rest_shape_of(self.trial, self.settings.rest, at_rest)
            misfit = rest.misfits(at_rest)
        except IndeterminateError:  # no shape with such lengths is in balance
            misfit = True
        if not misfit:
            self.rest = rest
        self._lengths_misfit, self._lengths_moved = misfit, moved
        return (replace(lengths, rest_in_doubt=moved or misfit) for lengths in chain(taken, later))

    def _watched(
        self, frames: Iterable[TendonLengths], method: str, factory: EstimatorFactory, progress: Progress | None
    ) -> Iterator[Shape]:
        """Yield shapes, which are estimated in one thread, see `one_thread`, and what looks wrong of each."""
        with one_thread():
            self.watch = watch = RunWatch(self.trial, self.rest, self.settings.gate)
            shapes = map(watch.observe, self._shapes(map(watch.take, frames), method, factory, progress))
            shapes = map(self.aids.use.observe, shapes)
            yield from map(PossibleShapes(self.rest).check, shapes)

    def _shapes(
        self, frames: Iterable[TendonLengths], method: str, factory: EstimatorFactory, progress: Progress | None
    ) -> Iterator[Shape]:
        rest, settings, robot = self.rest, self.settings, self.trial.robot
        if robot is not None:
            with_pose = WITH_POSE[type(robot)][method]
            return _estimated_from_rest(
                lambda first_s: with_pose(rest, robot.begun(first_s), settings), frames, progress
            )
        shapes = _estimated(factory(rest.structure, rest, settings), frames, progress)
        if self.trial.imus and self.trial.rest_seconds > 0:
            return map(MovingBase(rest, self.trial.imus, self.trial.rest_seconds).observe, shapes)
        return shapes

    def warnings(self) -> dict[str, str]:
        """Return what looks wrong of boards, of lengths that are told, and of other sensors, by the board or sensor."""
        clocks = self.boards.warnings() if self.boards else {}
        return self._slow_sources() | clocks | self._told.warnings() | self.aids.warnings()

    def rest_complaints(self) -> Iterator[tuple[str, str]]:
        """Yield what looks wrong at rest, and what to do: the name of a row of a table and its text."""
        return rest_complaints(
            self.rest.wrong, self.front_end.exchanged, misfits=self.misfits_at_rest, moved=self.moved_at_rest
        )

    def _slow_sources(self) -> dict[str, str]:
        """Return of each board, or of a file of resistances, that is slower than the frames what that means."""
        found = self._frames.slow_sources()
        return {f"board {source}" if self.boards else "resistances": text for source, text in found.items()}

    def aid_counts(self) -> dict[str, int]:
        """Return how many readings of other sensors were left out, and how many frames had none; none that is zero."""
        return {name: n for name, n in (self.aids.counts() | self.winding.counts()).items() if n}

    @property
    def misfits_at_rest(self) -> bool:
        """Whether at least half of the sensors, or the lengths that are told, do not fit the rest shape."""
        return self.front_end.misfits_at_rest or self.watch.misfits_at_rest or self._lengths_misfit

    @property
    def moved_at_rest(self) -> bool:
        """Whether the structure moved while it was to stand still."""
        return self.front_end.moved_at_rest or self._lengths_moved

    def lengths(self, readings: Iterable[Reading], ahead: int = 1) -> Iterator[TendonLengths]:
        """Yield the lengths of all tendons in every frame.

        Args:
            readings: rows of boards, readings of resistance, or lengths, in order of arrival.
            ahead: number of frames, 1 or more, that are read before their lengths are computed, all at once. Live, each
                frame's are wanted as soon as it is complete; offline, the front end takes 0.4 of the time for many
                frames at once, and the lengths are the same.
        """
        for block in self._blocks(readings, ahead):
            computed = iter(self.front_end.lengths([each for each in block if isinstance(each, ResistanceFrame)]))
            for reading in block:
                if isinstance(reading, AidReading):
                    if self.aids.take(reading):
                        yield from self._in_pause(reading.t_s)
                elif isinstance(reading, NaturalLengthReading):
                    self.winding.add(reading)
                elif isinstance(reading, TendonLengths):
                    yield from self._in_pause(reading.t_s)
                    checked = self._told.checked(reading)
                    if checked is not None:
                        yield from map(self._completed, self._pauses.up_to(checked))
                else:
                    yield self._completed(next(computed))  # strain and length, eqs. (2)-(4)

    def _blocks(
        self, readings: Iterable[Reading], ahead: int
    ) -> Iterator[list[ResistanceFrame | TendonLengths | OtherReading]]:
        """Yield readings with frames of resistance in place of rows, up to each `ahead`-th frame.

        While no frame waits for others, each reading is a block of its own.
        """
        block: list[ResistanceFrame | TendonLengths | OtherReading] = []
        frames = 0
        for reading in self._with_frames(readings):
            block.append(reading)
            frames += isinstance(reading, ResistanceFrame)
            if frames in (0, ahead):
                yield block
                block, frames = [], 0
        yield block

    def _with_frames(self, readings: Iterable[Reading]) -> Iterator[ResistanceFrame | TendonLengths | OtherReading]:
        """Yield frames of resistance in place of rows of counts and resistances, and what else is read as it is."""
        for reading in readings:  # each is one row of one board, in order of arrival
            if isinstance(reading, BoardReading | ResistanceReading):
                resistance = self._resistance(reading)  # eq. (1), at its time on the host clock
                yield from self._frames.add(resistance) if resistance else ()  # all sensors at one instant
            elif isinstance(reading, OtherReading):
                check_other(reading, self.trial)
                yield reading
            elif isinstance(reading, TendonLengths):
                yield reading
            else:
                raise InputError(f"readings: expected those of `open_trial(path).readings()`, got {reading!r:.60}")
        yield from self._frames.finish()

    def _in_pause(self, t_s: float) -> Iterator[TendonLengths]:
        """Yield frames without lengths, where rows of lengths pause, and other sensors follow how a robot moves."""
        if not self.rest.structure.is_held and self.trial.has_aids:
            yield from map(self._completed, self._pauses.until(t_s))

    def _resistance(self, reading: BoardReading | ResistanceReading) -> ResistanceReading | None:
        if isinstance(reading, ResistanceReading):
            check_resistance(reading, self.trial)
            return reading
        if self.boards is None:
            raise InputError(f"row of board {reading.board}: the trial has {self.trial.source} in place of boards")
        return self.boards.reading(reading)

    def _completed(self, lengths: TendonLengths) -> TendonLengths:
        """Return lengths of strips as a frame: with the strings that motors wind, what else was read, and factors."""
        lengths = self.aids.given_to(self.winding.applied(lengths))
        return replace(lengths, factors=(*self.factors, *lengths.factors)) if self.factors else lengths


def reconstruct(
    trial: Trial | str | Path,
    method: str = "batch",
    *,
    settings: Settings | None = None,
    model: AnySensorModel | str | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Return the shapes of a whole trial.

    Args:
        trial: an opened trial, or the path of its directory.
        method: `batch` estimates each shape from all frames, `live` from its frame and those before it, `frame` from
            its frame alone. For comparison, `least-squares` is the paper's method and `ukf` an unscented Kalman filter;
            both use the past only. Any other name in `ESTIMATORS`, and of an estimator that another package brings,
            is possible, too.
        settings: the settings of the run; the defaults if None.
        model: the sensor model, or the name of one that another package brings; the one that ships with this package if
            None.
        progress: called after each iteration of a method that optimises over all frames, with its number and error.

    Raises:
        InputError: for anything in the trial that cannot be read.
        IndeterminateError: when the readings and priors leave some node free.
    """
    trial = trial if isinstance(trial, Trial) else open_trial(trial)
    pipeline = _pipeline_of(trial.description, settings, model)
    shapes = pipeline.shapes(pipeline.lengths(trial.readings(), OFFLINE_FRAMES), method, progress)
    return Reconstruction.of(trial.description.structure, shapes)


def stream(
    readings: Iterable[Reading],
    trial: TrialDescription,
    method: str = "live",
    *,
    settings: Settings | None = None,
    model: AnySensorModel | str | None = None,
) -> Iterator[Shape]:
    """Yield shapes from any iterable of readings, as the readings arrive.

    Args:
        readings: rows of boards, readings of resistance, or lengths, in order of arrival.
        trial: description of the trial, which is known before its first reading.
        method: see `reconstruct`.
        settings: see `reconstruct`.
        model: see `reconstruct`.

    Raises:
        InputError: see `reconstruct`.
        IndeterminateError: see `reconstruct`.
    """
    return _pipeline_of(trial, settings, model).estimate(readings, method)


def rest_shape_of_trial(trial: Trial, settings: Settings) -> RestShape:
    """Return the rest shape of a recorded trial, of which lengths at rest are read where these tell it.

    Raises:
        InputError: see `reconstruct`.
    """
    description = trial.description
    if description.source != "lengths":  # no lengths tell it, and the sensor model may be another one than ours
        return rest_shape_of(description, settings.for_robot(description.structure, description.mechanics).rest)
    pipeline = _pipeline_of(description, settings, None)
    pipeline.after_rest(pipeline.lengths(trial.readings()))
    return pipeline.rest


def sensor_model_plug_ins() -> dict[str, PlugIn]:
    """Return the sensor models that other packages bring, by name."""
    return plug_ins("sensor_models", ())


def sensor_model_of(model: AnySensorModel | str | None) -> AnySensorModel:
    """Return a sensor model, that of the package for None, or the one of another package that has a name.

    Raises:
        InputError: for a name that is none, or a path.
    """
    if not isinstance(model, str | Path):
        return model or read_sensor_model()
    others = sensor_model_plug_ins()
    if str(model) in others:
        made: StrainModelFactory = others[str(model)].load()
        return made
    known = f", or one of {', '.join(others)}" if others else ""
    raise InputError(
        f"model: expected a SensorModel, as read_sensor_model({str(model)!r}) returns it{known}, got a path"
    )


def _pipeline_of(trial: TrialDescription, settings: Settings | None, model: AnySensorModel | str | None) -> Pipeline:
    """Return the pipeline of a trial, with defaults for None.

    Raises:
        InputError: for what is no description of a trial.
    """
    if not isinstance(trial, TrialDescription):
        raise InputError(f"expected the description of a trial, as trial.description, got {type(trial).__name__}")
    return Pipeline(trial, checked_settings(settings), sensor_model_of(model))
