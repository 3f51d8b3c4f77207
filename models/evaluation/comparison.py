"""The comparison of methods, as in the paper's Table I."""

from dataclasses import dataclass

import numpy as np

from .evaluation import ShapeErrors

ALL = "all"
"""Name of the trial in a row over all trials."""


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """The results of one method on one trial or on all trials; nan where a value is not known."""

    trial: str
    """Name of the trial, or `ALL`."""
    method: str
    trials: int
    """Number of trials that have truth and were finished."""
    frames: int
    errors: ShapeErrors
    coverage_95: float
    """Share of the pairs (frame, free node) in which the 95 % ellipsoid contains the true position."""
    median_sigma_m: float
    """Median over frames and free nodes of the square root of the trace of the node's covariance."""
    wrong_branch_share: float
    """Share of the compared frames whose shape is on the wrong branch."""
    ms_per_frame: float
    """Time of the estimator alone, from lengths to shape and covariance."""


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
