"""How long a frame takes, and an import: `timing.py [TRIAL]`.

The same with statistics, and with memory: `pytest tests/benchmarks --benchmark-only`.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tensegraph import Settings, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.pipeline import ESTIMATORS, Pipeline

EXAMPLES = Path(__file__).parents[1] / "examples"
IMPORTS = {
    "nothing": "pass",
    "gtsam alone": "import gtsam",
    "tensegraph": "import tensegraph",
    "all public names": "import tensegraph\nfor name in dir(tensegraph): getattr(tensegraph, name)",
    "the command line": "import tensegraph.cli",
}
"""What a process imports."""


def seconds_of(what: Callable[[], object]) -> float:
    """Return how long something takes."""
    start_s = time.perf_counter()
    what()
    return time.perf_counter() - start_s


def frame_table(path: Path) -> Iterator[str]:
    """Yield the rows of a Markdown table: milliseconds a frame, over a whole trial."""
    trial = open_trial(path)
    pipeline = Pipeline(trial.description, Settings(), read_sensor_model())
    frames = []
    front_end_s = seconds_of(lambda: frames.extend(pipeline.lengths(trial.readings())))
    yield "| of a frame | ms |"
    yield "|---|---|"
    yield f"| counts to lengths | {1e3 * front_end_s / len(frames):.2f} |"
    for method in ("live", "batch"):
        estimator = ESTIMATORS[method](pipeline.rest.structure, pipeline.rest, pipeline.settings)
        estimator_s = seconds_of(lambda estimator=estimator: list(estimator.estimate(frames)))
        yield f"| lengths to shape and covariance, {method} | {1e3 * estimator_s / len(frames):.2f} |"


def import_table(rounds: int = 5) -> Iterator[str]:
    """Yield the rows of a Markdown table: seconds of a process that only imports, the fastest of some rounds."""
    yield "| a process that imports | s |"
    yield "|---|---|"
    for name, code in IMPORTS.items():
        command = [sys.executable, "-c", code]
        rounds_s = [seconds_of(lambda command=command: subprocess.run(command, check=True)) for _ in range(rounds)]
        yield f"| {name} | {min(rounds_s):.2f} |"


if __name__ == "__main__":
    for line in (*frame_table(Path(sys.argv[1]) if sys.argv[1:] else EXAMPLES / "press_01"), "", *import_table()):
        print(line, flush=True)
