"""Methods side by side, as in the paper's Table I."""

from dataclasses import dataclass

import numpy as np

from .evaluation import ShapeErrors

ALL = "all"
"""The trial of a row over all trials together."""


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One method on one trial, or on all of them together; nan is not known."""

    trial: str
    """Its name, or `ALL`."""
    method: str
    trials: int
    """How many of them had truth and were finished."""
    frames: int
    errors: ShapeErrors
    coverage_95: float
    """Share of (frame, free node) whose ellipsoid of 95 % holds the truth."""
    median_sigma_m: float
    """Of the free nodes, root of the trace of the covariance."""
    wrong_branch_share: float
    """Of the compared frames."""
    ms_per_frame: float
    """Of the estimator alone, from lengths to shape and covariance."""


@dataclass(frozen=True, slots=True)
class Published:
    """A row of the paper's Table I: another robot, under other conditions, by its authors' own definitions."""

    source: str
    node_mm: float
    faces_mm: float = np.nan
    system_mm: float = np.nan


PUBLISHED = (
    Published("Caluwaerts et al.", 45.6),
    Published("Booth et al.", 32.3, system_mm=45.8),
    Published("Mao et al.", 21.2, 35.8, 39.4),
)
"""The paper's text gives its 35.8 mm for faces; Table I has the others."""
