"""`simulate`: a plan in, a trial directory out."""

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..io.trial_directory import Trial, open_trial

if TYPE_CHECKING:  # what a simulation needs takes half a second to import, and `import tensegraph` names `simulate`
    from ..models.twin.virtual_trial import VirtualTrial
    from .terminal import Terminal


def simulate(plan: str | Path, out: str | Path, seed: int | None = None) -> Trial:
    """Simulate a plan, write its trial, and return it opened.

    Args:
        plan: the plan's file.
        out: the trial's directory, which must not exist yet; it is there whole or not at all.
        seed: instead of the plan's own.

    Raises:
        InputError: for a plan that cannot be simulated, or when something stands at `out` or it cannot be written.
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    from ..io.boards.recorder import Recorder
    from ..io.whole import check_vacant, written_whole
    from ..models.values.stamped_positions import StampedPositions

    out = Path(out)
    check_vacant(out)
    trial = virtual_trial(plan, seed)
    with written_whole(out) as (inside,), Recorder(inside, trial.metadata) as recorder:
        for reading in trial.readings:
            recorder.add(reading)
        recorder.add_truth(StampedPositions(trial.t_s, trial.node_position_m), trial.load_n)
    return open_trial(out)


def virtual_trial(plan: str | Path, seed: int | None = None) -> "VirtualTrial":
    """Return what `simulate` writes: the readings of a plan's boards, and the truth."""
    from importlib.metadata import version

    from ..io.plan_file import read_plan
    from ..models.twin.virtual_trial import simulate as simulate_plan

    parsed = read_plan(Path(plan))
    parsed = parsed if seed is None else replace(parsed, seed=seed)
    provenance = f"simulated: tensegraph {version('tensegraph')}, plan {Path(plan).name}, seed {parsed.seed}"
    return simulate_plan(parsed, provenance)


def simulate_trial(plan: Path, out: Path, seed: int | None, terminal: "Terminal") -> None:
    """Simulate a plan, and say how long its trial is; see `simulate`."""
    start_s = time.perf_counter()
    trial = simulate(plan, out, seed)
    seconds = time.perf_counter() - start_s
    terminal.written(f"{trial.name}: {trial.row_count()} rows in {seconds:.1f} s, written to {out}")
