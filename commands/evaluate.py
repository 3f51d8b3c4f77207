"""A result against the truth: finds what belongs to it, and says what came out, as a table and for machines."""

import json
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Table

from ..estimator.rest_step import rest_step
from ..io.figures.evaluation_figures import write_errors_figure, write_heights_figure, write_loads_figure
from ..io.positions import read_positions
from ..io.result import RUN_FILE, read_estimate, read_run, result_directory
from ..io.trial_directory import Trial, open_trial
from ..models.evaluation.evaluation import Errors, Evaluation, FaultScore, Regime
from ..models.evaluation.load_score import CLEAR_LOAD_N
from ..models.evaluation.metrics import evaluate
from ..models.evaluation.truth import Truth
from ..models.settings import Settings
from ..models.values.errors import InputError
from ..models.values.tables import parse_table

EVALUATION_FILE = "evaluation.json"


@dataclass(frozen=True, slots=True, eq=False)
class ScoredResult:
    """One result, evaluated."""

    result: Path
    trial: str
    method: str
    evaluation: Evaluation

    def title(self) -> str:
        """Return what was evaluated, in few words."""
        return f"{self.trial}, {self.method}"

    def as_table(self) -> Group:
        """Return the tables for the terminal."""
        e = self.evaluation
        errors = Table(self.title(), "RMSE, mm", "of height, mm", "median, mm", "95 % below, mm")
        for kind, of in (("", e.absolute), ("displacement of ", e.displacement)):
            for name in ("nodes", "faces", "system") if of is not None else ():
                errors.add_row(kind + name, *_millimetres(getattr(of, name)))
        regimes = Table("frames", "", "RMSE, mm", "NEES", "in 68 %", "in 95 %", "median sigma, mm")
        for regime in e.regimes:
            regimes.add_row(regime.name, str(regime.frames), *_regime_cells(regime))
        facts = Table(show_header=False)
        for name, text in _facts(e):
            facts.add_row(name, text)
        return Group(errors, regimes, facts)

    def as_json(self) -> dict[str, Any]:
        """Return all numbers of the evaluation; what is not known is null."""
        numbers = _plain(self.evaluation)
        assert isinstance(numbers, dict)
        free_nodes = self.evaluation.structure.free_nodes.tolist()
        names = {"result": str(self.result), "trial": self.trial, "method": self.method, "free_nodes": free_nodes}
        return names | numbers


def write_score(score: ScoredResult, path: Path) -> None:
    """Write an evaluation directory, its numbers and figures, whole or not at all."""
    with result_directory(path, EVALUATION_FILE) as directory:
        (directory / EVALUATION_FILE).write_text(as_text(score.as_json()), encoding="utf-8")
        write_heights_figure(score.evaluation, score.title(), directory / "heights.png")
        write_errors_figure(score.evaluation, score.title(), directory / "errors.png")
        if score.evaluation.loads:
            write_loads_figure(score.evaluation, score.title(), directory / "loads.png")


def as_text(numbers: object) -> str:
    """Return JSON."""
    return json.dumps(numbers, indent=2, allow_nan=False) + "\n"


def score_result(path: Path, truth: Path | None, trial: Path | None, *, align: bool) -> ScoredResult:
    """Evaluate a result directory.

    Args:
        path: of the result.
        truth: a file of stamped node positions; that of the trial if None.
        trial: the trial's directory; where run.toml says if None.
        align: see `evaluate`.

    Raises:
        InputError: when the result, its trial or the truth can not be read, or do not belong together.
    """
    run = read_run(path)
    opened = _trial_of(run, path, trial)
    structure = opened.description.structure
    times_and_positions = opened.truth() if truth is None else read_positions(truth, structure.node_count)
    if times_and_positions is None:
        raise InputError(f"{opened.path}: has no truth: expected [truth] in trial.toml, or --truth FILE")
    settings = parse_table(Settings, run.get("settings", {}), str(path / RUN_FILE))
    description = opened.description
    rest = rest_step(structure, description.mechanics, description.rest_position_m, settings.rest)
    known = Truth(*times_and_positions, description.rest_seconds, opened.faults(), opened.true_loads())
    estimate = read_estimate(path, structure)
    try:
        evaluation = evaluate(
            structure,
            rest.node_position_m,
            estimate,
            known,
            align=align,
            load_threshold_n=settings.load_threshold_n,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return ScoredResult(path, opened.name, str(run.get("method", "method not stated")), evaluation)


def _trial_of(run: dict[str, Any], path: Path, trial: Path | None) -> Trial:
    if trial is None and not isinstance(run.get("trial_path"), str):
        raise InputError(f"{path / RUN_FILE}: trial_path: is missing: expected --trial DIRECTORY instead")
    opened = open_trial(trial or path / run["trial_path"])
    for name, digest in opened.hashes().items():
        if "inputs" in run and run["inputs"].get(name) != digest:
            raise InputError(f"{opened.path / name}: is not what {path} was made from: expected --trial DIRECTORY")
    return opened


def _facts(e: Evaluation) -> list[tuple[str, str]]:
    """Return name and text of everything that is not a distance."""
    c = e.consistency
    inside = int(((c.nees >= c.nees_band[:, 0]) & (c.nees <= c.nees_band[:, 1])).sum())
    worst_mm = 1e3 * np.nanmax(e.node_rmse_m)
    rows = [
        ("frames compared", f"{e.frames}, and {e.frames_without_truth} without truth"),
        ("worst node", f"{e.worst_node}: RMSE {worst_mm:.2f} mm"),
        ("first good shape (5 mm)", "none" if e.first_good_s is None else f"after {e.first_good_s:.2f} s"),
    ]
    if e.rotation_deg is not None:
        rows.append(("truth aligned", f"turned by {e.rotation_deg:.2f} degrees"))
    if e.wrong_branch_frames is not None:
        rows.append(("on the wrong branch", f"{e.wrong_branch_frames} frames"))
    if np.isfinite(c.median_sigma_m):
        rows += [
            (
                "within ellipsoids of 50, 68, 95 %",
                f"{c.coverage_50:.1%}, {c.coverage_68:.1%}, {c.coverage_95:.1%} "
                f"at a median sigma of {1e3 * c.median_sigma_m:.2f} mm",
            ),
            (
                "NEES of a node (3 is right)",
                f"{np.nanmin(c.nees):.2f} to {np.nanmax(c.nees):.2f}; {inside} of {len(c.nees)} in their 95 % band",
            ),
        ]
    if np.isfinite(c.nis):
        band = f"95 % band {c.nis_band[0]:.2f} to {c.nis_band[1]:.2f}"
        rows.append(("NIS of the lengths (1 is right)", f"{c.nis:.2f}; {band}"))
    rows += _load_facts(e)
    rows += [(f"fault: {fault.kind}, {fault.where}", _seen(fault)) for fault in e.faults]
    rows.append(("false alarms", f"{e.false_alarm_share:.2%} of the healthy readings"))
    return rows


def _load_facts(e: Evaluation) -> list[tuple[str, str]]:
    score = e.loads
    if score is None:
        return []
    facts = {
        f"RMSE of loads above {score.threshold_n:g} N": _cell(score.loaded_rmse_n, "{:.3f} N"),
        "  of the others": _cell(score.unloaded_rmse_n, "{:.3f} N"),
        f"loads above {score.threshold_n:g} N that are seen": _cell(score.recall, "{:.1%}"),
        "  seen, and true": _cell(score.precision, "{:.1%}"),
        "  unloaded, called loaded": (
            f"{_cell(score.false_alarm_share, '{:.1%}')}; "
            f"{_cell(score.quiet_false_alarm_share, '{:.1%}')} while no node is loaded"
        ),
        f"most loaded node (above {CLEAR_LOAD_N:g} N)": (
            _cell(score.most_loaded_share, f"the right one in {{:.1%}} of {score.clear_frames} frames")
        ),
    }
    return list(facts.items())


def _regime_cells(regime: Regime) -> list[str]:
    return [
        _cell(1e3 * regime.node_rmse_m, "{:.2f}"),
        _cell(regime.nees, "{:.2f}"),
        _cell(regime.coverage_68, "{:.1%}"),
        _cell(regime.coverage_95, "{:.1%}"),
        _cell(1e3 * regime.median_sigma_m, "{:.2f}"),
    ]


def _cell(value: float, form: str) -> str:
    return form.format(value) if np.isfinite(value) else "-"


def _seen(fault: FaultScore) -> str:
    named = "seen" if fault.tendons == 1 else f"all {fault.tendons} tendons seen"
    if fault.delay_s is not None:
        return f"{named} after {fault.delay_s:.2f} s"
    return "not seen" if fault.tendons == 1 else f"{fault.named} of {fault.tendons} tendons seen"


def _millimetres(errors: Errors) -> list[str]:
    values = (errors.rmse_m, errors.height_rmse_m, errors.median_m, errors.percentile_95_m)
    return [_cell(1e3 * value, "{:.2f}") for value in values]


def _plain(value: object) -> object:
    """Return dataclasses as mappings, arrays as lists, and what is not finite as None; frame by frame data stay out."""
    if is_dataclass(value):
        names = [field.name for field in fields(value) if field.name not in ("structure", "compared")]
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
