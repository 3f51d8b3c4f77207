"""How much the estimate bears: dead sensors, and wrong mechanics. `robustness.py [TRIAL...]`, for trials with truth.

Writes a figure of error and sigma against the number of dead sensors (live), and prints a table of the error when the
estimator is given other stiffnesses, natural lengths, push-backs and rod masses. Without trials, those of the
benchmark page: press_01, and the twin's squeeze and slack.
"""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tensegraph import BoardReading, Reconstruction, Settings, open_trial, simulate
from tensegraph.io.figures.style import BLUE, GREY, ORANGE, add_grid, add_legend_below, save_figure
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.trial_directory import Trial
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.trial_description import TrialDescription
from tensegraph.pipeline import Pipeline

EXAMPLES = Path(__file__).parents[1] / "examples"
MOST_DEAD = 6
Method = Literal["live", "batch"]


def estimated(trial: Trial, description: TrialDescription, method: Method, dead: Sequence[int] = ()) -> Reconstruction:
    """Return a trial's shapes when it is described so, and some sensors break once it no longer rests."""
    pipeline = Pipeline(description, Settings(), read_sensor_model())
    readings = open_circuit(trial, dead) if len(dead) else open_trial(trial.path).readings()
    return Reconstruction.of(description.structure, pipeline.estimate(readings, method))


def open_circuit(trial: Trial, dead: Sequence[int]) -> Iterator[BoardReading]:
    """Yield a trial's rows; after its rest, the channels of dead sensors read what the ADC reads of a broken wire."""
    description = trial.description
    broken = 2**description.divider.bits - 1 if description.divider.sensor_side == "ground" else 0
    begin_s = None
    for row in open_trial(trial.path).readings():
        begin_s = row.host_s if begin_s is None else begin_s
        if row.host_s - begin_s > description.rest_seconds:
            is_dead = np.isin(description.tendons_of_board[row.board], dead)
            row = replace(row, counts=np.where(is_dead, broken, row.counts))
        yield row


def dead_sensors(trial: Trial, draws: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return (draws, dead) node RMSE and median sigma [mm] with 0, 1, 2 ... sensors dead, each one more than before."""
    rng = np.random.default_rng(seed)
    structure = trial.description.structure

    def measured_mm(dead: Sequence[int]) -> tuple[float, float]:
        shapes = estimated(trial, trial.description, "live", dead)
        sigma_m = np.median(shapes.node_sigma_m[:, structure.free_nodes])
        return 1e3 * rmse_m(trial, shapes), 1e3 * float(sigma_m)

    whole = measured_mm([])
    result = []
    for _ in range(draws):
        order = rng.permutation(structure.free_tendons)[:MOST_DEAD].tolist()
        result.append([whole, *(measured_mm(order[: count + 1]) for count in range(MOST_DEAD))])
    rmse_mm, sigma_mm = np.moveaxis(np.array(result), -1, 0)
    return rmse_mm, sigma_mm


def rmse_m(trial: Trial, shapes: Reconstruction) -> float:
    """Return the node RMSE [m] of a trial's shapes."""
    truth = trial.truth()
    return node_rmse_m(shapes, truth.t_s, truth.node_position_m)


def held_rmse_mm(trial: Trial) -> float:
    """Return the node RMSE [mm] of the rest shape, held."""
    rest_m = Pipeline(trial.description, Settings(), read_sensor_model()).rest.node_position_m
    error_m = (rest_m - trial.truth().node_position_m)[:, trial.description.structure.free_nodes]
    return 1e3 * float(np.sqrt(np.mean(np.sum(error_m**2, axis=-1))))


def draw_dead_sensors(results: dict[str, tuple[np.ndarray, np.ndarray, float]], path: Path) -> None:
    """Draw one panel a trial: every draw as a thin line, their median as a thick one."""
    figure = Figure(figsize=(4.2 * len(results), 4.4), layout="constrained")
    axes = figure.subplots(1, len(results), squeeze=False)[0]
    count = np.arange(MOST_DEAD + 1)
    for axis, (name, (rmse_mm, sigma_mm, held_mm)) in zip(axes, results.items(), strict=True):
        for values, color, style in ((rmse_mm, BLUE, "-"), (sigma_mm, ORANGE, "--")):
            axis.plot(count, values.T, color=color, lw=0.6, alpha=0.5, ls=style)
            axis.plot(count, np.median(values, axis=0), color=color, lw=2, ls=style, marker="o", ms=4)
        axis.axhline(held_mm, color=GREY, lw=1, ls=":")
        axis.set(
            xlabel="dead sensors",
            xticks=count,
            ylim=(0, 1.08 * max(held_mm, rmse_mm.max(), sigma_mm.max())),
            ylabel="node RMSE and sigma [mm]",
        )
        axis.set_title(name, fontsize=10)
        add_grid(axis)
    draws = len(rmse_mm)
    figure.suptitle(f"live estimate with dead sensors: median of {draws} random draws, and each (own scales)")
    handles = [
        Line2D([], [], color=BLUE, lw=2, marker="o", ms=4, label="node RMSE"),
        Line2D([], [], color=ORANGE, lw=2, ls="--", marker="o", ms=4, label="median sigma of a node"),
        Line2D([], [], color=GREY, lw=1, ls=":", label="node RMSE of the rest shape, held"),
    ]
    add_legend_below(figure, handles, 3)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path)


def with_stiffness(share: float) -> Callable[[TrialDescription], TrialDescription]:
    """Return what multiplies the stiffness of all tendons."""

    def change(d: TrialDescription) -> TrialDescription:
        k = share * d.mechanics.stiffness_n_per_m
        return replace(d, mechanics=replace(d.mechanics, stiffness_n_per_m=k))

    return change


def with_natural_length(share: float) -> Callable[[TrialDescription], TrialDescription]:
    """Return what multiplies all natural lengths, for sensors and forces alike, as trial.toml would."""

    def change(d: TrialDescription) -> TrialDescription:
        natural_m = share * d.structure.natural_length_m
        return replace(
            d,
            structure=replace(d.structure, natural_length_m=natural_m),
            mechanics=replace(d.mechanics, natural_length_m=natural_m),
        )

    return change


def with_push_back(share: float) -> Callable[[TrialDescription], TrialDescription]:
    """Return what multiplies the stiffness of bent tendons."""
    return lambda d: replace(d, mechanics=replace(d.mechanics, push_back=share * d.mechanics.push_back))


WRONG: dict[str, Callable[[TrialDescription], TrialDescription]] = {
    "as in trial.toml": lambda d: d,
    "stiffness x 0.7": with_stiffness(0.7),
    "stiffness x 1.3": with_stiffness(1.3),
    "natural lengths - 1 %": with_natural_length(0.99),
    "natural lengths + 1 %": with_natural_length(1.01),
    "push-back x 5": with_push_back(5.0),
    "no push-back": with_push_back(0.0),
    "rods without mass": lambda d: replace(d, mechanics=replace(d.mechanics, rod_mass_kg=0.0)),
    "no mechanics at all": lambda d: replace(d, mechanics=None),
}


def wrong_mechanics(trials: Sequence[Trial], methods: Sequence[Method]) -> Iterator[str]:
    """Yield the rows of a Markdown table of node RMSE [mm]."""
    columns = [(trial, method) for trial in trials for method in methods]
    names = [f"{trial.name}, {method}" for trial, method in columns]
    yield f"| mechanics given to the estimator | {' | '.join(names)} |"
    yield "|---|" + "---|" * len(columns)
    for name, change in WRONG.items():
        errors_m = [rmse_m(t, estimated(t, change(t.description), method)) for t, method in columns]
        yield f"| {name} | " + " | ".join(f"{1e3 * value:.2f}" for value in errors_m) + " |"


def dead_sensors_figure(trials: Sequence[Trial], draws: int, path: Path) -> Iterator[str]:
    """Draw the figure, and yield a line of its medians for each trial."""
    results = {}
    for trial in trials:
        rmse_mm, sigma_mm = dead_sensors(trial, draws)
        results[trial.name] = rmse_mm, sigma_mm, held_rmse_mm(trial)
        medians = zip(np.median(rmse_mm, axis=0), np.median(sigma_mm, axis=0), strict=True)
        numbers = ", ".join(f"{rmse:.2f} / {sigma:.2f}" for rmse, sigma in medians)
        yield f"{trial.name}, RMSE / sigma [mm] with 0, 1, 2 ... dead: {numbers}"
    draw_dead_sensors(results, path)


def default_trials(folder: Path) -> list[Trial]:
    """Return press_01, and the twin's squeeze and slack, simulated into a folder."""
    plans = [EXAMPLES / "plans" / f"{name}.toml" for name in ("squeeze", "slack")]
    return [open_trial(EXAMPLES / "press_01"), *(simulate(plan, folder / plan.stem) for plan in plans)]


def main(
    trials: Annotated[list[Path] | None, typer.Argument(help="With counts, [mechanics] and truth.")] = None,
    figure: Annotated[Path, typer.Option(help="Where it goes.")] = Path("dead_sensors.png"),
    draws: Annotated[int, typer.Option(min=0, help="Random orders in which sensors die; 0: no figure.")] = 4,
    batch: Annotated[bool, typer.Option("--batch", help="The table for batch too: minutes a number.")] = False,
) -> None:
    """Write the figure and print the table."""
    with tempfile.TemporaryDirectory() as folder:
        opened = [open_trial(path) for path in trials] if trials else default_trials(Path(folder))
        if draws:
            for line in dead_sensors_figure(opened, draws, figure):
                print(line, flush=True)
        for row in wrong_mechanics(opened, ["live", "batch"] if batch else ["live"]):
            print(row, flush=True)


if __name__ == "__main__":
    typer.run(main)
