"""What is said of an estimate against the truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure


@dataclass(frozen=True, slots=True)
class Errors:
    """Of many points, in metres; 3-D but for the height, and nan of no points."""

    rmse_m: float
    """Root of the mean of |error|^2."""
    height_rmse_m: float
    """Root of the mean of the squared error of z."""
    median_m: float
    """Of |error|."""
    percentile_95_m: float
    """Of |error|."""


@dataclass(frozen=True, slots=True)
class ShapeErrors:
    """The paper's three figures, each over all compared frames."""

    nodes: Errors
    """Of the free nodes."""
    faces: Errors
    """Of the centres of the faces, the triangles closed by three tendons."""
    system: Errors
    """Of the free nodes and the centres of the faces together (the paper gives no definition)."""


@dataclass(frozen=True, slots=True, eq=False)
class Consistency:
    """Whether errors are as large as the covariances say."""

    nees: NDArray[np.float64]
    """(free nodes,) mean over the frames of e^T P^-1 e: 3 is right, more is overconfident."""
    nees_band: NDArray[np.float64]
    """(free nodes, 2) where 95 % of such means lie: chi-square with 3 N, over N, see `independent_frames`."""
    independent_frames: NDArray[np.float64]
    """(free nodes,) N: the frames over the time for which a node's NEES stays like itself (its autocorrelation)."""
    coverage_50: float
    """Share of (frame, free node) whose ellipsoid of 50 % holds the truth."""
    coverage_68: float
    coverage_95: float
    median_sigma_m: float
    """Of the free nodes, root of the trace of the covariance: what a coverage is worth."""
    nis: float
    """Mean of ((measured - predicted length) / its sigma)^2 over frames and tendons that others check: 1 is right."""
    nis_band: tuple[float, float]
    """Where 95 % of such means lie: chi-square with N degrees, over N, N summed over the tendons."""


@dataclass(frozen=True, slots=True)
class Regime:
    """Errors, and whether they are as large as the covariances say, in frames of one kind; nan of no frames."""

    name: str
    """`quiet`: no true load above the threshold at any node; `loaded`: the others; `slack`: some tendon, as measured,
    is bent or may be, loaded or not."""
    frames: int
    node_rmse_m: float
    nees: float
    """Mean over frames and free nodes: 3 is right."""
    coverage_68: float
    coverage_95: float
    median_sigma_m: float


@dataclass(frozen=True, slots=True)
class LoadScore:
    """Estimated loads against true ones, as far as the balance of forces shows these; nan of no loads."""

    threshold_n: float
    """A node with a larger load is loaded."""
    loaded_rmse_n: float
    """Root of the mean of |error|^2 (3-D) over (frame, free node) that truly are loaded."""
    unloaded_rmse_n: float
    """Over all others."""
    recall: float
    """Share of the truly loaded (frame, free node) that are called loaded."""
    precision: float
    """Share of those called loaded that are."""
    false_alarm_share: float
    """Of the (frame, free node) that truly are not loaded, the share called loaded."""
    quiet_false_alarm_share: float
    """The same in frames in which no node is loaded."""
    clear_frames: int
    """Frames with a true load above 0.3 N."""
    most_loaded_share: float
    """Of these, in how many the largest estimated load is at the truly most loaded node."""


@dataclass(frozen=True, slots=True)
class FaultScore:
    """Whether a fault was seen in its interval, by a flag or an infinite sigma of its tendons."""

    kind: str
    where: str
    from_s: float
    tendons: int
    """How many it spoils."""
    named: int
    """How many of these were named while it lasted."""
    delay_s: float | None
    """From its beginning until the last of them was first named; None when one never was."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedFrames:
    """Frame by frame, what an evaluation was made of: for figures, and to pool trials."""

    t_s: NDArray[np.float64]
    """(frames,)"""
    estimated_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    true_m: NDArray[np.float64]
    """(frames, nodes, 3) in the estimate's frame, nan where unknown."""
    node_sigma_m: NDArray[np.float64]
    """(frames, free nodes) root of the trace of the covariance."""
    height_sigma_m: NDArray[np.float64]
    """(frames, nodes)"""
    nees: NDArray[np.float64]
    """(frames, free nodes) e^T P^-1 e."""
    node_error_m: NDArray[np.float64]
    """(frames, free nodes, 3) estimated minus true."""
    face_error_m: NDArray[np.float64]
    """(frames, faces, 3) of the faces' centres."""
    frame_error_m: NDArray[np.float64]
    """(frames,) root of the mean of |error|^2 over the free nodes."""
    wrong_branch: NDArray[np.bool_]
    """(frames,) det J has the other sign than at truth, and the frame's error is above 5 mm."""
    estimated_load_n: NDArray[np.float64] | None
    """(frames, free nodes, 3); None where loads were not estimated, or are not known."""
    true_load_n: NDArray[np.float64] | None
    """(frames, free nodes, 3) what the balance of forces shows of it; None where it is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """All that is said of one estimate against the truth."""

    frames: int
    """Compared: those within the times of the truth, and not in a hole of it."""
    frames_without_truth: int
    """Of the estimate, and not compared."""
    rotation_deg: float | None
    """By how much the truth was turned to fit, None when it was taken as it stands."""
    absolute: ShapeErrors
    displacement: ShapeErrors | None
    """Of the motion away from the rest shape, each side from its own; None when the truth has no rest."""
    node_rmse_m: NDArray[np.float64]
    """(free nodes,) nan of a node that the truth never shows."""
    node_height_rmse_m: NDArray[np.float64]
    """(free nodes,)"""
    worst_node: int
    """The free node with the largest RMSE."""
    consistency: Consistency
    regimes: tuple[Regime, ...]
    """Quiet and loaded only where true loads are known."""
    loads: LoadScore | None
    """None where loads were not estimated, or are not known."""
    first_good_s: float | None
    """From the first compared frame to the first one whose error is at most 5 mm; None when there is none."""
    wrong_branch_frames: int | None
    """None where the length Jacobian is not square."""
    faults: tuple[FaultScore, ...]
    false_alarm_share: float
    """Of all readings (frame, tendon) without a fault, the share that is named as one."""
    structure: Structure
    compared: ComparedFrames
