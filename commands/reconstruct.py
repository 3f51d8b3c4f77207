"""`reconstruct`: makes results from recorded trials, with a summary on the screen and in run.toml."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from ..io.model_file import read_sensor_model
from ..io.provenance import relative_path, versions
from ..io.reports.terminal import Terminal
from ..io.result import RUN_FILE
from ..io.toml import read_settings
from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.metrics import node_rmse_m
from ..models.sensor.sensor_model import SensorModel
from ..models.settings import Settings
from ..models.structure.floor import EstimatedNormal
from ..models.structure.reconstruction import Reconstruction
from ..models.structure.rest_shape import RestShape, WrongPart
from ..models.values.errors import InputError
from ..models.values.readings import LEFT_OUT, SENSOR_FLAGS, Flag
from ..models.values.slip import Slip
from ..pipeline import Pipeline, write_result
from .paths import result_paths

LONG_S = 1.0
"""Total time under load above which a node is named in the summary."""


def reconstruct_trials(
    trials: Sequence[Path],
    method: str,
    *,
    out: Path | None,
    config: Path | None,
    model: Path | None,
    figures: bool,
    terminal: Terminal,
) -> None:
    """Reconstruct trials, write a result directory for each, and print a summary.

    Args:
        trials: trial directories.
        method: a name in `ESTIMATORS`.
        out: see `result_paths`.
        config: file of settings; defaults if None.
        model: sensor model; the one in the package if None.
        figures: whether to draw them.
        terminal: for progress and tables.

    Raises:
        TensegraphError: when a trial cannot be read, or a result cannot be written.
    """
    settings = read_settings(config)
    sensor_model = read_sensor_model(model)
    opened = [open_trial(path) for path in trials]
    for trial, path in zip(opened, result_paths(trials, out, Path("results"), RUN_FILE), strict=True):
        run = run_trial(trial, method, settings, sensor_model, terminal)
        with terminal.stage("tables and figures" if figures else "tables"):
            title = f"{trial.name}, {run.method}" if figures else None
            write_result(run.reconstruction, path, run.as_table(path), settings, title)
        terminal.news.print(run.summary())
        terminal.written(f"written to {path}")


def run_trial(trial: Trial, method: str, settings: Settings, model: SensorModel, terminal: Terminal) -> "Run":
    """Return a trial's shapes, with a progress bar over its readings."""
    with terminal.stage("rest shape"):
        pipeline = Pipeline(trial.description, settings, model)
    with terminal.stage("shapes"), terminal.progress() as progress:
        readings = progress.track(trial.readings(), total=trial.row_count(), description=trial.name)
        start_s = time.perf_counter()
        reconstruction = Reconstruction.of(trial.description.structure, pipeline.estimate(readings, method))
        seconds = time.perf_counter() - start_s
    return Run(
        trial=trial,
        method=method,
        settings=settings,
        pipeline=pipeline,
        reconstruction=reconstruction,
        seconds=seconds,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The reconstruction of one trial."""

    trial: Trial
    method: str
    settings: Settings
    pipeline: Pipeline
    reconstruction: Reconstruction
    seconds: float
    """Computing time from the first reading to the last shape."""

    def summary(self) -> Table:
        """Return the summary that is printed at the end of a run."""
        r = self.reconstruction
        free = r.structure.free_nodes
        table = Table(title=f"{self.trial.name} ({self.method})", show_header=False, title_justify="left")
        table.add_row("frames", f"{len(r)}")
        table.add_row("duration", f"{r.t_s[-1] - r.t_s[0]:.2f} s")
        table.add_row("time", f"{1e3 * self.seconds / len(r):.2f} ms per frame")
        table.add_row("rest shape", self.pipeline.rest.source)
        table.add_row("mean sigma of a node", f"{1e3 * r.node_sigma_m[:, free].mean():.2f} mm")
        for name, text in [*rest_balance(self.pipeline.rest), *load_rows(r, self.settings.load_threshold_n)]:
            table.add_row(name, text)
        if r.contacts is not None:
            table.add_row("slips", slip_line(r.slides))
        if r.floor_normal is not None:
            table.add_row("normal of the floor", normal_line(r.floor_normal))
        for fit in self.pipeline.own_frames.fits:
            table.add_row(f"frame of position {fit.recording}", fit.text())
        for name, rows in self._rows_not_plain().items():
            table.add_row(name, str(rows))
        for key in self.trial.description.ignored_keys:
            table.add_row("ignored in trial.toml", key)
        for k in np.flatnonzero(np.diff(r.t_s) > LONG_S):
            table.add_row("no readings", f"from {r.t_s[k]:.2f} to {r.t_s[k + 1]:.2f} s")
        for status, frames in Counter(r.status).items():
            table.add_row(f"status {status}", f"{frames} frames: {status.advice}")
        for reason, frames in Counter(filter(None, r.doubts)).items():
            table.add_row(f"doubt {reason}", f"{frames} frames: {reason.advice}")
        if self.pipeline.rest.wrong:
            table.add_row("geometry", wrong_geometry(self.pipeline.rest.wrong))
        for line in flagged_sensors(r):
            table.add_row("flagged", line)
        if self.pipeline.front_end.rest_in_doubt:
            table.add_row("rest in doubt", "most sensors do not fit the rest shape: was it still, and this structure?")
        if self.pipeline.front_end.moved_at_rest:
            table.add_row(
                "moved at rest", "the structure moved while its sensors were tared, sigmas are widened: tare again"
            )
        for a, b in self.pipeline.front_end.exchanged:
            table.add_row("wiring", f"the sensors of tendons {a} and {b} look exchanged: see tendon_of_channel")
        for name, error in self._against_truth().items():
            table.add_row(name, error)
        return table

    def as_table(self, path: Path) -> dict[str, Any]:
        """Return run.toml: every setting, versions, input hashes, irregular rows, timing.

        Args:
            path: result directory, to which the path of the trial is relative.
        """
        normal = self.reconstruction.floor_normal
        return {
            "trial": self.trial.name,
            "trial_path": relative_path(path, self.trial.path),
            "method": self.method,
            "rest_shape": self.pipeline.rest.source,
            "wrong_geometry": self.pipeline.rest.wrong or "none",
            "frames": len(self.reconstruction),
            **({"floor_normal": asdict(normal)} if normal else {}),
            "versions": versions(),
            "inputs": self.trial.hashes(),
            "rows": self._rows_not_plain(),
            **self.pipeline.own_frames.as_table(),
            "settings": asdict(self.settings),
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

    def _rows_not_plain(self) -> dict[str, int]:
        """Return the numbers of lost, dropped and incomplete rows, without those that are zero."""
        counts: dict[str, int] = {}
        for board, clock in enumerate(self.pipeline.boards.counts if self.pipeline.boards else ()):
            for name, n in asdict(clock).items():
                counts[f"board {board}: {name.replace('_', ' ')}"] = n if name != "rows" else 0
        counts |= self.pipeline.imu_gate.counts() | self.pipeline.winding.counts() | self.pipeline.own_frames.counts()
        counts |= {"half lines": self.trial.half_lines, "dropped rows": self.trial.dropped_rows}
        return {name: n for name, n in counts.items() if n}


def wrong_geometry(wrong: WrongPart) -> str:
    """Return what the evidence at rest says of the geometry that was told, and what to do."""
    used = "those estimated are used" if wrong in ("rods", "anchors") else "sigmas are widened"
    told = {
        "rods": "the rods have other lengths than trial.toml tells",
        "anchors": "the anchors are elsewhere than trial.toml tells",
        "rest shape": "the measured rest shape does not balance: was it measured in this state?",
        "hubs": "the tendons seem to end beside the ends of the rods: tell structure.hub_radius_m",
    }
    return f"{told[wrong]}; {used}"


def rest_balance(rest: RestShape) -> list[tuple[str, str]]:
    """Return the imbalance of forces at rest, if the stiffness is known."""
    if rest.mechanics is None:
        return []
    nominal_n, tared_n = rest.unbalanced_n
    return [("forces at rest", f"{nominal_n:.3f} N rms unbalanced as given, {tared_n:.3f} N after taring")]


def load_rows(r: Reconstruction, threshold_n: float) -> list[tuple[str, str]]:
    """Return the largest load, and the nodes that were loaded longer than `LONG_S`."""
    if r.loads is None:
        return []
    load_n = np.nan_to_num(np.linalg.norm(r.loads.force_n, axis=-1))
    k, node = np.unravel_index(load_n.argmax(), load_n.shape)
    step_s = float(np.median(np.diff(r.t_s))) if len(r) > 1 else 0.0
    loaded_s = step_s * (load_n > threshold_n).sum(axis=0)
    long = [f"{node} ({loaded_s[node]:.1f} s)" for node in np.flatnonzero(loaded_s > LONG_S)]
    return [
        ("largest load", f"{load_n[k, node]:.2f} N at node {node}, t = {r.t_s[k]:.2f} s"),
        (f"nodes above {threshold_n:g} N for {LONG_S:g} s", ", ".join(long) or "none"),
    ]


def normal_line(normal: EstimatedNormal) -> str:
    """Return the estimated normal, how far it is from the vertical, and its standard deviation."""
    x, y, z = normal.direction
    tilt, sigma = np.rad2deg([np.arccos(min(z, 1.0)), normal.sigma_rad])
    return f"[{x:.4f}, {y:.4f}, {z:.4f}], {tilt:.2f} ± {sigma:.2f} degrees from the vertical"


def slip_line(slides: Sequence[Slip]) -> str:
    """Return how often nodes slipped on the floor, which, and how far at most."""
    if not slides:
        return "none"
    furthest = max(slides, key=lambda slip: slip.distance_m)
    nodes = ", ".join(str(node) for node in sorted({slip.node for slip in slides}))
    distance = f"{1e3 * furthest.distance_m:.0f} ± {1e3 * furthest.sigma_m:.0f} mm"
    return f"{len(slides)}, of node {nodes}; at most {distance}, node {furthest.node} at t = {furthest.t_s:.2f} s"


def flagged_sensors(r: Reconstruction) -> list[str]:
    """Return one line for each group of sensors with the same flags: tendons, flags, first times, frames left out."""
    tendons: dict[str, list[str]] = {}
    for e in np.flatnonzero((r.flags & SENSOR_FLAGS).any(axis=0)):
        seen = {flag: np.flatnonzero(r.flags[:, e] & flag) for flag in SENSOR_FLAGS}
        parts = [
            f"{flag.names()} from {r.t_s[frames[0]]:.2f} s"
            for flag, frames in seen.items()
            if len(frames) and flag != Flag.MISSING
        ]
        left_out = np.flatnonzero(r.flags[:, e] & LEFT_OUT)
        if len(left_out):
            parts.append(f"left out of {len(left_out)} frames from {r.t_s[left_out[0]]:.2f} s")
        tendons.setdefault(", ".join(parts), []).append(str(e))
    return [f"tendon {', '.join(names)}: {text}" for text, names in tendons.items()]
