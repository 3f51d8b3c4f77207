"""`simulate`: makes a trial directory from a plan."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from ..io.boards.recorder import Recorder
from ..io.plan_file import read_plan
from ..io.provenance import FINGERPRINT, fingerprint, is_up_to_date, simulation_provenance, versions
from ..io.trial_directory import Trial, open_trial
from ..io.whole import SIMULATION_FILE, check_vacant, written_whole
from ..models.trial_description import describe_trial
from ..models.twin.plan import Plan
from ..models.twin.virtual_trial import simulate as simulate_plan
from ..models.values.errors import InputError, naming, needs_extra
from ..models.values.tracks import StampedPositions
from ..models.values.units import LARGEST_NUMBER
from .paths import result_paths

if TYPE_CHECKING:  # rich is not needed by `simulate` from Python
    from ..io.reports.terminal import Terminal
    from .many import Workers


def simulate(plan: str | Path, out: str | Path, seed: int | None = None) -> Trial:
    """Simulate a plan, write its trial, and return it opened.

    Args:
        plan: path of the plan.
        out: trial directory, which must not exist yet; it is written completely or not at all.
        seed: used instead of the seed of the plan.

    Raises:
        InputError: for a plan or a seed that cannot be simulated, or when `out` exists or cannot be written.
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    out = Path(out)
    check_vacant(out)
    return _simulated(_seeded(read_plan(Path(plan)), seed), Path(plan), out, {})


def _seeded(plan: Plan, seed: int | None) -> Plan:
    if seed is not None and not 0 <= seed <= LARGEST_NUMBER:
        raise InputError(f"seed: expected a whole number from 0 to {LARGEST_NUMBER:g}, got {seed}")
    return plan if seed is None else replace(plan, seed=seed)


def _simulated(
    plan: Plan,
    path: Path,
    out: Path,
    simulation: Mapping[str, Any],
    progress: Callable[[float], None] = lambda share: None,
) -> Trial:
    """Simulate a plan, write its trial, with simulation.toml unless that is empty, and return it opened."""
    with naming(path):
        trial = simulate_plan(plan, simulation_provenance(path, plan.seed), progress)
    describe_trial(trial.metadata, str(path))  # what nobody could read is not written
    if not trial.readings:
        raise InputError(f"{path}: boards.lost_rows: expected fewer than {plan.boards.lost_rows:g}: no row is left")
    with written_whole(out) as (inside,):
        with Recorder(inside, trial.metadata) as recorder:
            for reading in trial.readings:
                recorder.add(reading)
            for carried in trial.carried:
                recorder.add(carried)
            recorder.add_truth(StampedPositions(trial.t_s, trial.node_position_m), trial.load_n, trial.standing)
        if simulation:
            simulation = {**simulation, "tables": sorted(path.name for path in inside.iterdir())}
            (inside / SIMULATION_FILE).write_text(tomli_w.dumps(simulation), encoding="utf-8")
    return open_trial(out)


@dataclass(frozen=True, slots=True)
class SimulationJob:
    """One plan to be simulated."""

    plan: Path
    out: Path
    """Trial directory."""
    seed: int | None
    """Used instead of the seed of the plan."""


def simulate_plans(
    plans: Sequence[Path], out: Path, *, seed: int | None, workers: "Workers", terminal: "Terminal"
) -> None:
    """Simulate plans, and print the number of rows of each trial.

    Args:
        plans: their files.
        out: for one plan, its trial directory; for several, the directory in which each gets its own.
        seed: used instead of the seeds of the plans.
        workers: the processes that do the work.
        terminal: for progress.

    Raises:
        TensegraphError: when a trial cannot be written; for a single plan, see `simulate`.
        SystemExit: with 1 when some of several plans failed.
    """
    from .many import Many

    places = result_paths([plan.parent / plan.stem for plan in plans], out, out, (SIMULATION_FILE,))
    jobs = {
        str(plan): SimulationJob(workers.place(plan), workers.place(place), seed)
        for plan, place in zip(plans, places, strict=True)
    }
    shown = dict(zip(jobs, places, strict=True))
    many = Many(workers, terminal)
    for name, text in many.each(simulate_trial, jobs, "plans"):
        terminal.written(f"up to date: {shown[name]}" if text is None else f"{text}, written to {shown[name]}")
    many.end()


def simulate_trial(job: SimulationJob, terminal: "Terminal") -> str | None:
    """Simulate a plan, write its trial and return what it is; None where the same trial stands already.

    Raises:
        TensegraphError: see `simulate`.
    """
    plan = _seeded(read_plan(job.plan), job.seed)
    with needs_extra("the twin", "twin"):
        software = versions("mujoco")
    made_from = fingerprint({"plan": asdict(plan), "name": job.plan.name, "mujoco": software["mujoco"]})
    if is_up_to_date(job.out / SIMULATION_FILE, made_from):
        return None
    start_s = time.perf_counter()
    about = {"plan": job.plan.name, "seed": plan.seed, FINGERPRINT: made_from, "versions": software}
    with terminal.stages(job.plan.stem, {"motion": 0.6, "sensors and files": 0.4}) as bar:
        trial = _simulated(plan, job.plan, job.out, about, lambda share: bar.reached("motion", share))
    seconds = time.perf_counter() - start_s
    return f"{trial.name}: {trial.row_count()} rows in {seconds:.1f} s"
