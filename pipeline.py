"""The loop: counts to resistance to strain to length to shape. Only the root sees both io and estimator."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from .estimator.baselines import LeastSquares, UnscentedKalman
from .estimator.batch import BatchOptimizer
from .estimator.frame import FrameEstimator
from .estimator.rest_step import rest_step
from .estimator.smoother import LiveSmoother
from .io.figures.shape_figures import write_figures
from .io.model_file import read_sensor_model
from .io.result import result_directory, write_run, write_tables
from .io.trial_directory import Reading, Trial, open_trial
from .models.sensor.drift import ReferenceTendons
from .models.sensor.frames import FrameAssembler
from .models.sensor.front_end import FrontEnd
from .models.sensor.sensor_model import SensorModel
from .models.settings import Settings
from .models.structure.reconstruction import Reconstruction
from .models.structure.rest_shape import RestShape
from .models.structure.shape import Shape
from .models.structure.structure import Structure
from .models.trial_description import TrialDescription
from .models.values.readings import BoardReading, ResistanceReading, TendonLengths

Method = Literal["batch", "live", "frame", "least-squares", "ukf"]


class Estimator(Protocol):
    """Frames of length in, shapes out; anything of this form can stand in the pipeline."""

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        ...


ESTIMATORS: dict[Method, Callable[[Structure, RestShape, Settings], Estimator]] = {
    "batch": BatchOptimizer,
    "live": LiveSmoother,
    "frame": FrameEstimator,
    "least-squares": LeastSquares,
    "ukf": UnscentedKalman,
}
"""A method of your own stands here: its name in `Method`, and a class of the form above."""


class Pipeline:
    """Everything between the readings of one trial and its shapes, set up once from the trial's description."""

    def __init__(self, trial: TrialDescription, settings: Settings, model: SensorModel) -> None:
        self.trial, self.settings = trial, settings
        rest = rest_step(trial.structure, trial.mechanics, trial.rest_position_m, settings.rest)
        self.rest = replace(rest, at_start=trial.rest_seconds > 0)
        self.boards = trial.boards(settings.clock) if trial.source == "counts" else None
        self._frames = FrameAssembler(
            trial.natural_resistance_ohm, max(len(trial.tendons_of_board), 1), settings.frames, settings.gate
        )
        self.front_end = FrontEnd(
            model,
            trial.natural_resistance_ohm,
            trial.structure.natural_length_m,
            self.rest.lengths(trial.structure, trial.rest_seconds) if trial.rest_seconds > 0 else None,
            settings.front_end,
            1 / settings.frames.rate_hz,
            ReferenceTendons(np.flatnonzero(~trial.structure.is_free_tendon), settings.drift),
        )

    def estimate(self, readings: Iterable[Reading], method: Method = "batch") -> Iterator[Shape]:
        """Yield the shape of every frame, live ones as soon as they can be known."""
        return self.shapes(self.lengths(readings), method)

    def shapes(self, frames: Iterable[TendonLengths], method: Method) -> Iterator[Shape]:
        """Yield the shape of every frame of lengths."""
        return ESTIMATORS[method](self.trial.structure, self.rest, self.settings).estimate(frames)

    def lengths(self, readings: Iterable[Reading]) -> Iterator[TendonLengths]:
        """Yield all tendon lengths, frame by frame."""
        for reading in readings:  # of one board, as they arrive
            if isinstance(reading, TendonLengths):
                yield self._with_sigma(reading)
                continue
            resistance = self._resistance(reading)  # eq. (1), at its time on the host clock
            for frame in self._frames.add(resistance) if resistance else ():  # one instant of all sensors
                yield self.front_end.step(frame)  # strain and length, eqs. (2)-(4)
        for frame in self._frames.finish():
            yield self.front_end.step(frame)

    def _resistance(self, reading: BoardReading | ResistanceReading) -> ResistanceReading | None:
        if isinstance(reading, ResistanceReading):
            return reading
        assert self.boards is not None, "rows of counts need a trial with boards"
        return self.boards.reading(reading)

    def _with_sigma(self, lengths: TendonLengths) -> TendonLengths:
        sigma_m = np.where(np.isnan(lengths.sigma_m), self.settings.noise.unstated_m, lengths.sigma_m)
        return replace(lengths, sigma_m=np.where(np.isnan(lengths.length_m), np.inf, sigma_m))


def reconstruct(
    trial: Trial | str | Path,
    method: Method = "batch",
    *,
    settings: Settings | None = None,
    model: SensorModel | None = None,
) -> Reconstruction:
    """Return the shapes of a whole trial.

    Args:
        trial: an opened trial, or the path of its directory.
        method: `batch` uses all frames for each, `live` only those up to it, `frame` that frame alone; of others,
            `least-squares` is the paper's, `ukf` an unscented Kalman filter (both use the past only).
        settings: defaults if None.
        model: of the sensors; the one that ships with the package if None.

    Raises:
        InputError: for anything in the trial that can not be read.
        IndeterminateError: when the readings and priors leave some node free.
    """
    trial = trial if isinstance(trial, Trial) else open_trial(trial)
    shapes = stream(trial.readings(), trial.description, method, settings=settings, model=model)
    return Reconstruction.of(trial.description.structure, shapes)


def stream(
    readings: Iterable[Reading],
    trial: TrialDescription,
    method: Method = "live",
    *,
    settings: Settings | None = None,
    model: SensorModel | None = None,
) -> Iterator[Shape]:
    """Yield shapes from any iterator of readings, as they come.

    Args:
        readings: rows of boards, readings of resistance, or lengths, in order of arrival.
        trial: what is known of the trial before its first reading.
        method: see `reconstruct`.
        settings: see `reconstruct`.
        model: see `reconstruct`.

    Raises:
        InputError: see `reconstruct`.
        IndeterminateError: see `reconstruct`.
    """
    pipeline = Pipeline(trial, settings or Settings(), model or read_sensor_model())
    return pipeline.estimate(readings, method)


def save(reconstruction: Reconstruction, path: str | Path, settings: Settings | None = None) -> None:
    """Write shapes as a result directory: tables, figures, and the settings.

    Args:
        reconstruction: what to write.
        path: of the directory; an earlier result there is replaced.
        settings: those that made it; their `probability` is that of the ellipsoids.

    Raises:
        InputError: when something else than an earlier result stands there.
    """
    path, settings = Path(path), settings or Settings()
    write_result(reconstruction, path, path.name, {"settings": asdict(settings)}, settings)


def write_result(
    reconstruction: Reconstruction, path: Path, title: str, run: Mapping[str, Any], settings: Settings
) -> None:
    """Write a result directory with its run.toml, whole or not at all."""
    with result_directory(path) as directory:
        write_tables(reconstruction, settings.probability, directory)
        write_figures(reconstruction, settings, title, directory)
        write_run(run, directory)
