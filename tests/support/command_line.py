"""The command line in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path


def run(*arguments, cwd: Path, timeout_s: float = 120) -> subprocess.CompletedProcess:
    """Run `python -m tensegraph` in a directory."""
    environment = os.environ | {"COLUMNS": "120", "TERM": "dumb"}
    command = [sys.executable, "-m", "tensegraph", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=timeout_s, check=False
    )


CALIBRATE = ("calibrate", "strips", "--epochs", "20", "--out")
