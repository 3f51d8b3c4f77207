"""How the estimate suffers from each cause of error: `benchmarks/causes.py --seeds 5 --jobs 2`.

Every plan of examples/plans/causes is simulated with some seeds and reconstructed. So is its pair, the plan that it
extends, with the same seeds and without the cause. The table is in Markdown and has one row for each plan and method,
over all seeds:

    RMSE            of the free nodes (3-D); over the seeds, the root of the mean of the squares
    pair            RMSE of the plan without the cause
    of held         RMSE over that of the rest shape, held; above 1, holding the rest shape would be better
    in 50, 68, 95 % share of (frame, free node) for which the ellipsoid of that probability contains the truth
    sigma           root of the trace of the covariance: its median over the free nodes, then over the seeds
    left out        share of the sensors without a fault that were left out for more than a second without a break
    doubt           share of the frames in which the model doubts itself, for whatever reason

Frames before the end of the rest count like all others.
"""

import os
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from numpy.typing import NDArray

from tensegraph import Reconstruction, Settings, simulate
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.plan_file import plan_files
from tensegraph.models.evaluation.evaluation import Evaluation
from tensegraph.models.evaluation.metrics import errors_of, evaluate
from tensegraph.models.evaluation.statistics import root_mean_square
from tensegraph.models.evaluation.truth import Fault, Truth
from tensegraph.pipeline import Pipeline

PLANS = Path(__file__).parents[1] / "examples" / "plans" / "causes"
HEALTHY = "healthy"
"""The plan without a cause, which is the first row of the table."""
LONG_S = 1.0
"""A sensor that was left out for longer than this counts as left out; a single misfit may be shorter."""
Method = Literal["live", "batch"]
METHODS: tuple[Method, ...] = ("live", "batch")


@dataclass(frozen=True, slots=True)
class Score:
    """How one method does on one plan with one seed."""

    plan: str
    seed: int
    method: Method
    rmse_m: float
    """Of the free nodes, as estimated."""
    held_m: float
    """RMSE of the free nodes when the rest shape is held."""
    coverage_50: float
    coverage_68: float
    coverage_95: float
    median_sigma_m: float
    left_out_share: float
    """Share of the sensors that never failed."""
    doubt_share: float
    """Share of the frames in doubt."""


def scores(plan: Path, seed: int, methods: Sequence[Method]) -> list[Score]:
    """Simulate one plan with one seed; return one score for each method."""
    with tempfile.TemporaryDirectory() as folder:
        trial = simulate(plan, Path(folder) / plan.stem, seed)
        pipeline = Pipeline(trial.description, Settings(), read_sensor_model())
        frames = list(pipeline.lengths(trial.readings()))
        known = trial.truth()
        assert known is not None, "the twin writes its truth"
        truth = trial.truth_of(known, trial.true_loads())
    rest_m = pipeline.rest.node_position_m
    made = []
    for method in methods:
        shapes = Reconstruction.of(trial.description.structure, pipeline.shapes(frames, method))
        made.append(score_of(plan, seed, method, shapes, rest_m, truth))
    return made


def score_of(
    plan: Path, seed: int, method: Method, shapes: Reconstruction, rest_m: NDArray[np.float64], truth: Truth
) -> Score:
    """Return how far the shapes of one method are from the truth."""
    evaluation = evaluate(rest_m, shapes, truth)
    consistency = evaluation.consistency
    return Score(
        plan=plan.stem,
        seed=seed,
        method=method,
        rmse_m=evaluation.absolute.nodes.rmse_m,
        held_m=held_rmse_m(evaluation, rest_m),
        coverage_50=consistency.coverage_50,
        coverage_68=consistency.coverage_68,
        coverage_95=consistency.coverage_95,
        median_sigma_m=consistency.median_sigma_m,
        left_out_share=left_out_share(shapes, truth.faults),
        doubt_share=float(np.mean([doubt is not None for doubt in shapes.doubts])),
    )


def held_rmse_m(evaluation: Evaluation, rest_m: NDArray[np.float64]) -> float:
    """Return the RMSE of the free nodes when the rest shape is held, over the frames that were compared."""
    error_m = (rest_m - evaluation.compared.true_m)[:, evaluation.structure.free_nodes]
    return errors_of(error_m.reshape(-1, 3)).rmse_m


def left_out_share(shapes: Reconstruction, faults: Iterable[Fault]) -> float:
    """Return the share of the sensors without a fault that were left out for more than `LONG_S` without a break.

    A board that is unplugged is no fault of its sensors. While it is unplugged, its sensors do not count as left out.
    """
    left_out = ~np.isfinite(shapes.sigma_m)
    healthy = np.ones(left_out.shape[1], dtype=np.bool_)
    for fault in faults:
        if fault.where.startswith("board"):
            left_out[np.ix_(fault.during(shapes.t_s), fault.tendons)] = False
        else:
            healthy[fault.tendons] = False
    return float(np.mean([_longest_s(shapes.t_s, column) > LONG_S for column in left_out.T[healthy]]))


def _longest_s(t_s: NDArray[np.float64], holds: NDArray[np.bool_]) -> float:
    """Return the longest time for which something holds without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]])))
    return max((float(t_s[end - 1] - t_s[begin]) for begin, end in edges.reshape(-1, 2)), default=0.0)


def row(scores: Sequence[Score], pair: Sequence[Score]) -> str:
    """Return one row of the table.

    Args:
        scores: those of one plan and method, with all seeds.
        pair: the scores of the plan without the cause; empty if there are none.
    """
    rmse_m = root_mean_square(np.array([score.rmse_m for score in scores]))
    held_m = root_mean_square(np.array([score.held_m for score in scores]))
    pair_mm = f"{1e3 * root_mean_square(np.array([score.rmse_m for score in pair])):.2f}" if pair else "-"
    sigma_mm = 1e3 * float(np.median([score.median_sigma_m for score in scores]))
    shares = [
        f"{np.mean([getattr(score, name) for score in scores]):.1%}"
        for name in ("coverage_50", "coverage_68", "coverage_95", "left_out_share", "doubt_share")
    ]
    cells = [scores[0].plan, scores[0].method, f"{1e3 * rmse_m:.2f}", pair_mm, f"{rmse_m / held_m:.2f}"]
    return "| " + " | ".join([*cells, *shares[:3], f"{sigma_mm:.2f}", *shares[3:]]) + " |"


def table(done: Sequence[Score], bases: dict[str, str], command: str) -> str:
    """Return the Markdown table.

    Args:
        done: the scores of all plans, seeds and methods.
        bases: for the name of each plan, that of the plan that it extends.
        command: the command that makes the table.
    """
    lines = [
        f"`{command}`",
        "",
        "| cause | method | RMSE mm | pair mm | of held | in 50 % | in 68 % | in 95 % | sigma mm | left out | doubt |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for plan in bases:
        for method in METHODS:
            scores = [score for score in done if (score.plan, score.method) == (plan, method)]
            pair = [score for score in done if (score.plan, score.method) == (bases[plan], method)]
            lines += [row(scores, pair)] if scores else []
    return "\n".join(lines) + "\n"


def healthy_first(plan: Path) -> tuple[bool, str]:
    """Return a key that sorts plans by name, after the one without a cause."""
    return plan.stem != HEALTHY, plan.stem


def scores_of(tasks: Iterable[tuple[Path, int]], methods: Sequence[Method], jobs: int) -> list[Score]:
    """Return the scores of plans with seeds, some of them at a time; say each on the terminal."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # for the new processes, each of which has one core
    done: list[Score] = []
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(scores, plan, seed, methods) for plan, seed in tasks]
        for made in (future.result() for future in as_completed(running)):
            done += made
            said = ", ".join(f"{s.method} {1e3 * s.rmse_m:.2f} mm, {s.coverage_95:.1%} in 95 %" for s in made)
            typer.echo(f"{made[0].plan}, seed {made[0].seed}: {said}", err=True)
    return done


def main(
    plans: Annotated[list[Path] | None, typer.Argument(help="Plans. [default: examples/plans/causes/*.toml]")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="How many; they are 1, 2, ...")] = 5,
    jobs: Annotated[int, typer.Option(min=1, help="How many trials run at a time.")] = 1,
    method: Annotated[Method | None, typer.Option(help="Only this one. [default: both]")] = None,
    out: Annotated[Path | None, typer.Option(help="File to which the table is written as well.")] = None,
) -> None:
    """Print the table."""
    chosen = sorted((plan.resolve() for plan in plans or PLANS.glob("*.toml")), key=healthy_first)
    base_of = {plan: next(iter(plan_files(plan)[1:]), None) for plan in chosen}
    # a plan of another folder, such as the one that healthy.toml extends, is no pair
    pairs = {base.resolve() for plan, base in base_of.items() if base is not None and base.parent == plan.parent}
    tasks = [(plan, seed) for plan in sorted({*chosen, *pairs}) for seed in range(1, seeds + 1)]
    done = scores_of(tasks, [known for known in METHODS if method in (None, known)], jobs)
    bases = {plan.stem: base.stem if base is not None else "" for plan, base in base_of.items()}
    command = " ".join(["benchmarks/causes.py", *(plan.as_posix() for plan in plans or ()), f"--seeds {seeds}"])
    text = table(done, bases, command)
    typer.echo(text, nl=False)
    if out is not None:
        out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
