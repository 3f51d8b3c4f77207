"""`calibrate`: makes a sensor model, its card and its figures from a folder of recordings."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rich.progress import TextColumn

from ..io.calibration.calibration_output import CalibrationPaths, CheckpointFile
from ..io.calibration.recording_files import read_rig
from ..io.figures.calibration_figures import write_calibration_figures, write_sweep_figure
from ..io.model_file import read_sensor_model, write_sensor_model
from ..io.reports.model_card import CalibrationReport
from ..io.reports.terminal import Terminal
from ..models.calibration.recipe import Trained, TrainingSettings
from ..models.values.errors import InputError, naming
from ..scoring.sensor_calibration import HoldOut, TrainingData, report_of, training_data
from .many import Many, Workers

SWEEP = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0)
"""Learning rates that are tried."""
SWEEP_EPOCHS = 40
"""Number of epochs of each of these short trainings."""


def calibrate_folder(
    folder: Path,
    out: Path,
    *,
    rig: Path | None,
    hold_out: HoldOut,
    settings: TrainingSettings,
    sweep: bool,
    workers: Workers,
    terminal: Terminal,
) -> None:
    """Train on a folder of recordings; write model, card and figures, and print the scores.

    Args:
        folder: folder of recordings.
        out: file of the model; card and figures go beside it.
        rig: path of the file that describes the recordings; see `read_rig`.
        hold_out: choice of recordings that test the model.
        settings: settings of the training.
        sweep: whether to try learning rates first.
        workers: the processes that try them.
        terminal: for progress and scores.

    Raises:
        TensegraphError: when there is nothing to train on, or the model cannot be written.
        SystemExit: with 130 after Ctrl-C; the state of the training is kept.
    """
    paths = CalibrationPaths(out)
    strip_rig = read_rig(rig)
    paths.check()
    start_s = time.perf_counter()
    try:
        with naming(folder), terminal.stage("recordings and bending"):
            data = training_data(folder, strip_rig, hold_out, settings.unified)
            for line in data.folder.left_out:
                terminal.error(f"left out: {line}")
        losses = _sweep(data, settings, paths, workers, terminal) if sweep else {}
        with naming(folder, paths.checkpoint), terminal.stage("training"):
            trained = _train(data, settings, CheckpointFile(paths.checkpoint), terminal)
            report = report_of(data, trained, settings, strip_rig, hold_out, start_s)
        with terminal.stage("files"):
            _write(report, losses, settings.learning_rate, paths)
    except KeyboardInterrupt:
        terminal.written("interrupted: the same command goes on from where it was")
        raise SystemExit(130) from None
    terminal.news.print(report.table())
    terminal.news.print(report.verdict())
    terminal.written(f"written to {paths.model}, {paths.card} and {paths.figures}")


def _train(data: TrainingData, settings: TrainingSettings, checkpoint: CheckpointFile, terminal: Terminal) -> Trained:
    from ..models.calibration.training import train  # torch takes seconds to import

    with terminal.progress(TextColumn("{task.fields[loss]}")) as progress:
        task = progress.add_task("training", total=settings.epochs, loss="")
        return train(
            data.split,
            data.curve,
            settings,
            lambda epoch, loss: progress.update(task, completed=epoch, loss=f"loss {loss:.3f}"),
            checkpoint,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _ShortTraining:
    """One learning rate to be tried."""

    data: TrainingData
    settings: TrainingSettings
    checkpoint: CheckpointFile
    """Its state, so that the same command goes on from there, and does not repeat what was finished."""


def _sweep(
    data: TrainingData, settings: TrainingSettings, paths: CalibrationPaths, workers: Workers, terminal: Terminal
) -> dict[float, float]:
    """Return the least validation loss of a short training at each learning rate; inf where it diverged."""
    short = replace(settings, epochs=min(SWEEP_EPOCHS, settings.epochs))
    jobs = {
        f"{rate:g}": _ShortTraining(
            data, replace(short, learning_rate=rate), CheckpointFile(workers.place(paths.of_rate(rate)))
        )
        for rate in SWEEP
    }
    many = Many(workers, terminal)
    found = dict(many.each(_least_loss, jobs, "learning rates"))
    many.end()
    losses = {rate: found[f"{rate:g}"] for rate in SWEEP}
    best = min(losses, key=lambda rate: losses[rate])
    terminal.line(f"least validation loss after {short.epochs} epochs at learning rate {best:g}")
    return losses


def _least_loss(job: _ShortTraining, terminal: Terminal) -> float:
    from ..models.calibration.training import train

    with terminal.stages(f"learning rate {job.settings.learning_rate:g}", {"epochs": 1.0}) as bar:
        return train(
            job.data.split,
            job.data.curve,
            job.settings,
            lambda epoch, _: bar.reached("epochs", epoch / job.settings.epochs),
            job.checkpoint,
        ).history.best_loss


def _write(
    report: CalibrationReport, losses: Mapping[float, float], learning_rate: float, paths: CalibrationPaths
) -> None:
    """Write figures, card and model, all or none."""
    with paths.written_whole() as inside:
        write_calibration_figures(report.calibration, inside.figures)
        if losses:
            write_sweep_figure(losses, learning_rate, inside.figures / "sweep.png")
        inside.card.write_text(report.card(), encoding="utf-8")
        write_sensor_model(report.model(), inside.model)
        try:
            read_sensor_model(inside.model)
        except InputError as error:
            paths.remove_checkpoints()  # the same training would give the same model
            reason = str(error).removeprefix(f"{inside.model}: ")
            raise InputError(
                f"{paths.model}: not written: the recordings give a model that no command would take: {reason}"
            ) from error
