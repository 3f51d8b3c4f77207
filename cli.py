"""The command line: `tensegraph --help`."""

import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from .calibration import calibrate_folder
from .io.calibration import read_rig
from .io.calibration_output import CalibrationPaths
from .io.model_file import read_sensor_model
from .io.result import check_result_path
from .io.toml import read_settings
from .io.trial import Trial, open_trial
from .models.errors import TensegraphError
from .models.recipe import TrainingSettings
from .models.reconstruction import Reconstruction
from .models.sensor_model import SensorModel
from .models.settings import Settings
from .pipeline import Method, Pipeline, write_result
from .report import Run

app = typer.Typer(
    help="Shape of a tensegrity, with uncertainty, from its strain-sensing tendons.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
console = Console()
COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())


@app.command()
def reconstruct(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories, each with a trial.toml.")],
    live: Annotated[bool, typer.Option("--live", help="Use the past only, frame by frame.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Result directory; of several trials the one that holds theirs. [default: results/TRIAL]"),
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Settings that differ from the defaults, as TOML.")] = None,
    model: Annotated[
        Path | None, typer.Option(help="Sensor model that `calibrate` wrote. [default: the one that ships]")
    ] = None,
) -> None:
    r"""Reconstruct recorded trials: shapes with ellipsoids, lengths, status, figures.

    \b
    tensegraph reconstruct examples/press_01
    tensegraph reconstruct examples/press_01 --live --out results/press_01_live
    """
    settings, sensor_model = read_settings(config), read_sensor_model(model)
    opened = [open_trial(path) for path in trials]
    results = _result_paths(opened, out)
    for trial, path in zip(opened, results, strict=True):
        run = _run(trial, "live" if live else "batch", settings, sensor_model)
        write_result(run.reconstruction, path, f"{trial.name}, {run.method}", run.as_table(), settings)
        console.print(run.summary())
        console.print(f"written to {path}", highlight=False)


@app.command()
def calibrate(
    folder: Annotated[Path, typer.Argument(help="Folder of calibration recordings (*.csv).")],
    out: Annotated[Path, typer.Option(help="Model file to write (*.safetensors); card and figures go beside it.")],
    rig: Annotated[Path | None, typer.Option(help="Which columns are what, in which units, as TOML.")] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="Recordings to test with, by name (*_0.05_*); may be repeated.")
    ] = None,
    hold_out_tail: Annotated[
        float | None, typer.Option(help="Test with this last share of each recording.", min=0.05, max=0.9)
    ] = None,
    unified: Annotated[bool, typer.Option("--unified", help="One signed network for bending and stretching.")] = False,
    sweep: Annotated[bool, typer.Option("--sweep", help="Try learning rates first, and draw the losses.")] = False,
    epochs: Annotated[int, typer.Option(help="Most epochs of the training.", min=1)] = TrainingSettings().epochs,
    learning_rate: Annotated[float, typer.Option(help="Peak of the schedule.")] = TrainingSettings().learning_rate,
    seed: Annotated[int, typer.Option(help="Of the training's random numbers.")] = 0,
) -> None:
    r"""Calibrate the sensors from recordings of strips: model file, model card, figures.

    \b
    tensegraph calibrate examples/calibration --out rubber.safetensors
    tensegraph reconstruct examples/press_01 --model rubber.safetensors
    """
    if hold_out and hold_out_tail is not None:
        raise TensegraphError("--hold-out and --hold-out-tail: expected one of them, got both")
    settings = TrainingSettings(epochs=epochs, learning_rate=learning_rate, unified=unified, seed=seed)
    try:
        calibrate_folder(
            folder, CalibrationPaths(out), read_rig(rig), settings, hold_out, hold_out_tail, sweep, console
        )
    except KeyboardInterrupt:
        console.print("interrupted: the same command goes on from where it was")
        raise typer.Exit(130) from None


def _result_paths(trials: list[Trial], out: Path | None) -> list[Path]:
    """Return where each trial's result goes; refuse, before any work, what could not be written there."""
    single = out is not None and len(trials) == 1
    names = [trial.path.resolve().name for trial in trials]
    for name in {name for name in names if names.count(name) > 1}:
        raise TensegraphError(f"two trials are named {name}: reconstruct them one by one, each with its --out")
    paths = [out] if single and out else [(out or Path("results")) / name for name in names]
    for path in paths:
        check_result_path(path)
    return paths


def _run(trial: Trial, method: Method, settings: Settings, model: SensorModel) -> Run:
    pipeline = Pipeline(trial.description, settings, model)
    with Progress(*COLUMNS, console=console, transient=True) as progress:
        readings = progress.track(trial.readings(), total=trial.row_count(), description=trial.name)
        start = time.perf_counter()
        reconstruction = Reconstruction.of(trial.description.structure, pipeline.estimate(readings, method))
        seconds = time.perf_counter() - start
    return Run(trial, method, settings, pipeline, reconstruction, seconds)


def main() -> None:
    """Run the command line; what is wrong with the input is one line on stderr and exit code 2."""
    try:
        app()
    except TensegraphError as error:
        Console(stderr=True).print(f"tensegraph: {error}", highlight=False, markup=False, soft_wrap=True)
        sys.exit(2)
