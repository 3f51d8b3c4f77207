"""A comparison of methods as CSV and as Markdown."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ...models.evaluation.comparison import ALL, PUBLISHED, ComparisonRow, Published, Spread, spreads
from ...models.evaluation.evaluation import Errors, ShapeErrors
from .cells import or_dash

SEVERAL = 3
"""Number of trials from which on their mean, spread and worst mean something."""


def as_markdown(rows: Sequence[ComparisonRow], command: str, *, with_trials: bool = True) -> str:
    """Return the paper's Table I with its published rows and ours, the spread over trials, and each trial's RMSE.

    Args:
        rows: of all trials together, then of each trial.
        command: by which they were made.
        with_trials: whether to have a row for each trial.
    """
    together = [row for row in rows if row.trial == ALL]
    trials = list(dict.fromkeys(row.trial for row in rows if row.trial != ALL))
    header = ("", "nodes", "faces", "system", "heights", "in 95 %", "sigma", "wrong branch", "ms / frame")
    lines = [
        f"RMSE in millimetres by `{command}`; heights are those of nodes, faces and system. In italics: published for",
        "other robots under other conditions, as their authors define it (the paper's Table I).",
        "",
        *_table(header, [*map(_published_cells, PUBLISHED), *(_method_cells(row, len(trials)) for row in together)]),
        "",
        "*In 95 %*: share of nodes within their ellipsoid of 95 %, *sigma*: its median size, *wrong branch*: share of",
        "frames.",
    ]
    if len(trials) >= SEVERAL:
        lines += _spread_lines(spreads(rows))
    if with_trials:
        by_trial = [(trial, *(_trial_cell(row) for row in rows if row.trial == trial)) for trial in trials]
        lines += [
            "",
            "Node RMSE, trial by trial, with the share of nodes in their ellipsoid of 95 % and its median size:",
            "",
            *_table(("trial", *(row.method for row in together)), by_trial),
        ]
    return "\n".join(lines) + "\n"


def _spread_lines(found: Sequence[Spread]) -> list[str]:
    """Return a table of how the results of each method differ from trial to trial."""
    header = ("", "trials", "RMSE, mean ± spread", "worst", "in 95 %, mean ± spread", "least")
    cells = [
        (
            s.method,
            str(s.trials),
            f"{1e3 * s.rmse_mean_m:.1f} ± {or_dash(1e3 * s.rmse_spread_m, '{:.1f}')}",
            f"{1e3 * s.rmse_worst_m:.1f}, {s.worst_trial}",
            f"{or_dash(s.coverage_mean, '{:.0%}')} ± {or_dash(s.coverage_spread, '{:.0%}')}",
            f"{or_dash(s.coverage_worst, '{:.0%}')}, {s.least_covered_trial}".rstrip(", "),
        )
        for s in found
    ]
    text = "Over the trials, each of the same weight; the spread is the standard deviation of a trial:"
    return ["", text, "", *_table(header, cells)]


def _published_cells(p: Published) -> tuple[str, ...]:
    errors = (or_dash(value, "{:.1f}") for value in (p.node_mm, p.faces_mm, p.system_mm))
    return (f"*{p.source}*", *errors, *["-"] * 5)


def _method_cells(row: ComparisonRow, trials: int) -> tuple[str, ...]:
    """Return the cells of a method on all trials, which says so where it finished fewer than there are."""
    parts = (row.errors.nodes, row.errors.faces, row.errors.system)
    return (
        row.method if row.trials == trials else f"{row.method} ({row.trials} of {trials} trials)",
        *(or_dash(1e3 * part.rmse_m, "{:.1f}") for part in parts),
        " / ".join(or_dash(1e3 * part.height_rmse_m, "{:.1f}") for part in parts),
        or_dash(row.coverage_95, "{:.0%}"),
        or_dash(1e3 * row.median_sigma_m, "{:.1f}"),
        or_dash(row.wrong_branch_share, "{:.0%}"),
        or_dash(row.ms_per_frame, "{:.2f}"),
    )


def _trial_cell(row: ComparisonRow) -> str:
    rmse = or_dash(1e3 * row.errors.nodes.rmse_m, "{:.1f}")
    if np.isnan(row.coverage_95):
        return rmse
    return f"{rmse} ({row.coverage_95:.0%} at {1e3 * row.median_sigma_m:.1f})"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (header, ["---"] * len(header), *rows)]


def write_comparison_csv(rows: Sequence[ComparisonRow], path: Path) -> None:
    """Write all numbers in metres: the published ones, all trials together, then each trial."""
    parts = ("nodes", "faces", "system")
    measures = ("rmse_m", "height_rmse_m", "median_m", "percentile_95_m")
    last = ("coverage_95", "median_sigma_m", "wrong_branch_share", "ms_per_frame")
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = [f"{part}_{measure}" for part in parts for measure in measures]
        writer.writerow(["source", "trial", "method", "trials", "frames", *names, *last])
        for p in PUBLISHED:
            row = ShapeErrors(*(_only_rmse(mm) for mm in (p.node_mm, p.faces_mm, p.system_mm)))
            cells = [getattr(getattr(row, part), measure) for part in parts for measure in measures]
            writer.writerow(["published", "", p.source, "", "", *map(_cell, cells), *[""] * len(last)])
        for r in rows:
            cells = [getattr(getattr(r.errors, part), measure) for part in parts for measure in measures]
            cells += [getattr(r, name) for name in last]
            writer.writerow(["measured", r.trial, r.method, r.trials, r.frames, *map(_cell, cells)])


def _only_rmse(millimetres: float) -> Errors:
    return Errors(millimetres / 1e3, np.nan, np.nan, np.nan)


def _cell(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
