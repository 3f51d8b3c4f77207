"""Runs of commands on changed files, each in a process of its own, and what is wrong with how one ended."""

import functools
import gc
import importlib.metadata
import json
import math
import os
import random
import resource
import shutil
import signal
import sys
import tomllib
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any
from unittest import mock

from pydantic import TypeAdapter

import mutations
import slip_mutations
import tensegraph.cli
from blank_figures import blank_figures
from command_line import run
from hostile_targets import Target
from sane_results import insane
from tensegraph.io.viewer.run_log import new_recording

CPU_S = 60
"""Computing time after which a run counts as one that hangs. Most take a tenth of a second; stamps in milliseconds make
a trial of a second one of many minutes, of which each frame is estimated."""
LONG_S = 600
"""Duration of a plan above which its simulation may take more time, in proportion; memory ends it at some 5000 s."""
WAIT_S = 300
"""Time after which one hangs that waits for something; a busy machine may need a while."""
MEMORY_BYTES = 12 << 30
RUNS_PER_PROCESS = 40
LONGEST_LINE = 1000
"""Number of characters of an error that a user still reads."""


@dataclass(frozen=True)
class Ground:
    """A target with its files, from which all of its runs start."""

    name: str
    target: Target
    files: Path

    @classmethod
    def made(cls, name: str, target: Target, folder: Path) -> "Ground":
        """Make the files in a folder, unless another target has, and check that the command takes them as they are."""
        files = folder / target.make.__name__
        if not files.exists():
            files.mkdir(parents=True)
            target.make(files)
        as_it_is = folder / f"{name}_as_it_is"
        shutil.copytree(files, as_it_is)
        ended = run(*target.command, cwd=as_it_is)  # imports all that runs need, before they fork
        assert target.refused or (ended.returncode, ended.stderr) == (0, ""), f"{name}: {ended.stderr}"
        return cls(name, target, files)

    def changed(self, place: Path, seed: int) -> str:
        """Copy the files to a place that does not exist, change one, and return the names of the changes."""
        rng = random.Random(f"{self.name} {seed}")
        shutil.copytree(self.files, place)
        file = place / rng.choice(self.target.files)
        if rng.random() < 0.4 and file.suffix not in (".c3d", ".mcap"):
            return mutations.mutate(file, rng)
        return slip_mutations.slip(file, rng, self.target.other and self.files / self.target.other)


Run = tuple[Ground, int]
"""What is attacked, and the seed."""


def attack(runs: Sequence[Run], folder: Path) -> Iterator[str]:
    """Run commands on changed files, and yield what was changed and what is wrong with the end, where anything is.

    Many runs share a process, because a fork takes longer than most of them; after one that kills it, another goes on.
    """
    journal = folder / "journal.txt"
    while runs:
        journal.write_text("")
        child = os.fork()
        if child == 0:
            _run_all(runs[:RUNS_PER_PROCESS], folder, journal)
        _, status = os.waitpid(child, 0)
        lines = [json.loads(line) for line in journal.read_text().splitlines()]
        yield from (wrong for wrong in lines[1::2] if wrong)
        done = len(lines) // 2
        if os.WIFSIGNALED(status):
            yield f"{lines[-1]}: ended by signal {signal.Signals(os.WTERMSIG(status)).name}"
            done += 1
        assert os.WIFSIGNALED(status) or not os.WEXITSTATUS(status), f"the harness itself failed: {lines[-1:]}"
        runs = runs[done:]


@contextmanager
def quick_start() -> Iterator[None]:
    """Do once what every command does at its start, and draw no pixels: most of the time of a run that is refused.

    `view` opens no page: what it would send to the viewer goes into a file.
    """
    with (
        mock.patch("tensegraph.models.plug_ins.entry_points", functools.cache(importlib.metadata.entry_points)),
        mock.patch("tensegraph.models.values.tables.TypeAdapter", functools.cache(TypeAdapter)),
        blank_figures(),
        mock.patch("tensegraph.commands.view.ViewerServer", NoServer),
        mock.patch("tensegraph.commands.view.new_recording", NoConnection),
    ):
        yield


class NoServer:
    """A viewer that nobody looks at."""

    data_url = page_url = "nowhere"

    def __enter__(self) -> "NoServer":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def wait(self) -> None:
        """Return at once."""


class NoConnection:
    """A recording of Rerun that goes into a file."""

    def __init__(self) -> None:
        self._recording = new_recording()

    def connect_grpc(self, url: str) -> None:
        self._recording.save("view.rrd")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recording, name)


def _run_all(runs: Sequence[Run], folder: Path, journal: Path) -> None:
    """Do runs in this process, and end it; two lines in the journal tell of each: what was changed, what was wrong."""
    try:
        gc.disable()
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        with journal.open("a", buffering=1) as lines:
            for ground, seed in runs:
                place = folder / f"{ground.name}_{seed}"
                change = f"{ground.name}, seed {seed}: {ground.changed(place, seed)}"
                print(json.dumps(change), file=lines)
                wrong = outcome(place, ground.target)
                print(json.dumps(wrong and f"{change}: {wrong}"), file=lines)
                os.chdir(folder)
                if not wrong:
                    shutil.rmtree(place)
    except BaseException:
        traceback.print_exc(file=sys.__stderr__)
        os._exit(1)
    os._exit(0)


def outcome(place: Path, target: Target) -> str | None:
    """Run a command in this process, and return what is wrong with how it ended, or None; a hang ends the process."""
    out, error = StringIO(), StringIO()
    os.chdir(place)
    longer = min(max(_planned_s(place) / LONG_S, 1.0), 10.0)
    signal.setitimer(signal.ITIMER_PROF, CPU_S * longer)
    signal.alarm(round(WAIT_S * longer))
    with redirect_stdout(out), redirect_stderr(error), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        code = _run(target.command)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.alarm(0)
    text = error.getvalue()
    if caught:
        return f"a warning: {caught[0].filename}:{caught[0].lineno}: {caught[0].message}"
    if code == 0:
        return f"on stderr: {text}" if text else insane(place)
    if code != 2 or text.count("\n") != 1 or not text.startswith("tensegraph: "):
        return f"code {code}: {text}"
    if len(text) > LONGEST_LINE or not text[:-1].isprintable():
        return f"no line to read: {text!r}"
    return "a result beside an error" if any(place.glob("out*")) else None


def _planned_s(place: Path) -> float:
    """Return the duration that a plan asks for, if there is one to simulate."""
    try:
        planned_s = float(tomllib.loads((place / "plan.toml").read_text(encoding="utf-8"))["duration_s"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return 0.0
    return planned_s if math.isfinite(planned_s) else 0.0


def _run(command: tuple[str, ...]) -> int:
    """Run a command, print the traceback of what it should not raise, and return its exit code."""
    try:
        with mock.patch.object(sys, "argv", ["tensegraph", *command]):
            tensegraph.cli.main()
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
        return 99
    return 0
