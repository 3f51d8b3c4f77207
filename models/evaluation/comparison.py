"""The comparison of methods, as in the paper's Table I."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .consistency import coverage
from .evaluation import Evaluation, ShapeErrors
from .metrics import errors_of, shape_errors

ALL = "all"
"""Name of the trial in a row over all trials."""


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """The results of one method on one trial or on all trials; nan where a value is not known."""

    trial: str
    """Name of the trial, or `ALL`."""
    method: str
    trials: int
    """Number of trials that the method finished."""
    frames: int
    """Number of frames of these trials."""
    errors: ShapeErrors
    coverage_95: float
    """Share of the pairs (frame, free node) in which the 95 % ellipsoid contains the true position."""
    median_sigma_m: float
    """Median over frames and free nodes of the square root of the trace of the node's covariance."""
    wrong_branch_share: float
    """Share of the compared frames whose shape is on the wrong branch."""
    ms_per_frame: float
    """Time of the estimator alone, from lengths to shape and covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameErrors:
    """The values of each compared frame from which the row of a comparison is computed."""

    node_error_m: NDArray[np.float64]
    """(frames, free nodes, 3) estimated minus true position."""
    face_error_m: NDArray[np.float64]
    """(frames, faces, 3) estimated minus true centre of each face."""
    nees: NDArray[np.float64]
    """(frames, free nodes) e^T P^-1 e."""
    node_sigma_m: NDArray[np.float64]
    """(frames, free nodes) square root of the trace of the node's covariance."""
    wrong_branch: NDArray[np.bool_] | None
    """(frames,) see `ComparedFrames`; None when the length Jacobian is not square."""

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """Return the values of an evaluation."""
        frames = evaluation.compared
        return cls(
            node_error_m=frames.node_error_m,
            face_error_m=frames.face_error_m,
            nees=frames.nees,
            node_sigma_m=frames.node_sigma_m,
            wrong_branch=frames.wrong_branch,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The result of one method on one trial."""

    trial: str
    method: str
    frames: int
    seconds: float
    """Computing time; nan when nothing was run."""
    errors: FrameErrors | None
    """Errors; None when the method failed."""
    note: str = ""
    """Reason why there are no errors."""

    def line(self) -> str:
        """Return a summary in one line."""
        parts = [f"{self.trial}, {self.method}:"]
        if self.errors:
            parts.append(f"node RMSE {1e3 * errors_of(self.errors.node_error_m.reshape(-1, 3)).rmse_m:.2f} mm")
        if np.isfinite(self.seconds):
            parts.append(f"{1e3 * self.seconds / self.frames:.2f} ms per frame")
        return " ".join([*parts, self.note]).rstrip()


def comparison_row(trial: str, measured: Sequence[Measured]) -> ComparisonRow:
    """Return the row of one method on some trials; all frames and nodes have the same weight."""
    compared = [m.errors for m in measured if m.errors]
    none = np.empty((0, 3))
    sigma_m = np.concatenate([none.ravel(), *(c.node_sigma_m[~np.isnan(c.nees)] for c in compared)])
    branches = [c.wrong_branch for c in compared if c.wrong_branch is not None]
    timed = [m for m in measured if np.isfinite(m.seconds)]
    seconds = sum(m.seconds for m in timed)
    timed_frames = sum(m.frames for m in timed)
    return ComparisonRow(
        trial=trial,
        method=measured[0].method,
        trials=len(compared),
        frames=sum(m.frames for m in measured if m.errors),
        errors=shape_errors(
            np.concatenate([none, *(c.node_error_m.reshape(-1, 3) for c in compared)]),
            np.concatenate([none, *(c.face_error_m.reshape(-1, 3) for c in compared)]),
        ),
        coverage_95=coverage(np.concatenate([none.ravel(), *(c.nees.ravel() for c in compared)]), 0.95),
        median_sigma_m=float(np.median(sigma_m)) if len(sigma_m) else np.nan,
        wrong_branch_share=float(np.mean(np.concatenate(branches))) if branches else np.nan,
        ms_per_frame=1e3 * seconds / timed_frames if timed else np.nan,
    )


@dataclass(frozen=True, slots=True)
class Spread:
    """How the results of one method differ from trial to trial; each trial has the same weight."""

    method: str
    trials: int
    """Number of trials that the method finished."""
    rmse_mean_m: float
    """Mean over the trials of the RMSE of the free nodes."""
    rmse_spread_m: float
    """Standard deviation over the trials of the RMSE; nan for a single trial."""
    rmse_worst_m: float
    worst_trial: str
    """The trial with the largest RMSE."""
    coverage_mean: float
    """Mean over the trials of `coverage_95`; nan without covariances, like those below."""
    coverage_spread: float
    coverage_worst: float
    """Least coverage of a trial."""
    least_covered_trial: str
    """The trial with the least coverage."""


def spreads(rows: Sequence[ComparisonRow]) -> list[Spread]:
    """Return the spread of each method over the rows of single trials; methods without any truth are left out."""
    known = [row for row in rows if row.trial != ALL and np.isfinite(row.errors.nodes.rmse_m)]
    methods = dict.fromkeys(row.method for row in known)
    return [_spread(method, [row for row in known if row.method == method]) for method in methods]


def _spread(method: str, rows: Sequence[ComparisonRow]) -> Spread:
    rmse_m = np.array([row.errors.nodes.rmse_m for row in rows])
    covered = [row for row in rows if np.isfinite(row.coverage_95)]
    coverage_95 = np.array([row.coverage_95 for row in covered])
    worst = int(np.argmax(rmse_m))
    return Spread(
        method=method,
        trials=len(rows),
        rmse_mean_m=float(rmse_m.mean()),
        rmse_spread_m=float(rmse_m.std(ddof=1)) if len(rows) > 1 else np.nan,
        rmse_worst_m=float(rmse_m[worst]),
        worst_trial=rows[worst].trial,
        coverage_mean=float(coverage_95.mean()) if covered else np.nan,
        coverage_spread=float(coverage_95.std(ddof=1)) if len(covered) > 1 else np.nan,
        coverage_worst=float(coverage_95.min()) if covered else np.nan,
        least_covered_trial=covered[int(np.argmin(coverage_95))].trial if covered else "",
    )


@dataclass(frozen=True, slots=True)
class Published:
    """A row of the paper's Table I, for another robot, other conditions, and the definitions of its authors."""

    source: str
    node_mm: float
    faces_mm: float = np.nan
    system_mm: float = np.nan


PUBLISHED = (
    Published("Caluwaerts et al.", 45.6),
    Published("Booth et al.", 32.3, system_mm=45.8),
    Published("Mao et al.", 21.2, 35.8, 39.4),
)
"""Published errors: the 35.8 mm for faces are from the paper's text, the others from its Table I."""
