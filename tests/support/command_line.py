"""The command line: in this process, which has imported everything already, or in one of its own."""

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

import undrawn_command
from tensegraph.cli import main

SCREEN = {"COLUMNS": "120", "TERM": "dumb"}
CALIBRATE = ("calibrate", "strips", "--epochs", "7", "--out")
"""Two checkpoints: it can be interrupted after the first."""


def run(*arguments, cwd: Path) -> subprocess.CompletedProcess:
    """Run `tensegraph` in a directory, in this process."""
    words = ["tensegraph", *map(str, arguments)]
    out, error = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd),
        mock.patch.dict(os.environ, SCREEN),
        mock.patch.object(sys, "argv", words),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(error),
    ):
        try:
            main()
            code = 0
        except SystemExit as ended:
            code = ended.code or 0
    return subprocess.CompletedProcess(words, code, out.getvalue(), error.getvalue())


def printed_by(*arguments, cwd: Path) -> str:
    """Run a command that ends well, see `run`, and return what it prints."""
    ended = run(*arguments, cwd=cwd)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def refusal_of(*arguments, cwd: Path) -> str:
    """Run a command that is refused, see `run`, and return the one line that says why."""
    ended = run(*arguments, cwd=cwd)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
    return ended.stderr


def run_process(*arguments, cwd: Path, timeout_s: float = 120, **environment) -> subprocess.CompletedProcess:
    """Run `python -m tensegraph` in a directory, as a user does."""
    command = [sys.executable, "-m", "tensegraph", *map(str, arguments)]
    quiet = {"capture_output": True, "text": True, "check": False}
    return subprocess.run(command, cwd=cwd, env=os.environ | SCREEN | environment, timeout=timeout_s, **quiet)


def start(*arguments, cwd: Path, **environment) -> subprocess.Popen:
    """Start the command in a directory, in a group of its own.

    One that records draws nothing, and is started without matplotlib.
    """
    program = ("-m", "tensegraph") if arguments[0] == "record" else (undrawn_command.__file__,)
    command = [sys.executable, *program, *map(str, arguments)]
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = os.environ | SCREEN | {"MPLBACKEND": "agg"} | environment
    return subprocess.Popen(command, cwd=cwd, env=environment, start_new_session=True, **pipes)
