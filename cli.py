"""The command line: `tensegraph --help`."""

import math
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import Progress

from .commands.calibrate import COLUMNS, calibrate_folder
from .commands.compare import COMPARISON_FILE, comparison_rows, measure, write_comparison
from .commands.evaluate import EVALUATION_FILE, as_text, score_result, write_score
from .commands.reconstruct import Run
from .commands.simulate import simulate as simulate_trial
from .io.boards.port import ask, usb_ports
from .io.boards.recorder import check_trial_path
from .io.calibration_output import CalibrationPaths
from .io.comparison_tables import as_markdown
from .io.model_file import read_sensor_model
from .io.recording_files import read_rig
from .io.result import RUN_FILE, check_result_path
from .io.toml import read_settings
from .io.trial_directory import Trial, open_trial
from .live.feeds import Feed, Rig, boards_feed, replay_feed, twin_feed
from .live.panel import BesideTheRig, Panel, ports_table, shown
from .live.session import Activity, LiveResult, Session, stopped_by_signals
from .models.calibration.recipe import TrainingSettings
from .models.sensor.sensor_model import SensorModel
from .models.settings import Settings
from .models.structure.reconstruction import Reconstruction
from .models.trial_description import LinkTable
from .models.values.errors import RecordingError, TensegraphError
from .models.values.link import LinkState
from .models.values.readings import BoardReading, TendonLengths
from .pipeline import Method, Pipeline, write_result

app = typer.Typer(
    help="Shape of a tensegrity, with uncertainty, from its strain-sensing tendons.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
console = Console()

MODEL = Annotated[Path | None, typer.Option(help="Sensor model that `calibrate` wrote. [default: the one that ships]")]


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
    model: MODEL = None,
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
    model: MODEL = None,
) -> None:
    r"""Compare all methods on the same lengths: the paper's Table I, measured here.

    \b
    tensegraph compare examples/press_01
    """
    _distinct_names(trials)
    check_result_path(out, COMPARISON_FILE)
    settings, sensor_model = read_settings(config), read_sensor_model(model)
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
            for one in measure(trial, settings, sensor_model, track):
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


PORTS = Annotated[
    list[str] | None, typer.Option("--port", help="Serial port; may be repeated. [default: the rig's, or all]")
]
SECONDS = Annotated[float, typer.Option(min=0, help="End by itself after so long. [default: at Ctrl-C]")]


@app.command()
def ports(
    ports: Annotated[list[str] | None, typer.Argument(help="Ports to ask. [default: all USB serial ports]")] = None,
    baud: Annotated[int, typer.Option(help="Of the boards' firmware.")] = LinkTable().baud,
    seconds: Annotated[float, typer.Option(help="To listen at most; a Mega takes two to start.")] = 4.0,
) -> None:
    """List serial ports, and the boards that answer on them."""
    found = usb_ports()
    asked = {port: found.get(port, "") for port in ports} if ports else found
    if not asked:
        raise TensegraphError("no USB serial port: is a board plugged in?")
    with ThreadPoolExecutor(len(asked)) as pool:  # each waits for its own board
        answers = list(pool.map(lambda port: ask(port, asked[port], baud, seconds), asked))
    console.print(ports_table(answers))


@app.command()
def record(
    rig: Annotated[Path, typer.Option(help="Description of structure, sensors and boards, as examples/rig.toml.")],
    out: Annotated[Path, typer.Option(help="Trial directory to write; must not exist.")],
    model: MODEL = None,
    port: PORTS = None,
    seconds: SECONDS = math.inf,
) -> None:
    r"""Record the boards into a trial directory; Ctrl-C ends it.

    \b
    tensegraph record --rig examples/rig.toml --out trials/first
    """
    check_trial_path(out)
    setup, settings = Rig.read(rig), Settings()
    boards, activity = setup.description.boards(settings.clock), Activity(len(setup.table.board))
    with boards_feed(setup, port or [], out, settings, read_sensor_model(model), BesideTheRig(console)) as feed:
        screen = Panel(f"recording {out}, Ctrl-C ends it", activity, lambda: boards.counts, feed.state)
        with stopped_by_signals(feed.source), shown(screen, console):
            for row in feed.rows:
                assert isinstance(row, BoardReading)
                activity.count(row, feed.source.late_s())
                boards.reading(row)  # for the clocks' counts
                if row.host_s > seconds or feed.state().recording_error:
                    feed.source.stop()
    _end_recording(out, feed.state())


@app.command()
def live(
    rig: Annotated[Path | None, typer.Option(help="As for record: the shape from the boards.")] = None,
    replay: Annotated[Path | None, typer.Option(help="Instead: the shape from a recorded trial.")] = None,
    twin: Annotated[Path | None, typer.Option(help="Or: from the simulation of a plan, at its pace ...")] = None,
    speed: Annotated[float, typer.Option(min=1e-3, help="... or so many times faster.")] = 1.0,
    record: Annotated[Path | None, typer.Option(help="Trial directory to record into; must not exist.")] = None,
    out: Annotated[Path | None, typer.Option(help="Result directory. [default: results/NAME]")] = None,
    config: Annotated[Path | None, typer.Option(help="Settings that differ from the defaults, as TOML.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the shape in a window.")] = False,
    model: MODEL = None,
    port: PORTS = None,
    seconds: SECONDS = math.inf,
) -> None:
    r"""Show the shape while it moves, and keep it: from the boards or from a trial; Ctrl-C ends it.

    \b
    tensegraph live --rig examples/rig.toml --record trials/first
    tensegraph live --replay examples/press_01 --speed 4
    tensegraph live --twin examples/plans/press.toml
    """
    if sum(given is not None for given in (rig, replay, twin)) != 1:
        raise TensegraphError("expected one of --rig, --replay and --twin")
    if (rig is not None and speed != 1) or (rig is None and port):
        raise TensegraphError("--speed goes with --replay and --twin, --port with --rig")
    settings, sensor_model = read_settings(config), read_sensor_model(model)
    named = record or replay or (twin and twin.with_suffix(""))
    path = out or Path("results") / (named.resolve().name if named else "live")
    check_result_path(path)
    if record is not None:
        check_trial_path(record)
    with ExitStack() as stack:
        if rig is not None:
            people = BesideTheRig(console)
            feed = stack.enter_context(boards_feed(Rig.read(rig), port or [], record, settings, sensor_model, people))
        elif replay is not None:
            feed = stack.enter_context(replay_feed(replay, speed, record))
        else:
            assert twin is not None
            feed = stack.enter_context(twin_feed(twin, speed, record))
        session = Session(feed, Pipeline(feed.description, settings, sensor_model), seconds)
        _show_session(session, feed, path, view)
    console.print(f"written to {path}", highlight=False)
    if record is not None:
        _end_recording(record, feed.state())


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


def _show_session(session: Session, feed: Feed, path: Path, view: bool) -> None:
    """Run a session to its end, on the screen and into a result directory."""
    pipeline = session.pipeline
    structure, probability = pipeline.trial.structure, pipeline.settings.probability
    clocks = pipeline.boards.counts if pipeline.boards else []
    screen = Panel(f"live, from {feed.origin}; Ctrl-C ends it", session.activity, lambda: clocks, feed.state)
    with LiveResult(path, structure, pipeline.settings) as result:
        with ExitStack() as stack:
            window = None
            if view:
                from .io.figures.live_view import LiveView  # pyplot takes a second to import

                window = stack.enter_context(LiveView(structure, pipeline.rest.node_position_m, probability))
            stack.enter_context(stopped_by_signals(feed.source))
            stack.enter_context(shown(screen, console))
            for shape in session.shapes():
                result.add(shape)
                if window is not None:
                    window.show(shape)
        result.finish(f"{feed.name}, live", session.as_table(path))


def _end_recording(path: Path, state: LinkState) -> None:
    if state.recording_error:
        raise RecordingError(state.recording_error)
    console.print(f"{state.recorded_rows} rows recorded in {path}", highlight=False)


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
