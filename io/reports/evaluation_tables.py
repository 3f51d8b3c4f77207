"""An evaluation as tables for the screen, and as numbers for machines."""

import json
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Table

from ...models.evaluation.evaluation import Consistency, Errors, Evaluation, FaultScore, PoseScore, Regime
from ...models.evaluation.load_score import CLEAR_LOAD_N
from ...models.evaluation.marker_assignment import largest_reach_m
from ...models.evaluation.truth import CaptureFit
from ...models.structure.structure import Structure
from .cells import or_dash

FAR_OFF = 0.05
"""Distance of an anchor in the truth from where it is told, in rod lengths, above which it is another place."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredResult:
    """One result with its evaluation."""

    result: Path
    """Directory of the result."""
    trial: str
    """Name of the trial."""
    method: str
    """Method that made the result."""
    evaluation: Evaluation
    """Evaluation of the result."""
    skipped_frames: int = 0
    """Number of frames that a live run left out because it was late; they are in no number of the evaluation."""

    def title(self) -> str:
        """Return trial and method, as a title."""
        return f"{self.trial}, {self.method}"

    def as_table(self) -> Group:
        """Return the tables for the terminal."""
        e = self.evaluation
        errors = Table(self.title(), "RMSE, mm", "of height, mm", "median, mm", "95 % below, mm")
        for kind, shape_errors in (("", e.absolute), ("displacement of ", e.displacement)):
            for name in ("nodes", "faces", "system") if shape_errors is not None else ():
                errors.add_row(kind + name, *_millimetres(getattr(shape_errors, name)))
        regimes = Table("frames", "", "RMSE, mm", "NEES", "in 68 %", "in 95 %", "median sigma, mm")
        for regime in e.regimes:
            if regime.frames:
                regimes.add_row(regime.name, str(regime.frames), *_regime_cells(regime))
        facts = Table(show_header=False)
        if self.skipped_frames:
            facts.add_row("skipped", f"{self.skipped_frames} frames, because the run was late")
        for name, text in _facts(e):
            facts.add_row(name, text)
        return Group(errors, *([regimes] if regimes.row_count else []), facts)

    def as_json(self) -> dict[str, Any]:
        """Return all numbers of the evaluation; what is not known is null."""
        numbers = _plain(self.evaluation)
        assert isinstance(numbers, dict)
        free_nodes = self.evaluation.structure.free_nodes.tolist()
        names = {"result": str(self.result), "trial": self.trial, "method": self.method, "free_nodes": free_nodes}
        return names | {"skipped_frames": self.skipped_frames} | numbers


def as_text(numbers: object) -> str:
    """Return numbers as JSON, indented, with a line end; not a number is an error."""
    return json.dumps(numbers, indent=2, allow_nan=False) + "\n"


def _facts(e: Evaluation) -> list[tuple[str, str]]:
    """Return name and text of everything that is not a distance."""
    worst_mm = 1e3 * np.nanmax(e.node_rmse_m)
    rows = [
        ("frames compared", f"{e.frames}, and {e.frames_without_truth} without truth"),
        ("worst node", f"{e.worst_node}: RMSE {worst_mm:.2f} mm"),
        ("first good shape (5 mm)", "none" if e.first_good_s is None else f"after {e.first_good_s:.2f} s"),
    ]
    if e.in_body:
        rows.append(("truth laid onto each frame", "the shape is in body coordinates; errors are of the shape alone"))
    if e.rotation_deg is not None:
        rows.append(("truth aligned", f"turned by {e.rotation_deg:.2f} degrees"))
    rows += _anchor_facts(e)
    rows += _capture_facts(e.capture, e.structure) if e.capture else []
    if np.isfinite(e.other_offset_s):
        rows.append(
            ("clock of the truth", f"its motion fits best with --offset {e.other_offset_s:+.2f}: is it another?")
        )
    if e.wrong_branch_frames is not None:
        rows.append(("on the wrong branch", f"{e.wrong_branch_frames} frames"))
    rows += _pose_facts(e.pose, in_body=e.in_body) if e.pose else []
    rows += _consistency_facts(e.consistency)
    rows += _load_facts(e)
    rows += [(f"fault: {fault.kind}, {fault.where}", _seen(fault)) for fault in e.faults]
    rows.append(("false alarms", f"{or_dash(e.false_alarm_share, '{:.2%}')} of the healthy readings"))
    return rows


def _anchor_facts(e: Evaluation) -> list[tuple[str, str]]:
    """Return what tells a truth in other axes, of other nodes or of another robot: anchors far from their places."""
    question = "other axes, or nodes? See --align" if e.rotation_deg is None else "other nodes, or mirrored axes?"
    return [
        (f"anchor {node} of the truth", f"{1e3 * m:.0f} mm from where trial.toml says: {question}")
        for node, m in zip(e.structure.anchors, e.anchors_apart_m, strict=True)
        if m > FAR_OFF * e.structure.rod_length_m.mean()
    ]


def _capture_facts(c: CaptureFit, structure: Structure) -> list[tuple[str, str]]:
    clock = c.clock
    told = f"offset {clock.offset_s:.4f} s, as given"
    if clock.offset_sigma_s > 0:
        told = (
            f"offset {clock.offset_s:.4f} s, sigma {1e3 * clock.offset_sigma_s:.0f} ms; "
            f"rate {clock.rate_ppm:+.0f} ppm, sigma {clock.rate_sigma_ppm:.0f} ppm"
        )
    fit = f"fit to {or_dash(1e3 * c.misfit_m, '{:.2f} mm rms')}"
    if c.found:
        fit = f"assigned by the best {fit}, the next {or_dash(1e3 * c.next_misfit_m, '{:.2f} mm')}"
    elif c.misfit_m > largest_reach_m(structure):
        fit += ", far off: are they assigned rightly, or its axes mirrored?"
    markers = ", ".join(f"{mark.marker} = {mark.node}" for mark in c.markers)
    ignored = f"; ignored: {', '.join(c.ignored)}" if c.ignored else ""
    rows = [("clock of the capture", told), ("markers = nodes", f"{fit}: {markers}{ignored}")]
    return [*rows, ("markers of a rod", _beyond_nodes(c))] if np.isfinite(c.farther_apart_m) else rows


def _beyond_nodes(c: CaptureFit) -> str:
    """Return by which `beyond_m` the markers of a rod are farther apart than it is long."""
    equals = "larger by" if any(mark.beyond_m for mark in c.markers) else "="
    return (
        f"{1e3 * c.farther_apart_m:.1f} mm farther apart than it is long, on average: "
        f"beyond_m {equals} {0.5 * c.farther_apart_m:.3f} in [truth.markers] would explain it"
    )


def _pose_facts(p: PoseScore, *, in_body: bool) -> list[tuple[str, str]]:
    rows = [
        (
            "shape alone (best rigid fit)",
            f"RMSE {or_dash(1e3 * p.shape_rmse_m, '{:.2f} mm')}, "
            f"{or_dash(p.shape_rmse_m / p.held_rmse_m, '{:.2f}')} of holding the rest shape",
        )
    ]
    if in_body:
        return rows
    rows += [
        ("shape and tilt (best turn about z)", f"RMSE {1e3 * p.level_rmse_m:.2f} mm"),
        (
            "tilt",
            f"{p.tilt_rms_deg:.2f} degrees rms, {or_dash(p.still_tilt_rms_deg, '{:.2f}')} while still",
        ),
        (
            "centroid",
            f"RMSE {1e3 * p.centroid_rmse_m:.1f} mm; at the end {or_dash(100 * p.drift_share, '{:.2f} %')} "
            f"of a path of {p.path_m:.2f} m, heading {p.heading_error_deg:+.1f} degrees",
        ),
    ]
    if p.contacts is not None:
        c = p.contacts
        for name, precision, recall in (
            ("contacts", c.precision, c.recall),
            ("  while still", c.still_precision, c.still_recall),
            ("  while moving", c.moving_precision, c.moving_recall),
        ):
            rows.append((name, f"precision {or_dash(precision, '{:.1%}')}, recall {or_dash(recall, '{:.1%}')}"))
    return rows


def _consistency_facts(c: Consistency) -> list[tuple[str, str]]:
    rows = []
    if np.isfinite(c.median_sigma_m):
        inside = int(((c.nees >= c.nees_band[:, 0]) & (c.nees <= c.nees_band[:, 1])).sum())
        scored = int((~np.isnan(c.nees)).sum())
        rows += [
            (
                "within ellipsoids of 50, 68, 95 %",
                f"{c.coverage_50:.1%}, {c.coverage_68:.1%}, {c.coverage_95:.1%} "
                f"at a median sigma of {1e3 * c.median_sigma_m:.2f} mm",
            ),
            ("ok, and outside of 99.9 %", f"{c.ok_outside_999:.2%} of the frames and nodes"),
            (
                "NEES of a node (3 is right)",
                f"{np.nanmin(c.nees):.2f} to {np.nanmax(c.nees):.2f}; {inside} of {scored} in their 95 % band",
            ),
        ]
    if np.isfinite(c.nis):
        band = f"95 % band {c.nis_band[0]:.2f} to {c.nis_band[1]:.2f}"
        rows.append(("NIS of the lengths (1 is right)", f"{c.nis:.2f}; {band}"))
    return rows


def _load_facts(e: Evaluation) -> list[tuple[str, str]]:
    score = e.loads
    if score is None:
        return []
    facts = {
        f"RMSE of loads above {score.threshold_n:g} N": or_dash(score.loaded_rmse_n, "{:.3f} N"),
        "  of the others": or_dash(score.unloaded_rmse_n, "{:.3f} N"),
        f"loads above {score.threshold_n:g} N that are seen": or_dash(score.recall, "{:.1%}"),
        "  of those seen, true": or_dash(score.precision, "{:.1%}"),
        "  unloaded, called loaded": (
            f"{or_dash(score.false_alarm_share, '{:.1%}')}; "
            f"{or_dash(score.quiet_false_alarm_share, '{:.1%}')} while no node is loaded"
        ),
        f"most loaded node (above {CLEAR_LOAD_N:g} N)": (
            or_dash(score.most_loaded_share, f"the right one in {{:.1%}} of {score.clear_frames} frames")
        ),
    }
    return list(facts.items())


def _regime_cells(regime: Regime) -> list[str]:
    return [
        or_dash(1e3 * regime.node_rmse_m, "{:.2f}"),
        or_dash(regime.nees, "{:.2f}"),
        or_dash(regime.coverage_68, "{:.1%}"),
        or_dash(regime.coverage_95, "{:.1%}"),
        or_dash(1e3 * regime.median_sigma_m, "{:.2f}"),
    ]


def _seen(fault: FaultScore) -> str:
    named = "seen" if fault.tendons == 1 else f"all {fault.tendons} tendons seen"
    if fault.delay_s is not None:
        return f"{named} after {fault.delay_s:.2f} s"
    return "not seen" if fault.tendons == 1 else f"{fault.named} of {fault.tendons} tendons seen"


def _millimetres(errors: Errors) -> list[str]:
    values = (errors.rmse_m, errors.height_rmse_m, errors.median_m, errors.percentile_95_m)
    return [or_dash(1e3 * value, "{:.2f}") for value in values]


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
