"""The shipped trial of a robot that is tipped, copied, cut and edited."""

import shutil
from pathlib import Path

import numpy as np

from trial_edits import cut

ROLL = Path(__file__).parents[2] / "examples" / "roll_02"


def roll(folder: Path, until_s: float = np.inf, edit=lambda text: text) -> Path:
    """Return a copy of the trial without what comes later, with its trial.toml edited."""
    shutil.copytree(ROLL, folder)
    cut(folder, until_s)
    (folder / "trial.toml").write_text(edit((folder / "trial.toml").read_text()))
    return folder
