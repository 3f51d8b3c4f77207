"""A calibration, from a folder of recordings to model, card and figures."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..io.calibration_output import CalibrationPaths, CheckpointFile
from ..io.figures.calibration_figures import write_calibration_figures, write_sweep_figure
from ..io.model_card import CalibrationReport
from ..io.model_file import write_sensor_model
from ..io.recording_files import read_recordings
from ..models.calibration.bending_fit import fit_bending
from ..models.calibration.calibrated_model import calibrate_model
from ..models.calibration.recipe import Trained, TrainingSettings
from ..models.calibration.recordings import Recording, Split
from ..models.calibration.strip_rig import StripRig
from ..models.sensor.bending import BendingCurve

SWEEP = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0)
"""Learning rates tried."""
SWEEP_EPOCHS = 40
"""Of each of these short trainings."""
COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())


def calibrate_folder(
    folder: Path,
    paths: CalibrationPaths,
    rig: StripRig,
    settings: TrainingSettings,
    hold_out: Sequence[str] | None,
    hold_out_tail: float | None,
    sweep: bool,
    console: Console,
) -> None:
    """Train on a folder of recordings; write model, card and figures, and print the scores."""
    start = time.perf_counter()
    paths.check()
    found = read_recordings(folder, rig)
    for line in found.left_out:
        console.print(f"left out: {line}", highlight=False, markup=False, soft_wrap=True)
    split = _split(found.recordings, hold_out, hold_out_tail)
    bending = fit_bending([*split.training, *split.validation], split.held_out)
    curve = bending.curve() if bending else BendingCurve()
    losses = _sweep(split, curve, settings, console) if sweep else {}
    trained = _train(split, curve, settings, CheckpointFile(paths.checkpoint), console)
    calibration = calibrate_model(split, trained, bending, settings)
    seconds = time.perf_counter() - start
    command = _command(rig, settings, hold_out, hold_out_tail)
    report = CalibrationReport(calibration, found, rig, command, seconds)
    with paths.written_whole() as inside:
        write_calibration_figures(calibration, inside.figures)
        if losses:
            write_sweep_figure(losses, settings.learning_rate, inside.figures / "sweep.png")
        inside.card.write_text(report.card(), encoding="utf-8")
        write_sensor_model(report.model(), inside.model)
    console.print(report.table())
    console.print(report.verdict())
    console.print(f"written to {paths.model}, {paths.card} and {paths.figures}", highlight=False, soft_wrap=True)


def _split(recordings: list[Recording], hold_out: Sequence[str] | None, hold_out_tail: float | None) -> Split:
    if hold_out:
        return Split.by_name(recordings, hold_out)
    return Split.by_recordings(recordings) if hold_out_tail is None else Split.by_time(recordings, hold_out_tail)


def _train(
    split: Split, curve: BendingCurve, settings: TrainingSettings, checkpoint: CheckpointFile, console: Console
) -> Trained:
    from ..models.calibration.training import train  # torch takes seconds to import

    with Progress(*COLUMNS, TextColumn("{task.fields[loss]}"), console=console) as progress:
        task = progress.add_task("training", total=settings.epochs, loss="")
        return train(
            split,
            curve,
            settings,
            lambda epoch, loss: progress.update(task, completed=epoch, loss=f"loss {loss:.3f}"),
            checkpoint,
        )


def _sweep(split: Split, curve: BendingCurve, settings: TrainingSettings, console: Console) -> dict[float, float]:
    """Return the least validation loss of a short training at each learning rate; inf where it diverged."""
    from ..models.calibration.training import train

    losses: dict[float, float] = {}
    short = replace(settings, epochs=min(SWEEP_EPOCHS, settings.epochs))
    with Progress(*COLUMNS, console=console) as progress:
        for rate in progress.track(SWEEP, description="learning rates"):
            losses[rate] = train(split, curve, replace(short, learning_rate=rate)).history.best_loss
    best = min(losses, key=lambda rate: losses[rate])
    console.print(f"least validation loss after {short.epochs} epochs at learning rate {best:g}", highlight=False)
    return losses


def _command(
    rig: StripRig, settings: TrainingSettings, hold_out: Sequence[str] | None, hold_out_tail: float | None
) -> str:
    """Return the command that makes the same model again; where from and where to does not change the model."""
    words = ["tensegraph calibrate FOLDER --out MODEL"]
    words += ["--rig RIG.toml"] if rig != StripRig() else []
    words += [f"--hold-out '{pattern}'" for pattern in hold_out or ()]
    words += [f"--hold-out-tail {hold_out_tail:g}"] if hold_out_tail is not None else []
    words += ["--unified"] if settings.unified else []
    words += [f"--epochs {settings.epochs} --learning-rate {settings.learning_rate:g} --seed {settings.seed}"]
    return " ".join(words)
