"""`simulate`: makes a trial directory from a plan."""

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..io.boards.recorder import Recorder
from ..io.plan_file import read_plan
from ..io.provenance import simulation_provenance
from ..io.trial_directory import Trial, open_trial
from ..io.whole import check_vacant, written_whole
from ..models.twin.virtual_trial import simulate as simulate_plan
from ..models.values.stamped_positions import StampedPositions

if TYPE_CHECKING:  # rich is not needed by `simulate` from Python
    from ..io.reports.terminal import Terminal


def simulate(plan: str | Path, out: str | Path, seed: int | None = None) -> Trial:
    """Simulate a plan, write its trial, and return it opened.

    Args:
        plan: path of the plan.
        out: trial directory, which must not exist yet; it is written completely or not at all.
        seed: used instead of the seed of the plan.

    Raises:
        InputError: for a plan that cannot be simulated, or when `out` exists or cannot be written.
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    out = Path(out)
    check_vacant(out)
    parsed = read_plan(Path(plan))
    if seed is not None:
        parsed = replace(parsed, seed=seed)
    trial = simulate_plan(parsed, simulation_provenance(Path(plan), parsed.seed))
    with written_whole(out) as (inside,), Recorder(inside, trial.metadata) as recorder:
        for reading in trial.readings:
            recorder.add(reading)
        for carried in trial.carried:
            recorder.add(carried)
        recorder.add_truth(StampedPositions(trial.t_s, trial.node_position_m), trial.load_n, trial.standing)
    return open_trial(out)


def simulate_trial(plan: Path, out: Path, seed: int | None, terminal: "Terminal") -> None:
    """Simulate a plan, and print the number of rows of its trial; see `simulate`."""
    start_s = time.perf_counter()
    trial = simulate(plan, out, seed)
    seconds = time.perf_counter() - start_s
    terminal.written(f"{trial.name}: {trial.row_count()} rows in {seconds:.1f} s, written to {out}")
