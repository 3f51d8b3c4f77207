"""The command line: `tensegraph --help`. What a command does is in `commands/`, imported when it is chosen."""

import math
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from .models.values.errors import TensegraphError

if TYPE_CHECKING:
    from .commands.terminal import Terminal

app = typer.Typer(
    help="Shape of a tensegrity, with uncertainty, from its strain-sensing tendons.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Config = Annotated[
    Path | None, typer.Option(help="Settings that differ from the defaults, as TOML.", show_default=False)
]
Model = Annotated[
    Path | None, typer.Option(help="Sensor model that `calibrate` wrote.", show_default="the one that ships")
]
Ports = Annotated[
    list[str] | None,
    typer.Option("--port", help="Serial port; may be repeated.", show_default="the rig's, or all"),
]
Seconds = Annotated[float, typer.Option(min=0, help="End by itself after so many seconds.", show_default="at Ctrl-C")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show results' paths and errors only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show how long each stage takes, on stderr.")]


def main() -> None:
    """Run the command line; what is wrong with the input or the disk is one line on stderr and exit code 2."""
    try:
        app()
    except TensegraphError as error:
        _end(str(error))
    except OSError as error:
        _end(f"{error.filename}: {error.strerror}" if error.filename else str(error))


def _end(message: str) -> None:
    print(f"tensegraph: {message}", file=sys.stderr)
    sys.exit(2)


def _examples(*commands: str) -> str:
    """Return the end of a help page: one command a line, which typer wants a paragraph each."""
    return "\n\n".join(["Examples:", *commands])


def _terminal(quiet: bool, verbose: bool) -> "Terminal":
    from .commands.terminal import Terminal

    return Terminal(quiet=quiet, verbose=verbose)


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
        "tensegraph reconstruct examples/press_01 --live --out results/live",
        "tensegraph reconstruct examples/press_01 --method ukf --out results/ukf",
    )
)
def reconstruct(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories, each with a trial.toml.")],
    method: Annotated[
        Literal["graph", "frame", "least-squares", "ukf"],
        typer.Option(
            help="The factor graph over all frames, the same of each frame alone, the paper's least squares, "
            "or an unscented Kalman filter."
        ),
    ] = "graph",
    live: Annotated[
        bool, typer.Option("--live", help="Use the past only, frame by frame, as the other methods do anyway.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Result directory; of several trials the one that holds theirs.", show_default="results/TRIAL"
        ),
    ] = None,
    config: Config = None,
    model: Model = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures too.")] = True,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Reconstruct recorded trials: shapes with ellipsoids, lengths, status, figures."""
    from .commands.reconstruct import reconstruct_trials

    reconstruct_trials(
        trials,
        method if method != "graph" else "live" if live else "batch",
        out=out,
        config=config,
        model=model,
        figures=figures,
        terminal=_terminal(quiet, verbose),
    )


@app.command(
    epilog=_examples(
        "tensegraph evaluate results/press_01",
        "tensegraph evaluate results/press_01 --truth mocap.csv --align",
    )
)
def evaluate(
    results: Annotated[list[Path], typer.Argument(help="Result directories, as reconstruct writes them.")],
    truth: Annotated[
        Path | None,
        typer.Option(help="Stamped node positions (t_s, n0_x_m ...).", show_default="the trial's own"),
    ] = None,
    trial: Annotated[Path | None, typer.Option(help="Trial directory.", show_default="where the result says")] = None,
    align: Annotated[bool, typer.Option("--align", help="Turn and shift the truth so that it fits best.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON in place of tables.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Where to; of several results, what holds theirs.", show_default="results/evaluation/RESULT"),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Evaluate results against the truth: errors, honesty of the ellipsoids, faults seen, with figures."""
    from .commands.evaluate import evaluate_results

    evaluate_results(
        results,
        truth=truth,
        trial=trial,
        align=align,
        json_only=json,
        out=out,
        terminal=_terminal(quiet, verbose),
    )


@app.command(epilog=_examples("tensegraph compare examples/press_01"))
def compare(
    trials: Annotated[list[Path], typer.Argument(help="Trial directories, with truth.")],
    out: Annotated[Path, typer.Option(help="Where the table and the figure go.")] = Path("results/comparison"),
    config: Config = None,
    model: Model = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare all methods on the same lengths: the paper's Table I, measured here."""
    from .commands.compare import compare_trials

    compare_trials(trials, out=out, config=config, model=model, terminal=_terminal(quiet, verbose))


@app.command(
    epilog=_examples(
        "tensegraph calibrate examples/calibration --out rubber.safetensors",
        "tensegraph reconstruct examples/press_01 --model rubber.safetensors",
    )
)
def calibrate(
    folder: Annotated[Path, typer.Argument(help="Folder of calibration recordings (*.csv).")],
    out: Annotated[Path, typer.Option(help="Model file to write (*.safetensors); card and figures go beside it.")],
    rig: Annotated[
        Path | None, typer.Option(help="Which columns are what, in which units, as TOML.", show_default=False)
    ] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="Recordings to test with, by name (*_0.05_*); may be repeated.")
    ] = None,
    hold_out_tail: Annotated[
        float | None, typer.Option(help="Test with this last share of each recording.", min=0.05, max=0.9)
    ] = None,
    unified: Annotated[bool, typer.Option("--unified", help="One signed network for bending and stretching.")] = False,
    sweep: Annotated[bool, typer.Option("--sweep", help="Try learning rates first, and draw the losses.")] = False,
    epochs: Annotated[int, typer.Option(help="Most epochs of the training.", min=1)] = 200,
    learning_rate: Annotated[float, typer.Option(help="Peak of the schedule.")] = 0.01,
    seed: Annotated[int, typer.Option(help="Of the training's random numbers.")] = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate the sensors from recordings of strips: model file, model card, figures."""
    from .commands.calibrate import HoldOut, calibrate_folder
    from .models.calibration.recipe import TrainingSettings

    calibrate_folder(
        folder,
        out,
        rig=rig,
        hold_out=HoldOut(tuple(hold_out or ()), hold_out_tail),
        settings=TrainingSettings(epochs=epochs, learning_rate=learning_rate, unified=unified, seed=seed),
        sweep=sweep,
        terminal=_terminal(quiet, verbose),
    )


@app.command()
def ports(
    ports: Annotated[
        list[str] | None, typer.Argument(help="Ports to ask.", show_default="all USB serial ports")
    ] = None,
    baud: Annotated[int, typer.Option(help="Of the boards' firmware.")] = 500_000,
    seconds: Annotated[float, typer.Option(help="To listen at most; a Mega takes two to start.")] = 4.0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """List serial ports, and the boards that answer on them."""
    from .commands.ports import list_ports

    list_ports(ports or [], baud, seconds, _terminal(quiet, verbose))


@app.command(epilog=_examples("tensegraph record --rig examples/rig.toml --out trials/first"))
def record(
    rig: Annotated[Path, typer.Option(help="Description of structure, sensors and boards, as examples/rig.toml.")],
    out: Annotated[Path, typer.Option(help="Trial directory to write; must not exist.")],
    model: Model = None,
    port: Ports = None,
    seconds: Seconds = math.inf,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Record the boards into a trial directory; Ctrl-C ends it."""
    from .commands.record import record_boards

    terminal = _terminal(quiet, verbose)
    record_boards(rig, out, model=model, ports=port or [], seconds=seconds, terminal=terminal)


@app.command(
    epilog=_examples(
        "tensegraph live --rig examples/rig.toml --record trials/first",
        "tensegraph live --replay examples/press_01 --speed 4",
        "tensegraph live --twin examples/plans/press.toml",
    )
)
def live(
    rig: Annotated[Path | None, typer.Option(help="As for record: the shape from the boards.")] = None,
    replay: Annotated[Path | None, typer.Option(help="Instead: the shape from a recorded trial.")] = None,
    twin: Annotated[Path | None, typer.Option(help="Or: from the simulation of a plan, at its pace ...")] = None,
    speed: Annotated[float, typer.Option(min=1e-3, help="... or so many times faster.")] = 1.0,
    record: Annotated[Path | None, typer.Option(help="Trial directory to record into; must not exist.")] = None,
    out: Annotated[Path | None, typer.Option(help="Result directory.", show_default="results/NAME")] = None,
    config: Config = None,
    view: Annotated[bool, typer.Option("--view", help="Show the shape in a window.")] = False,
    model: Model = None,
    port: Ports = None,
    seconds: Seconds = math.inf,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Show the shape while it moves, and keep it: from the boards or from a trial; Ctrl-C ends it."""
    from .commands.live import LiveSource, show_live

    source = LiveSource(rig=rig, replay=replay, twin=twin, speed=speed, ports=tuple(port or ()), record=record)
    terminal = _terminal(quiet, verbose)
    show_live(source, out=out, config=config, model=model, view=view, seconds=seconds, terminal=terminal)


@app.command(epilog=_examples("tensegraph simulate examples/plans/press.toml --out trials/press"))
def simulate(
    plan: Annotated[Path, typer.Argument(help="Plan (*.toml), such as those in examples/plans.")],
    out: Annotated[Path, typer.Option(help="Trial directory to write.")],
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the plan's own.")] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate a structure, its sensors and its boards: a trial with its truth."""
    from .commands.simulate import simulate_trial

    simulate_trial(plan, out, seed, _terminal(quiet, verbose))
