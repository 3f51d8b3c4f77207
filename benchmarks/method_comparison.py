"""All methods on the same lengths, as `tensegraph compare` has them: `method_comparison.py [TRIAL...]`, with truth."""

import sys
from collections.abc import Sequence
from pathlib import Path

from tensegraph import Settings, open_trial
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.reports.comparison_tables import as_markdown
from tensegraph.io.reports.terminal import Terminal
from tensegraph.scoring.method_scores import by_method, comparison_rows, measure

EXAMPLES = Path(__file__).parents[1] / "examples"


def tables(trials: Sequence[Path]) -> str:
    """Return both tables as Markdown, with a line about each."""
    model = read_sensor_model()
    terminal = Terminal(quiet=True)
    measured = [one for path in trials for one in measure(open_trial(path), Settings(), model, terminal)]
    return as_markdown(comparison_rows(by_method(measured)), "tensegraph compare TRIAL...")


if __name__ == "__main__":
    print(tables([Path(argument) for argument in sys.argv[1:]] or [EXAMPLES / "press_01"]))
