"""The twin's loop: a plan in, a trial directory out."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from ..io.boards.recorder import Recorder, check_trial_path
from ..io.plan_file import read_plan
from ..io.trial_directory import Trial, open_trial
from ..models.twin.virtual_trial import VirtualTrial
from ..models.twin.virtual_trial import simulate as simulate_plan
from ..models.values.errors import InputError


def simulate(plan: str | Path, out: str | Path, seed: int | None = None) -> Trial:
    """Simulate a plan, write its trial, and return it opened.

    Args:
        plan: the plan's file.
        out: the trial's directory, which must not exist yet; it is there whole or not at all.
        seed: instead of the plan's own.

    Raises:
        InputError: for a plan that can not be simulated, or when something stands at `out`.
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    out = Path(out)
    check_trial_path(out)
    trial = virtual_trial(plan, seed)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent)
    except OSError as error:
        raise InputError(f"{out}: can not be written: {error}") from error
    with folder as temporary:
        with Recorder(Path(temporary) / out.name, trial.metadata) as recorder:
            for reading in trial.readings:
                recorder.add(reading)
            recorder.add_truth(trial.t_s, trial.node_position_m, trial.load_n)
        (Path(temporary) / out.name).rename(out)
    return open_trial(out)


def virtual_trial(plan: str | Path, seed: int | None = None) -> VirtualTrial:
    """Simulate a plan; see `simulate`."""
    parsed = read_plan(Path(plan))
    parsed = parsed if seed is None else replace(parsed, seed=seed)
    provenance = f"simulated: tensegraph {version('tensegraph')}, plan {Path(plan).name}, seed {parsed.seed}"
    return simulate_plan(parsed, provenance)
