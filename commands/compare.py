"""`compare`: runs all methods on the same lengths and sigmas of all trials, in the form of the paper's Table I."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.markdown import Markdown

from ..io.figures.comparison_figure import write_comparison_figure, write_spread_figure
from ..io.measured_trials import measured_by, measured_methods, read_measured, write_measured
from ..io.provenance import fingerprint
from ..io.reports.comparison_tables import as_markdown, write_comparison_csv
from ..io.reports.terminal import Terminal
from ..io.toml import read_settings
from ..io.trial_directory import Trial, open_trial
from ..io.whole import check_replaceable, check_writable, written_whole
from ..models.evaluation.comparison import PUBLISHED, ComparisonRow
from ..models.settings import Settings
from ..models.values.errors import InputError
from ..pipeline import EstimatorFactory, estimator_plug_ins
from ..scoring.method_scores import comparison_rows, estimators_of, measure
from .many import Many, Workers
from .origin import made_with, placed_model, trained_model
from .paths import distinct_names

COMPARISON_FILE = "comparison.csv"
PARTS = "trials"
"""Folder, in that of the comparison, of what was measured on each trial."""
MOST_TRIALS = 24
"""Number of trials up to which each is shown on the screen and in the figure; of more, their spread is."""


@dataclass(frozen=True, slots=True)
class ComparisonJob:
    """One trial on which all methods are compared."""

    trial: Path
    part: Path
    """File that keeps what was measured."""
    settings: Settings
    config: Path | None
    """File of the settings, as errors name it; None where they are the defaults."""
    model: Path | None
    """File or name of the sensor model; the one in the package if None."""
    estimators: Mapping[str, EstimatorFactory]
    """The methods by name."""

    def fingerprint(self, trial: Trial) -> str | None:
        """Return the hash of all that is measured; None with a method of this process, whose code is not known."""
        others = estimator_plug_ins()
        known = {method for method, made in self.estimators.items() if _is_ours(made)} | others.keys()
        if self.estimators.keys() - known:
            return None
        return fingerprint(
            {
                "inputs": trial.hashes() | trial.truth_hashes(),
                "settings": asdict(self.settings),
                "methods": {method: made_with(method, self.model, trial.plug_ins) for method in self.estimators},
            }
        )


def _is_ours(made: EstimatorFactory) -> bool:
    return made.__module__.partition(".")[0] == __name__.partition(".")[0]


def compare_trials(
    trials: Sequence[Path],
    *,
    methods: Sequence[str] | None,
    out: Path,
    config: Path | None,
    model: Path | None,
    workers: Workers,
    terminal: Terminal,
) -> None:
    """Run methods on trials, write table and figure, and print the table.

    What was measured on a trial is kept in a file as soon as it is known, and used by the same command again.

    Args:
        trials: their directories.
        methods: see `estimators_of`.
        out: directory of the comparison.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        workers: the processes that do the work.
        terminal: for progress and the table.

    Raises:
        TensegraphError: when the comparison cannot be written, or no trial can be compared.
        SystemExit: with 1 when some of several trials failed.
    """
    names = distinct_names(trials)
    check_comparison(out)
    settings = read_settings(config)
    placed = placed_model(model, workers)  # refused here if it is none, not by every worker
    estimators = estimators_of(methods)
    jobs = {
        name: ComparisonJob(
            workers.place(trial), workers.place(out / PARTS / f"{name}.npz"), settings, config, placed, estimators
        )
        for name, trial in zip(names, trials, strict=True)
    }
    many = Many(workers, terminal)
    done = set()
    for name, lines in many.each(compare_trial, jobs, "trials"):
        done.add(name)
        for line in lines:
            terminal.line(line)
    if done:
        parts = [job.part for name, job in jobs.items() if name in done]
        with terminal.stage("table and figure"):
            of_parts = dict.fromkeys(method for part in parts for method in measured_methods(part))
            rows = comparison_rows(list(measured_by(method, parts)) for method in of_parts)
            write_comparison(rows, comparison_command(trials), out)
        with_trials = len(parts) <= MOST_TRIALS
        terminal.news.print(Markdown(as_markdown(rows, comparison_command(trials), with_trials=with_trials)))
        terminal.written(f"written to {out}")
    many.end()


def compare_trial(job: ComparisonJob, terminal: Terminal) -> list[str]:
    """Run every method on a trial, unless it was done before, and return a line for each.

    Raises:
        TensegraphError: when the trial cannot be read, has no truth of the time of its lengths, or the file cannot be
            written.
    """
    trial = open_trial(job.trial)
    made_from = job.fingerprint(trial)
    measured = read_measured(job.part, made_from)
    if measured is None:
        with terminal.stage(f"all methods on {trial.name}"):
            model = trained_model(trial.description, job.settings, job.model, job.config)
            measured = list(measure(trial, job.settings, model, terminal, estimators=job.estimators))
        write_measured(measured, made_from, job.part)
    return [one.line() for one in measured]


def check_comparison(out: Path) -> None:
    """Check, before any work, that a directory is vacant or holds an earlier comparison, finished or not.

    Raises:
        InputError: when something else stands there, or it cannot be written.
    """
    parts = out / PARTS
    if parts.is_dir() and all(part.suffix == ".npz" for part in parts.iterdir()):
        check_writable(parts / "part")
    elif out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is no earlier comparison: expected a new name")
    else:
        check_replaceable(out, (COMPARISON_FILE,))


def comparison_command(trials: Sequence[Path]) -> str:
    """Return the command in short, without the names of many trials."""
    named = " ".join(trial.as_posix() for trial in trials)
    return f"tensegraph compare {named if len(trials) <= MOST_TRIALS else f'({len(trials)} trials)'}"


def write_comparison(rows: Sequence[ComparisonRow], command: str, path: Path) -> None:
    """Write comparison.csv, comparison.md and comparison.png, all of them or none."""
    names = (COMPARISON_FILE, "comparison.md", "comparison.png")
    with written_whole(*(path / name for name in names)) as (table, page, figure):
        write_comparison_csv(rows, table)
        page.write_text(as_markdown(rows, command), encoding="utf-8")
        published_mm = {p.source: p.node_mm for p in PUBLISHED}
        if len({row.trial for row in rows}) - 1 <= MOST_TRIALS:
            write_comparison_figure(rows, published_mm, figure)
        else:
            write_spread_figure(rows, published_mm, figure)
