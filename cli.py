"""The command line: `tensegraph --help`."""

import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from .calibration import calibrate_folder
from .comparison import COMPARISON_FILE, comparison_rows, measure, write_comparison
from .io.calibration import read_rig
from .io.calibration_output import CalibrationPaths
from .io.comparison import as_markdown
from .io.model_file import read_sensor_model
from .io.result import RUN_FILE, check_result_path
from .io.toml import read_settings
from .io.trial import Trial, open_trial
from .models.errors import TensegraphError
from .models.readings import TendonLengths
from .models.recipe import TrainingSettings
from .models.reconstruction import Reconstruction
from .models.sensor_model import SensorModel
from .models.settings import Settings
from .pipeline import Method, Pipeline, write_result
from .report import Run
from .score import EVALUATION_FILE, as_text, score_result, write_score
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
    method: Annotated[
        Literal["graph", "least-squares", "ukf"],
        typer.Option(help="The factor graph, the paper's least squares, or an unscented Kalman filter."),
    ] = "graph",
    live: Annotated[
        bool, typer.Option("--live", help="Use the past only, frame by frame, as least-squares and ukf do anyway.")
    ] = False,
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
    tensegraph reconstruct examples/press_01 --method ukf --out results/press_01_ukf
    """
    settings, sensor_model = read_settings(config), read_sensor_model(model)
    chosen: Method = method if method != "graph" else "live" if live else "batch"
    opened = [open_trial(path) for path in trials]
    results = _result_paths(trials, out, Path("results"), RUN_FILE)
    for trial, path in zip(opened, results, strict=True):
        run = _run(trial, chosen, settings, sensor_model)
        write_result(run.reconstruction, path, f"{trial.name}, {run.method}", run.as_table(path), settings)
        console.print(run.summary())
        console.print(f"written to {path}", highlight=False)


@app.command()
def evaluate(
    results: Annotated[list[Path], typer.Argument(help="Result directories, as reconstruct writes them.")],
    truth: Annotated[
        Path | None, typer.Option(help="Stamped node positions (t_s, n0_x_m ...). [default: the trial's own]")
    ] = None,
    trial: Annotated[Path | None, typer.Option(help="Trial directory. [default: where the result says]")] = None,
    align: Annotated[bool, typer.Option("--align", help="Turn and shift the truth so that it fits best.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON in place of tables.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Where to; of several results, what holds theirs. [default: results/evaluation/RESULT]"),
    ] = None,
) -> None:
    r"""Evaluate results against the truth: errors, honesty of the ellipsoids, faults seen, with figures.

    \b
    tensegraph evaluate results/press_01
    tensegraph evaluate results/press_01 --truth mocap.csv --align
    """
    written = _result_paths(results, out, Path("results/evaluation"), EVALUATION_FILE)
    scores = [score_result(path, truth, trial, align=align) for path in results]
    for score, path in zip(scores, written, strict=True):
        write_score(score, path)
        if not json:
            console.print(score.as_table())
            console.print(f"written to {path}", highlight=False)
    if json:
        print(as_text([score.as_json() for score in scores]), end="")


@app.command()
def compare(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories, with truth.")],
    out: Annotated[Path, typer.Option(help="Where the table and the figure go.")] = Path("results/comparison"),
    config: Annotated[Path | None, typer.Option(help="Settings that differ from the defaults, as TOML.")] = None,
) -> None:
    r"""Compare all methods on the same lengths: the paper's Table I, measured here.

    \b
    tensegraph compare examples/press_01
    """
    _distinct_names(trials)
    check_result_path(out, COMPARISON_FILE)
    settings, model = read_settings(config), read_sensor_model()
    opened = [open_trial(path) for path in trials]
    measured = []
    with Progress(*COLUMNS, console=console, transient=True) as progress:

        def track(frames: Iterable[TendonLengths], total: int, name: str) -> Iterable[TendonLengths]:
            task = progress.add_task(name, total=total)
            for frame in frames:
                yield frame
                progress.advance(task)
            progress.remove_task(task)  # its line stays, with what came out

        for trial in opened:
            for one in measure(trial, settings, model, track):
                measured.append(one)
                progress.console.print(one.line(), highlight=False)
    rows = comparison_rows(measured)
    command = "tensegraph compare " + " ".join(trial.path.as_posix() for trial in opened)
    write_comparison(rows, command, out)
    console.print(Markdown(as_markdown(rows, command)))
    console.print(f"written to {out}", highlight=False)


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


def _result_paths(sources: list[Path], out: Path | None, default: Path, marker: str) -> list[Path]:
    """Return where what comes of each source goes; refuse, before any work, what could not be written there."""
    names = _distinct_names(sources)
    paths = [out] if out and len(sources) == 1 else [(out or default) / name for name in names]
    for path in paths:
        check_result_path(path, marker)
    return paths


def _distinct_names(sources: list[Path]) -> list[str]:
    """Return the directories' names; refuse two alike, since what comes of them is told apart by them."""
    names = [source.resolve().name for source in sources]
    for name in {name for name in names if names.count(name) > 1}:
        raise TensegraphError(f"two of these are named {name}: take them one by one, each with its --out")
    return names


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
