"""How long a process takes that only imports, beside `import gtsam` alone. Not part of the default run:

pytest -n 0 tests/benchmarks/test_import_speed.py --benchmark-only
"""

import subprocess
import sys

import pytest

from timing import IMPORTS


@pytest.mark.parametrize("what", list(IMPORTS))
def test_import(benchmark, what) -> None:
    """The process included; the first round warms up the disk's cache."""
    command = [sys.executable, "-c", IMPORTS[what]]
    benchmark.pedantic(lambda: subprocess.run(command, check=True), rounds=5, warmup_rounds=1)


def test_help(benchmark) -> None:
    command = [sys.executable, "-m", "tensegraph", "--help"]
    benchmark.pedantic(lambda: subprocess.run(command, check=True, capture_output=True), rounds=5, warmup_rounds=1)
