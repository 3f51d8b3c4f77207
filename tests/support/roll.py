"""The shipped trial of a robot that is tipped, copied, cut and edited: it tips at 3.5 s, or at 1.5 s."""

import shutil
from pathlib import Path

import numpy as np

from plan_edits import replaced
from trial_edits import cut, rewritten

ROLL = Path(__file__).parents[2] / "examples" / "roll_02"
REST_S = 0.5
LEFT_OUT_S = 2.0
LEFT_OUT_ROWS = 100


def roll(folder: Path, until_s: float = np.inf, edit=lambda text: text) -> Path:
    """Return a copy of the trial without what comes later, with its trial.toml edited."""
    shutil.copytree(ROLL, folder)
    cut(folder, until_s)
    rewritten(folder / "trial.toml", edit)
    return folder


def soon_tipped(folder: Path, until_s: float = np.inf, edit=lambda text: text) -> Path:
    """Return a copy of the trial that rests two seconds less: the robot is tipped from 1.5 to 2 s, and from 4.5 to 6 s.

    What was recorded from 0.5 to 2.5 s, while it stood still, is left out, and all clocks count on from there. A hand
    moves it from then on.
    """
    rest = ("seconds = 2.0", f"seconds = {REST_S}")
    roll(folder, until_s + LEFT_OUT_S, lambda text: edit(replaced(text, rest)))
    for file in folder.glob("*.csv"):
        header, *rows = file.read_text().splitlines(keepends=True)
        stamp_s = np.array([float(row.split(",")[0]) for row in rows])
        before, after = (np.flatnonzero(chosen) for chosen in (stamp_s < REST_S, stamp_s >= REST_S + LEFT_OUT_S))
        file.write_text("".join([header, *(rows[k] for k in before), *sooner([rows[k] for k in after], file.stem)]))
    return folder


def sooner(rows: list[str], name: str) -> list[str]:
    """Return rows of a file with their clocks set back by what is left out; those of boards are numbered on."""
    told = []
    for row in rows:
        stamp_s, *others = row.split(",")
        if name.startswith("board"):
            others[:2] = str(int(others[0]) - LEFT_OUT_ROWS), str(int(others[1]) - round(1e6 * LEFT_OUT_S))
        told.append(",".join([f"{float(stamp_s) - LEFT_OUT_S:.6f}", *others]))
    return told
