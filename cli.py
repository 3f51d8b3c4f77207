"""The command line: `tensegraph --help`."""

import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from .io.calibration import read_recordings
from .io.model_file import read_sensor_model, write_sensor_model
from .io.result import check_result_path
from .io.toml import read_settings
from .io.trial import Trial, open_trial
from .models.errors import TensegraphError
from .models.reconstruction import Reconstruction
from .models.sensor_model import SensorModel
from .models.settings import Settings
from .pipeline import Method, Pipeline, write_result
from .report import Run, training_table
from .simulation import simulate as simulate_trial

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
) -> None:
    r"""Reconstruct recorded trials: shapes with ellipsoids, lengths, status, figures.

    \b
    tensegraph reconstruct examples/press_01
    tensegraph reconstruct examples/press_01 --live --out results/press_01_live
    """
    settings, model = read_settings(config), read_sensor_model()
    opened = [open_trial(path) for path in trials]
    results = _result_paths(opened, out)
    for trial, path in zip(opened, results, strict=True):
        run = _run(trial, "live" if live else "batch", settings, model)
        write_result(run.reconstruction, path, f"{trial.name}, {run.method}", run.as_table(), settings)
        console.print(run.summary())
        console.print(f"written to {path}", highlight=False)


@app.command()
def calibrate(
    folder: Annotated[Path, typer.Argument(help="Folder of calibration recordings (*.csv).")],
    out: Annotated[Path, typer.Option(help="Model file to write (*.safetensors).")],
    seed: Annotated[int, typer.Option(help="Of the training's random numbers.")] = 0,
) -> None:
    """Train the stretching network on calibration recordings."""
    from .models.training import TrainingSettings, train  # torch takes seconds to import

    recordings, settings = read_recordings(folder), TrainingSettings(seed=seed)
    with Progress(*COLUMNS, TextColumn("{task.fields[loss]}"), console=console) as progress:
        task = progress.add_task("training", total=settings.epochs, loss="")
        model = train(
            recordings, settings, lambda epoch, loss: progress.update(task, completed=epoch, loss=f"loss {loss:.3f}")
        )
    write_sensor_model(model, out)
    console.print(training_table(model))
    console.print(f"written to {out}", highlight=False)


@app.command()
def simulate(
    plan: Annotated[Path, typer.Argument(help="Plan (*.toml), such as those in examples/plans.")],
    out: Annotated[Path, typer.Option(help="Trial directory to write.")],
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the plan's own.")] = None,
) -> None:
    """Simulate a structure, its sensors and its boards: a trial with its truth."""
    start = time.perf_counter()
    trial = simulate_trial(plan, out, seed)
    seconds = time.perf_counter() - start
    console.print(f"{trial.name}: {trial.row_count()} rows in {seconds:.1f} s, written to {out}", highlight=False)


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
