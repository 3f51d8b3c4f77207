"""A sensor model from a folder of recordings, with its scores."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..io.calibration.recording_files import RecordingFolder, read_recordings, read_rig
from ..models.calibration.bending_fit import BendingFit, fit_bending
from ..models.calibration.calibrated_model import calibrate_model
from ..models.calibration.recipe import Trained, TrainingSettings
from ..models.calibration.recordings import Recording, Split
from ..models.calibration.strip_rig import StripRig
from ..models.sensor.bending import BendingCurve
from ..models.values.errors import TensegraphError
from ..models.values.tables import parse_table

if TYPE_CHECKING:
    from ..io.reports.model_card import CalibrationReport


def calibrate(
    folder: str | Path,
    *,
    rig: str | Path | None = None,
    hold_out: str | Sequence[str] = (),
    hold_out_tail: float | None = None,
    settings: TrainingSettings | None = None,
    progress: Callable[[int, float], None] = lambda epoch, loss: None,
) -> "CalibrationReport":
    """Train a sensor model on a folder of recordings; `report.model()` is what `reconstruct` takes as `model`.

    Nothing is written: `write_sensor_model` writes a model file.

    Args:
        folder: folder of recordings.
        rig: file that describes the recordings; see `read_rig`.
        hold_out: pattern, or patterns, of the names of the recordings that test the model; see `Split.by_recordings`
            for none.
        hold_out_tail: share of each recording, at its end, that tests the model instead.
        settings: settings of the training; the defaults if None.
        progress: called after each epoch with its number and mean loss.

    Raises:
        TensegraphError: when there is nothing to train on, or a setting is not allowed.
    """
    from ..models.calibration.training import train  # torch takes seconds to import

    start_s = time.perf_counter()
    names = (hold_out,) if isinstance(hold_out, str) else tuple(hold_out)
    chosen, strip_rig = HoldOut(names, hold_out_tail), read_rig(None if rig is None else Path(rig))
    checked = parse_table(TrainingSettings, asdict(settings or TrainingSettings()), "settings")
    data = training_data(Path(folder), strip_rig, chosen, checked.unified)
    trained = train(data.split, data.curve, checked, progress)
    return report_of(data, trained, checked, strip_rig, chosen, start_s)


@dataclass(frozen=True, slots=True)
class HoldOut:
    """The choice of recordings that test the model: by name, by time, or else as in `Split.by_recordings`.

    Raises:
        TensegraphError: when both names and a tail are given.
    """

    names: tuple[str, ...]
    """Patterns of the names of whole recordings."""
    tail: float | None
    """Share of each recording, at its end."""

    def __post_init__(self) -> None:
        if self.names and self.tail is not None:
            raise TensegraphError("recordings held out by name and by a tail: expected one of the two, got both")

    def split(self, recordings: Sequence[Recording]) -> Split:
        """Return the recordings for training, validation and test."""
        if self.names:
            return Split.by_name(recordings, self.names)
        return Split.by_recordings(recordings) if self.tail is None else Split.by_time(recordings, self.tail)

    def words(self) -> list[str]:
        """Return the same choice as command-line options."""
        names = [f"--hold-out '{pattern}'" for pattern in self.names]
        return names + ([f"--hold-out-tail {self.tail:g}"] if self.tail is not None else [])


@dataclass(frozen=True, slots=True, eq=False)
class TrainingData:
    """The data of a training."""

    folder: RecordingFolder
    split: Split
    bending: BendingFit | None
    """The fit of bending; None if no recording bends."""

    @property
    def curve(self) -> BendingCurve:
        """The fitted curve of bending, or that of the paper if there is no fit."""
        return self.bending.curve() if self.bending else BendingCurve()


def training_data(folder: Path, rig: StripRig, hold_out: HoldOut, unified: bool) -> TrainingData:
    """Return the recordings of a folder, split, and the fit of bending; see `calibrate`.

    Raises:
        InputError: when there is nothing to train on, or nothing that can be scored.
    """
    found = read_recordings(folder, rig)
    split = hold_out.split(found.recordings)
    split.scored(unified)  # before the training
    return TrainingData(found, split, fit_bending([*split.training, *split.validation], split.held_out))


def report_of(
    data: TrainingData,
    trained: Trained,
    settings: TrainingSettings,
    rig: StripRig,
    hold_out: HoldOut,
    start_s: float,
) -> "CalibrationReport":
    """Return the report of a training that began at a time of `time.perf_counter`."""
    from ..io.reports.model_card import CalibrationReport  # rich

    return CalibrationReport(
        calibration=calibrate_model(data.split, trained, data.bending, settings),
        folder=data.folder,
        rig=rig,
        command=_command(rig, settings, hold_out),
        seconds=time.perf_counter() - start_s,
    )


def _command(rig: StripRig, settings: TrainingSettings, hold_out: HoldOut) -> str:
    """Return the command that makes the same model again, with placeholders for paths."""
    words = ["tensegraph calibrate FOLDER --out MODEL"]
    words += ["--rig RIG.toml"] if rig != StripRig() else []
    words += hold_out.words()
    words += ["--unified"] if settings.unified else []
    words += [f"--epochs {settings.epochs} --learning-rate {settings.learning_rate:g} --seed {settings.seed}"]
    return " ".join(words)
