"""Work during which processes die."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from tensegraph import InputError
from tensegraph.io.reports.terminal import Terminal


@dataclass(frozen=True)
class Letter:
    """What a job does: writes its text, and dies or fails as the text says."""

    path: Path
    text: str
    after: Path | None = None
    """File for which the job waits before it begins, so that the order of two jobs is known."""


def write_letter(job: Letter, terminal: Terminal) -> int:
    """Write a text into a file and return this process; `dies` kills it, `dies once` only at the first attempt."""
    while job.after is not None and not job.after.exists():
        time.sleep(0.01)
    attempts = len(list(job.path.parent.glob(f"{job.path.name}.try*")))
    job.path.with_name(f"{job.path.name}.try{attempts}").touch()
    if job.text == "dies" or (job.text == "dies once" and attempts == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if job.text == "fails":
        raise InputError(f"{job.path.name}: expected a letter")
    if job.text == "is broken":
        raise ZeroDivisionError("by zero")
    job.path.write_text(job.text)
    return os.getpid()
