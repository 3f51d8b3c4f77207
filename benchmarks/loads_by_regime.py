"""Loads and the honesty of ellipsoids by regime, of the batch graph: `loads_by_regime.py [TRIAL...]`, with truth."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tensegraph import evaluate, reconstruct
from tensegraph.io.reports.cells import or_dash

EXAMPLES = Path(__file__).parents[1] / "examples"
REGIMES = ("quiet", "loaded", "slack")


def table(trials: Sequence[Path]) -> Iterator[str]:
    """Yield the rows of a Markdown table, one trial with true loads a row."""
    yield "| trial | loaded | others | seen | true | false alarms | right node | quiet | loaded | slack |"
    yield "|---" * 10 + "|"
    for path in trials:
        evaluation = evaluate(reconstruct(path), path)
        score = evaluation.loads
        if score is None:
            continue
        cells = [or_dash(score.loaded_rmse_n, "{:.2f}"), or_dash(score.unloaded_rmse_n, "{:.2f}")]
        cells += [or_dash(share, "{:.0%}") for share in (score.recall, score.precision)]
        cells += [or_dash(score.quiet_false_alarm_share, "{:.1%}"), or_dash(score.most_loaded_share, "{:.0%}")]
        regimes = {regime.name: regime for regime in evaluation.regimes}
        known = [regimes[name] for name in REGIMES if name in regimes]
        cells += [f"{or_dash(r.coverage_68, '{:.0%}')}, {or_dash(r.coverage_95, '{:.0%}')}" for r in known]
        yield f"| {path.resolve().name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    for line in table([Path(argument) for argument in sys.argv[1:]] or [EXAMPLES / "press_01"]):
        print(line, flush=True)
