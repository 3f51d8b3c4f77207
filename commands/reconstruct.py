"""`reconstruct`: makes results from recorded trials, with a summary on the screen and in run.toml."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SQUARE
from rich.table import Column, Table

from ..io.provenance import FINGERPRINT, fingerprint, is_up_to_date, relative_path, versions
from ..io.reports.progress import StageBar
from ..io.reports.run_lines import (
    columns_text,
    flagged_sensors,
    frames_text,
    load_rows,
    normal_line,
    pauses,
    position_counts,
    rest_balance,
    rest_source,
    slip_line,
)
from ..io.reports.terminal import Terminal
from ..io.result import RESULT_FILES, RUN_FILE, FigureFormat, write_result
from ..io.toml import read_settings
from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.metrics import node_rmse_m
from ..models.settings import Settings
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.shape import Status
from ..models.values.errors import InputError, naming, printable
from ..models.values.readings import TendonLengths
from ..pipeline import OFFLINE_FRAMES, Pipeline, estimator_of
from .garbage import rare_collections
from .many import Many, Workers
from .origin import made_with, placed_model, trained_model
from .paths import result_paths


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a trial. What is before it is estimated too: taring, drift and pose come from there."""

    from_s: float | None
    """Time of its start; that of the trial if None."""
    to_s: float | None
    """Time of its end; that of the trial if None."""

    def __post_init__(self) -> None:
        for name, t_s in (("--from", self.from_s), ("--to", self.to_s)):
            if t_s is not None and not np.isfinite(t_s):
                raise InputError(f"{name}: expected a finite time, got {t_s}")
        if self.from_s is not None and self.to_s is not None and self.from_s > self.to_s:
            raise InputError(f"--to: expected a time after --from, {self.from_s:g} s, got {self.to_s:g}")

    def until_end(self, frames: Iterable[TendonLengths]) -> list[TendonLengths]:
        """Return the frames up to the end of the span; no frame after that is read.

        Raises:
            InputError: when no frame is in the span.
        """
        to_s = np.inf if self.to_s is None else self.to_s
        frames = iter(frames)
        first = next(frames, None)
        if first is None:
            return []
        kept = list(takewhile(lambda frame: frame.t_s <= to_s, chain([first], frames)))
        if not any(self.begins_by(frame.t_s) for frame in kept):
            last_s = kept[-1].t_s if kept else first.t_s
            from_s = first.t_s if self.from_s is None else self.from_s
            whole = f"a span within {first.t_s:.2f} to {last_s:.2f} s"
            raise InputError(f"--from and --to: expected {whole}, got {from_s:.2f} to {to_s:.2f}")
        return kept

    def as_table(self) -> dict[str, float]:
        """Return what of run.toml tells of the span."""
        ends = {"from_s": self.from_s, "to_s": self.to_s}
        return {name: t_s for name, t_s in ends.items() if t_s is not None}

    def begins_by(self, t_s: float) -> bool:
        """Return whether a time is not before the start of the span."""
        return self.from_s is None or t_s >= self.from_s


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What is done to each trial."""

    method: str
    """See `estimator_of`."""
    settings: Settings
    config: Path | None
    """File of the settings, as errors name it; None where they are the defaults."""
    model: Path | None
    """File or name of the sensor model; the one in the package if None."""
    figures: FigureFormat | None
    """Format of the figures; None draws none."""
    span: Span
    """The part of the trial of which shapes are wanted."""

    def stages(self) -> dict[str, float]:
        """Return the stages of a run in order, each with its share of the time as on the example trial."""
        shapes = {"optimisation": 5.0, "ellipsoids": 1.0} if self.method == "batch" else {"shapes": 4.0}
        return {"lengths": 2.0} | shapes | {"tables": 0.4} | ({"figures": 2.3} if self.figures else {})

    def fingerprint(self, inputs: Mapping[str, str], parts: Mapping[str, Any]) -> str:
        """Return the hash of all that the result of a trial is made from.

        Args:
            inputs: see `Trial.hashes`.
            parts: see `made_with`.
        """
        return fingerprint(
            {
                "inputs": inputs,
                "method": self.method,
                "settings": asdict(self.settings),
                **parts,
                "figures": self.figures,
                "span": [self.span.from_s, self.span.to_s],
            }
        )


@dataclass(frozen=True, slots=True)
class TrialJob:
    """One trial to be reconstructed."""

    trial: Path
    out: Path
    """Result directory."""
    options: RunOptions


def reconstruct_trials(
    trials: Sequence[Path],
    method: str,
    *,
    out: Path | None,
    config: Path | None,
    model: Path | None,
    figures: FigureFormat | None,
    span: Span,
    workers: Workers,
    terminal: Terminal,
) -> None:
    """Reconstruct trials, write a result directory for each, and print a summary.

    Args:
        trials: trial directories.
        method: see `estimator_of`.
        out: see `result_paths`.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        figures: format of the figures; None draws none.
        span: the part of each trial of which shapes are wanted.
        workers: the processes that do the work.
        terminal: for progress and tables.

    Raises:
        TensegraphError: when a result cannot be written; for a single trial, when it cannot be read.
        SystemExit: with 1 when some of several trials failed.
    """
    settings = read_settings(config)
    estimator_of(method)  # refused here if it is none, not by every worker
    options = RunOptions(method, settings, config, placed_model(model, workers), figures, span)
    paths = result_paths(trials, out, Path("results"), RESULT_FILES, "" if method == "batch" else f"_{method}")
    places = {str(trial): path for trial, path in zip(trials, paths, strict=True)}
    jobs = {name: TrialJob(workers.place(Path(name)), workers.place(path), options) for name, path in places.items()}
    many = Many(workers, terminal)
    for name, summary in many.each(reconstruct_trial, jobs, "trials"):
        if summary is None:
            terminal.written(f"up to date: {places[name]}")
        else:
            terminal.news.print(summary)
            terminal.written(f"written to {places[name]}")
    many.end()


def reconstruct_trial(job: TrialJob, terminal: Terminal) -> Table | None:
    """Reconstruct a trial, write its result and return the summary; None where the same result stands already.

    Raises:
        TensegraphError: when the trial cannot be read, or the result cannot be written.
    """
    options = job.options
    trial = open_trial(job.trial)
    inputs, parts = trial.hashes(), made_with(options.method, options.model, trial.plug_ins)
    made_from = options.fingerprint(inputs, parts)
    if is_up_to_date(job.out / RUN_FILE, made_from, relative_path(job.out, trial.path)):
        return None
    with rare_collections(), terminal.stages(trial.name, options.stages()) as bar:
        run = run_trial(trial, options, terminal, bar)
        with terminal.stage("tables and figures" if options.figures else "tables"):
            title = f"{trial.name}, {run.method}"
            table = run.as_table(job.out, inputs) | parts | options.span.as_table() | {FINGERPRINT: made_from}
            write_result(
                run.reconstruction,
                job.out,
                table,
                run.pipeline.settings,
                title,
                options.figures,
                lambda part: bar.reached(part, 1),
            )
    return run.summary()


def run_trial(trial: Trial, options: RunOptions, terminal: Terminal, bar: StageBar) -> "Run":
    """Return a trial's shapes, and show on a bar how far they are."""
    model = trained_model(trial.description, options.settings, options.model, options.config)
    with naming(trial.path), terminal.stage("rest shape"):
        pipeline = Pipeline(trial.description, options.settings, model)
    with naming(trial.path), terminal.stage("shapes"):
        start_s = time.perf_counter()
        readings = bar.track("lengths", trial.readings(), trial.row_count())
        ahead = OFFLINE_FRAMES if options.span.to_s is None else 1
        frames = options.span.until_end(pipeline.lengths(readings, ahead))
        # The estimator gets an iterator, which lets go of the list at its end: covariances need that memory.
        count, lengths = len(frames), iter(frames)
        del frames
        batch = options.method == "batch"
        progress = (lambda iteration, _: bar.iterated("optimisation", iteration)) if batch else None
        shapes = pipeline.shapes(lengths, options.method, progress)
        shapes = bar.track("ellipsoids" if batch else "shapes", shapes, count)
        wanted = (shape for shape in shapes if options.span.begins_by(shape.t_s))
        reconstruction = Reconstruction.of(trial.description.structure, wanted)
        seconds = time.perf_counter() - start_s
    return Run(
        trial=trial,
        method=options.method,
        pipeline=pipeline,
        reconstruction=reconstruction,
        frames=count,
        seconds=seconds,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The reconstruction of one trial."""

    trial: Trial
    method: str
    pipeline: Pipeline
    reconstruction: Reconstruction
    frames: int
    """Number of frames that were estimated, those before the span of the reconstruction, too."""
    seconds: float
    """Computing time from the first reading to the last shape."""

    def summary(self) -> Table:
        """Return the summary that is printed at the end of a run."""
        columns = (Column(overflow="fold"), Column(overflow="fold"))  # no word is cut off in a narrow terminal
        title = printable(f"{self.trial.name} ({self.method})")
        # This box looks the same when it comes from another process; rich does not recognise its default there.
        table = Table(*columns, title=title, title_justify="left", show_header=False, box=SQUARE)
        for name, text in self._facts():
            table.add_row(printable(name), printable(text))
        return table

    def _facts(self) -> Iterator[tuple[str, str]]:
        """Yield the names and the texts of the summary's rows."""
        r, pipeline = self.reconstruction, self.pipeline
        free = r.structure.free_nodes
        yield "frames", f"{len(r)}"
        yield "duration", f"{r.t_s[-1] - r.t_s[0]:.2f} s"
        yield "time", f"{1e3 * self.seconds / self.frames:.2f} ms per frame"
        yield "rest shape", rest_source(pipeline.rest, self.trial.description)
        if self.trial.description.source != "lengths" and self.trial.description.rest_seconds <= 0:
            yield "taring", "none: give rest.seconds, for which it stands at rest at the start"
        yield "mean sigma of a node", f"{1e3 * r.node_sigma_m[:, free].mean():.2f} mm"
        yield from rest_balance(pipeline.rest)
        yield from load_rows(r, pipeline.settings.load_threshold_n)
        if r.contacts is not None:
            yield "slips", slip_line(r.slides)
        if r.floor_normal is not None:
            yield "normal of the floor", normal_line(r.floor_normal)
        yield from ((f"frame of position {fit.recording}", fit.text()) for fit in pipeline.aids.own_frames.fits)
        yield from ((name, str(rows)) for name, rows in self._irregular_rows().items())
        yield from pipeline.warnings().items()
        yield from (("ignored in trial.toml", key) for key in self.trial.description.ignored_keys)
        yield from (
            (f"ignored in {name}", columns_text(columns)) for name, columns in self.trial.ignored_columns.items()
        )
        yield from (("no readings", text) for text in pauses(r.t_s))
        for status, frames in Counter(r.status).items():
            yield f"status {status}", f"{frames_text(frames)}: {status.advice}"
        two = Status.TWO_SHAPES
        if hidden := sum(other is not None for other in r.others) - r.status.count(two):
            yield f"worse, and {two}", f"{frames_text(hidden)}: {two.advice}"
        for reason, frames in Counter(filter(None, r.doubts)).items():
            yield f"doubt {reason}", f"{frames_text(frames)}: {reason.advice}"
        yield from pipeline.rest_complaints()
        yield from (("flagged", line) for line in flagged_sensors(r))
        yield from self._against_truth().items()

    def as_table(self, path: Path, inputs: Mapping[str, str]) -> dict[str, Any]:
        """Return run.toml: every setting, versions, input hashes, irregular rows, timing.

        Args:
            path: result directory, to which the path of the trial is relative.
            inputs: see `Trial.hashes`.
        """
        return {
            "trial": self.trial.name,
            "trial_path": relative_path(path, self.trial.path),
            "method": self.method,
            **self.pipeline.rest.as_table(),
            "frames": len(self.reconstruction),
            "versions": versions(),
            "inputs": inputs,
            "rows": self._irregular_rows(),
            **self.pipeline.aids.own_frames.as_table(),
            "settings": asdict(self.pipeline.settings),
            "timing": {"seconds": round(self.seconds, 3)},
        }

    def _against_truth(self) -> dict[str, str]:
        """Return the error of this run and that of the rest shape, if the trial has truth."""
        rest_m = np.broadcast_to(self.pipeline.rest.node_position_m, self.reconstruction.node_position_m.shape)
        at_rest = replace(self.reconstruction, node_position_m=rest_m)
        try:
            truth = self.trial.truth()
            if truth is None:
                return {}
            rmse_m = node_rmse_m(self.reconstruction, truth.t_s, truth.node_position_m)
            at_rest_rmse_m = node_rmse_m(at_rest, truth.t_s, truth.node_position_m)
        except InputError as error:
            return {"truth": f"not used: {error}"}
        return {
            "node RMSE": f"{1e3 * rmse_m:.2f} mm",
            "  of holding the rest shape": f"{1e3 * at_rest_rmse_m:.2f} mm",
        }

    def _irregular_rows(self) -> dict[str, int]:
        """Return the numbers of lost, dropped and incomplete rows, without those that are zero."""
        counts: dict[str, int] = {}
        for board, clock in enumerate(self.pipeline.boards.counts if self.pipeline.boards else ()):
            for name, n in asdict(clock).items():
                counts[f"board {board}: {name.replace('_', ' ')}"] = n if name != "rows" else 0
        counts |= self.pipeline.aid_counts() | self.pipeline.watch.factors.counts()
        counts |= position_counts(self.reconstruction.contradicted_positions)
        counts |= {"half lines": self.trial.half_lines, "dropped rows": self.trial.dropped_rows}
        return {name: n for name, n in counts.items() if n}
