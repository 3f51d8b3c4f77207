"""The command line, see `tensegraph --help`. The work of a command is in `commands/`, imported when it is chosen."""

import logging
import math
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.metadata import version
from io import TextIOWrapper
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from .models.plug_ins import PlugInWarning
from .models.values.errors import InputError, TensegraphError, one_line

if TYPE_CHECKING:
    from .commands.many import Workers
    from .io.reports.terminal import Terminal

UsageError: Any = typer.BadParameter.__base__
"""What typer raises at options and arguments that it does not know, and does not export."""


class _Commands(TyperGroup):
    """Commands at whose options a mistake is one line, as one in a file is."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options before a command; without any arguments the help page is shown.

        Raises:
            InputError: for options that there are not.
        """
        with _usage_as_line(ctx) if args else nullcontext():
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was chosen.

        Raises:
            InputError: for options and arguments that it does not take.
        """
        with _usage_as_line(ctx):
            return super().invoke(ctx)


@contextmanager
def _usage_as_line(ctx: Any) -> Iterator[None]:
    """Turn a mistake at the options, of the command that was chosen or before one, into an InputError."""
    try:
        yield
    except UsageError as error:
        command = f"tensegraph {ctx.invoked_subcommand or ''}".rstrip()
        raise InputError(f"{error.format_message().rstrip('.')}: see {command} --help") from error


app = typer.Typer(
    cls=_Commands,
    help="Shape of a tensegrity, with uncertainty, from its strain-sensing tendons.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Config = Annotated[
    Path | None, typer.Option(help="TOML file of the settings that differ from the defaults.", show_default=False)
]
Model = Annotated[
    Path | None,
    typer.Option(
        help="Sensor model: a file written by `calibrate`, or the name of one of another package.",
        show_default="in the package",
    ),
]
Ports = Annotated[
    list[str] | None,
    typer.Option("--port", help="Serial port; may be repeated.", show_default="the rig's, or all"),
]
Seconds = Annotated[float, typer.Option(min=0, help="End after this many seconds.", show_default="at Ctrl-C")]
Jobs = Annotated[int, typer.Option(min=1, help="Number of processes that share several inputs.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Address of a dask scheduler (tcp://...) whose workers do it instead.", show_default=False),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show only errors and the paths of the results.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show how long each stage takes, on stderr.")]


def main() -> None:
    """Run the command line; an error of the input or of the disk is printed as one line on stderr, with exit code 2."""
    _make_usable()
    signal.signal(signal.SIGTERM, _end_in_order)
    try:
        with _warnings_as_lines():
            _check_arguments(sys.argv)
            app()
    except (TensegraphError, OSError) as error:
        with suppress(OSError):  # where stderr is on a full disk
            print(f"tensegraph: {one_line(error)}", file=sys.stderr, flush=True)
        sys.exit(2)


def _make_usable() -> None:
    """Make up for streams and an environment with which libraries fail, or speak of their own matters."""
    for name in ("stdout", "stderr"):  # None where it was closed
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  (it ends with the process)
    if isinstance(sys.stdout, TextIOWrapper):  # a console may lack signs of tables, or of names
        sys.stdout.reconfigure(errors="backslashreplace")
    if os.environ.get("COLUMNS", "").strip("0") == "":  # rich would print nothing
        os.environ.pop("COLUMNS", None)
    if os.environ.get("MPLBACKEND", "").startswith("module://"):  # of a notebook, which may be of another environment
        del os.environ["MPLBACKEND"]
    os.environ["MATPLOTLIBRC"] = os.devnull  # figures are the same for all, and need no TeX as the user's own may
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a home without a place for its cache


def _end_in_order(number: int, _: object) -> None:
    """End at a signal as at an error, so that workers end too and nothing unfinished is left; the shell's exit code."""
    sys.exit(128 + number)


def _check_arguments(words: list[str]) -> None:
    """Check that no argument is empty, and that results, which are in UTF-8, can hold the names of files and folders.

    Args:
        words: the command line, beginning with the program.

    Raises:
        InputError: for an empty argument, as of a shell's variable that is not set, which would be the working
            directory; for a name of another encoding, as of a folder of an old archive, or under a locale of another.
    """
    for before, argument in pairwise(words):
        if not argument:
            raise InputError(f"{before}: expected a value after it, got an empty one")
        try:
            argument.encode()
            if os.path.exists(argument):
                os.path.realpath(argument).encode()
        except UnicodeEncodeError as error:
            raise InputError(f"{argument}: expected a name in UTF-8, under a locale of UTF-8") from error


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Print a warning about a plug-in as one line on stderr; others stay as they are."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", PlugInWarning)
        usual = warnings.formatwarning

        def as_line(
            message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
        ) -> str:
            is_ours = issubclass(category, PlugInWarning)
            return f"tensegraph: {message}\n" if is_ours else usual(message, category, filename, lineno, line)

        warnings.formatwarning = as_line
        try:
            yield
        finally:
            warnings.formatwarning = usual


def _examples(*commands: str) -> str:
    """Return the end of a help page with one command per line; typer needs a paragraph for each."""
    return "\n\n".join(["Examples:", *commands])


def _terminal(quiet: bool, verbose: bool) -> "Terminal":
    from .io.reports.terminal import Terminal

    return Terminal(quiet=quiet, verbose=verbose)


def _workers(jobs: int, scheduler: str | None) -> "Workers":
    from .commands.many import Workers

    return Workers(jobs, scheduler)


def _method(name: str, *, live: bool) -> str:
    """Return the name in the pipeline of a method as the command line names it.

    Raises:
        InputError: when there is none.
    """
    from .pipeline import ESTIMATORS, estimator_plug_ins

    known = [*ESTIMATORS, *estimator_plug_ins()]
    chosen = "batch" if name == "graph" else name
    if chosen not in known:
        raise InputError(f"--method {name}: expected one of {', '.join(known)}")
    if live and chosen not in ("batch", "live"):
        raise InputError(f"--live: is the same as --method live: expected one method, got --method {name}, too")
    return "live" if live else chosen


def _print_version(asked: bool) -> None:
    if asked:
        print(f"tensegraph {version('tensegraph')}")
        raise typer.Exit


@app.callback()
def tensegraph(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Shape of a tensegrity, with uncertainty, from its strain-sensing tendons."""


@app.command(
    epilog=_examples(
        "tensegraph reconstruct examples/press_01",
        "tensegraph reconstruct examples/press_01 --live",
        "tensegraph reconstruct examples/press_01 --method ukf",
        "tensegraph reconstruct trials/* --jobs 4",
    )
)
def reconstruct(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories, each with a trial.toml.")],
    method: Annotated[
        str,
        typer.Option(
            help="batch (factor graph over all frames, also called graph), live (factor graph of the past of each "
            "frame), frame (factor graph of each frame by itself), least-squares (as in the paper), ukf (unscented "
            "Kalman filter), network (a recurrent network alone), or an estimator of another package."
        ),
    ] = "batch",
    live: Annotated[
        bool, typer.Option("--live", help="The same as --method live; only batch uses more than the past.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Result directory; for several trials, the directory in which each gets its own.",
            show_default="results/TRIAL, or results/TRIAL_METHOD of another method than batch",
        ),
    ] = None,
    config: Config = None,
    model: Model = None,
    figures: Annotated[
        Literal["png", "pdf", "none"], typer.Option(help="Format of the figures: pixels, vectors, or no figures.")
    ] = "png",
    from_s: Annotated[
        float | None, typer.Option("--from", help="Leave out shapes before this time, s.", show_default=False)
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", help="Leave out what is after this time, s.", show_default=False)
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Reconstruct recorded trials: shapes with ellipsoids, lengths, status, figures."""
    from .commands.reconstruct import Span, reconstruct_trials

    reconstruct_trials(
        trials,
        _method(method, live=live),
        out=out,
        config=config,
        model=model,
        figures=None if figures == "none" else figures,
        span=Span(from_s, to_s),
        workers=_workers(jobs, scheduler),
        terminal=_terminal(quiet, verbose),
    )


@app.command(
    epilog=_examples(
        "tensegraph evaluate results/press_01",
        "tensegraph evaluate results/press_01 --truth mocap.csv --align",
        "tensegraph evaluate results/press_01 --truth take.c3d",
    )
)
def evaluate(
    results: Annotated[list[Path], typer.Argument(help="Result directories written by reconstruct.")],
    truth: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of true node positions (t_s, n0_x_m ...), or motion capture: Motive or Vicon CSV, C3D, TRC.",
            show_default="that of the trial",
        ),
    ] = None,
    trial: Annotated[Path | None, typer.Option(help="Trial directory.", show_default="that in run.toml")] = None,
    align: Annotated[bool, typer.Option("--align", help="Rotate and translate the truth to fit best.")] = False,
    offset: Annotated[
        float | None,
        typer.Option(
            help="Host time minus time of the truth, s.", show_default="0; of motion capture, found from its motion"
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Evaluation directory; for several results, the directory in which each gets its own.",
            show_default="results/evaluation/RESULT",
        ),
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Evaluate results against the truth: errors, coverage of the ellipsoids, detected faults, with figures."""
    from .commands.evaluate import evaluate_results

    evaluate_results(
        results,
        truth=truth,
        trial=trial,
        align=align,
        offset_s=offset,
        json_only=json,
        out=out,
        workers=_workers(jobs, scheduler),
        terminal=_terminal(quiet, verbose),
    )


@app.command(
    epilog=_examples(
        "tensegraph export results/press_01 --to mat",
        "tensegraph export results/press_01 --out press.nc",
        "tensegraph export results/press_01 --to gltf --at 15",
    )
)
def export(
    result: Annotated[Path, typer.Argument(help="Result directory written by reconstruct or live.")],
    to: Annotated[
        str | None,
        typer.Option(
            help="Format: mat, npz, netcdf, parquet, ply, gltf, ros2, rerun, mp4, gif, or one of another package.",
            show_default="that of the suffix of --out",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write (.mat, .npz, .nc, .parquet, .ply, .glb, .mcap, .rrd, .mp4, .gif).",
            show_default="RESULT and the suffix",
        ),
    ] = None,
    at: Annotated[
        float | None, typer.Option(help="Time of the frame in seconds, for PLY and glTF.", show_default=False)
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write a result for other programs: arrays, tables, a mesh of one frame, a recording for ROS 2, a film."""
    from .commands.export import export_result

    export_result(result, to=to, out=out, at_s=at, terminal=_terminal(quiet, verbose))


@app.command(
    epilog=_examples(
        "tensegraph view results/press_01",
        "tensegraph view results/press_01 results/press_01_live",
    )
)
def view(
    results: Annotated[list[Path], typer.Argument(help="Result directories written by reconstruct or live.")],
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Show results side by side in the viewer Rerun, in a browser of this machine, until Ctrl-C."""
    from .commands.view import view_results

    view_results(results, _terminal(quiet, verbose))


@app.command(epilog=_examples("tensegraph compare examples/press_01", "tensegraph compare trials/* --jobs 4"))
def compare(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories that include the true node positions.")],
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="Method to compare: batch, live, or one of reconstruct but graph; may be repeated.",
            show_default="all",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Directory of the table and the figure.")] = Path("results/comparison"),
    config: Config = None,
    model: Model = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare methods on the same tendon lengths, in the form of the paper's Table I."""
    from .commands.compare import compare_trials

    compare_trials(
        trials,
        methods=method,
        out=out,
        config=config,
        model=model,
        workers=_workers(jobs, scheduler),
        terminal=_terminal(quiet, verbose),
    )


@app.command(
    epilog=_examples(
        "tensegraph calibrate examples/calibration --out rubber.safetensors",
        "tensegraph reconstruct examples/press_01 --model rubber.safetensors",
    )
)
def calibrate(
    folder: Annotated[Path, typer.Argument(help="Folder of calibration recordings (*.csv).")],
    out: Annotated[Path, typer.Option(help="Model file to write (*.safetensors), beside its card and figures.")],
    rig: Annotated[
        Path | None,
        typer.Option(help="TOML file that describes the columns and units of the recordings.", show_default=False),
    ] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="Name pattern of recordings to test with (*_0.05_*); may be repeated.")
    ] = None,
    hold_out_tail: Annotated[
        float | None,
        typer.Option(help="Test with the end of each recording: 0.2 is the last fifth.", min=0.05, max=0.9),
    ] = None,
    unified: Annotated[
        bool, typer.Option("--unified", help="Train one network on signed strain, for bending and stretching.")
    ] = False,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Try several learning rates first, and draw their losses.")
    ] = False,
    epochs: Annotated[int, typer.Option(help="Largest number of training epochs.", min=1)] = 200,
    learning_rate: Annotated[float, typer.Option(help="Largest learning rate of the training.")] = 0.01,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers of the training.")] = 0,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate the sensors from recordings of strips: model file, model card, figures."""
    from .commands.calibrate import calibrate_folder
    from .models.calibration.recipe import TrainingSettings
    from .models.values.tables import parse_table
    from .scoring.sensor_calibration import HoldOut

    options = {"epochs": epochs, "learning_rate": learning_rate, "unified": unified, "seed": seed}
    calibrate_folder(
        folder,
        out,
        rig=rig,
        hold_out=HoldOut(tuple(hold_out or ()), hold_out_tail),
        settings=parse_table(TrainingSettings, options, "calibrate"),
        sweep=sweep,
        workers=_workers(jobs, scheduler),
        terminal=_terminal(quiet, verbose),
    )


@app.command()
def ports(
    ports: Annotated[
        list[str] | None, typer.Argument(help="Ports to ask.", show_default="all USB serial ports")
    ] = None,
    baud: Annotated[int, typer.Option(min=1, help="Baud rate of the firmware on the boards.")] = 500_000,
    seconds: Annotated[float, typer.Option(min=0, help="Longest wait; an Arduino Mega takes 2 s to start.")] = 4.0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """List serial ports, and the boards that answer on them."""
    from .commands.ports import list_ports

    list_ports(ports or [], baud, seconds, _terminal(quiet, verbose))


@app.command(epilog=_examples("tensegraph record --rig examples/rig.toml --out trials/first"))
def record(
    rig: Annotated[
        Path, typer.Option(help="TOML file that describes structure, sensors and boards, like examples/rig.toml.")
    ],
    out: Annotated[Path, typer.Option(help="Trial directory to write; must not exist.")],
    config: Config = None,
    model: Model = None,
    port: Ports = None,
    seconds: Seconds = math.inf,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Record the boards into a trial directory; Ctrl-C ends it."""
    from .commands.record import record_boards

    terminal = _terminal(quiet, verbose)
    record_boards(rig, out, config=config, model=model, ports=port or [], seconds=seconds, terminal=terminal)


@app.command(
    epilog=_examples(
        "tensegraph live --rig examples/rig.toml --record trials/first",
        "tensegraph live --replay examples/press_01 --speed 4",
        "tensegraph live --twin examples/plans/press.toml",
        "tensegraph live --replay examples/press_01 --viewer",
        "tensegraph live --replay examples/press_01 --publish udp://127.0.0.1:9870",
    )
)
def live(
    rig: Annotated[
        Path | None, typer.Option(help="Show the shape from the boards of the rig that this TOML file describes.")
    ] = None,
    replay: Annotated[Path | None, typer.Option(help="Show the shape from a recorded trial.")] = None,
    twin: Annotated[Path | None, typer.Option(help="Show the shape from the simulation of a plan.")] = None,
    speed: Annotated[float, typer.Option(min=1e-3, help="Speed of a replay or a simulation; 1 is real time.")] = 1.0,
    record: Annotated[Path | None, typer.Option(help="Trial directory to record into; must not exist.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Result directory.", show_default="results/NAME_session, or results/TRIAL_replayed"),
    ] = None,
    config: Config = None,
    view: Annotated[bool, typer.Option("--view", help="Show the shape in a window of matplotlib.")] = False,
    viewer: Annotated[
        bool, typer.Option("--viewer", help="Show the shape in the viewer Rerun, in a browser of this machine.")
    ] = False,
    publish: Annotated[
        list[str] | None,
        typer.Option(
            help="Send each shape to other programs: udp://127.0.0.1:9870 as a line of JSON, ros2 as messages of "
            "ROS 2; may be repeated.",
            show_default=False,
        ),
    ] = None,
    publish_remote: Annotated[
        bool, typer.Option("--publish-remote", help="Allow addresses of other machines in --publish.")
    ] = False,
    model: Model = None,
    port: Ports = None,
    seconds: Seconds = math.inf,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Show and write the shape while it moves, from boards, a trial or a simulation, until Ctrl-C."""
    from .commands.live import LiveOutputs, LiveSource, show_live

    source = LiveSource(
        rig=rig, replay=replay, twin=twin, speed=speed, ports=tuple(port or ()), record=record, seconds=seconds
    )
    outputs = LiveOutputs(view, viewer, tuple(publish or ()), publish_remote)
    terminal = _terminal(quiet, verbose)
    show_live(source, out=out, config=config, model=model, outputs=outputs, terminal=terminal)


@app.command(
    epilog=_examples(
        "tensegraph structure robot.xml",
        "tensegraph structure robot.yaml --unit 0.1 --out robot.toml --out robot.png",
        "tensegraph structure --new six-strut --rod 0.3 --out trials/first",
    )
)
def structure(
    file: Annotated[
        Path | None,
        typer.Argument(help="Structure file: .toml of our own, MuJoCo .xml, .yaml.", show_default=False),
    ] = None,
    out: Annotated[
        list[Path] | None,
        typer.Option(help="File to write (.toml, .xml, .png, .pdf, .svg), may be repeated; with --new, a directory."),
    ] = None,
    unit: Annotated[float, typer.Option(help="Unit of the lengths in a .yaml file, m.")] = 1.0,
    new: Annotated[
        Literal["prism", "six-strut", "tower", "saddle-tower"] | None,
        typer.Option(help="Write a start of trial.toml and rig.toml for this structure.", show_default=False),
    ] = None,
    rod: Annotated[float | None, typer.Option(help="With --new, length of each rod, m.", show_default=False)] = None,
    stages: Annotated[
        int | None, typer.Option(min=1, help="With --new tower, number of prisms: two by default.", show_default=False)
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Show, check and convert a structure: what holds what, self-stress, mechanisms; or start a new one."""
    from .commands.structures import check_choice, show_structure, start_structure
    from .io.structures.new_trial import BuiltIn

    check_choice(file, unit, new, rod, stages, out or [])
    terminal = _terminal(quiet, verbose)
    if file is not None:
        show_structure(file, unit_m=unit, out=out or [], terminal=terminal)
    elif new is not None and rod is not None:
        start_structure(BuiltIn(new, rod, stages), out=out[0] if out else Path(new), terminal=terminal)


@app.command(
    epilog=_examples(
        "tensegraph simulate examples/plans/press.toml --out trials/press",
        "tensegraph simulate examples/plans/causes/*.toml --out trials --jobs 4",
    )
)
def simulate(
    plans: Annotated[list[Path], typer.Argument(help="Plans (*.toml), such as those in examples/plans.")],
    out: Annotated[
        Path,
        typer.Option(help="Trial directory to write; for several plans, the directory in which each gets its own."),
    ],
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the random numbers.", show_default="the plan's")
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate structures, their sensors and their boards, and write trials that include the truth."""
    from .commands.simulate import simulate_plans

    terminal = _terminal(quiet, verbose)
    simulate_plans(plans, out, seed=seed, workers=_workers(jobs, scheduler), terminal=terminal)
