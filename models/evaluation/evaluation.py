"""The results of the comparison of an estimate with the truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from .truth import CaptureFit


@dataclass(frozen=True, slots=True)
class Errors:
    """Statistics of the errors of many points; nan when there are no points."""

    rmse_m: float
    """Square root of the mean of |error|^2 in 3-D."""
    height_rmse_m: float
    """Square root of the mean squared error of z."""
    median_m: float
    """Median of |error| in 3-D."""
    percentile_95_m: float
    """95th percentile of |error| in 3-D."""


@dataclass(frozen=True, slots=True)
class ShapeErrors:
    """The three error measures of the paper, each over all compared frames."""

    nodes: Errors
    """Errors of the free nodes."""
    faces: Errors
    """Errors of the centres of the faces, which are triangles of three tendons."""
    system: Errors
    """Errors of the free nodes and of the centres of the faces together (the paper gives no definition)."""


@dataclass(frozen=True, slots=True, eq=False)
class Consistency:
    """Whether the errors agree with the estimated covariances."""

    nees: NDArray[np.float64]
    """(free nodes,) mean over the frames of e^T P^-1 e: 3 is consistent, more is overconfident."""
    nees_band: NDArray[np.float64]
    """(free nodes, 2) interval that contains 95 % of such means when they are consistent: chi-square with 3 N degrees
    of freedom, divided by N, see `independent_frames`."""
    independent_frames: NDArray[np.float64]
    """(free nodes,) N, the effective number of independent frames, from the autocorrelation of the node's errors about
    zero, so that an error that lasts for the whole run counts once."""
    coverage_50: float
    """Share of the pairs (frame, free node) in which the 50 % ellipsoid contains the true position."""
    coverage_68: float
    """The same for the 68 % ellipsoid."""
    coverage_95: float
    """The same for the 95 % ellipsoid."""
    ok_outside_999: float
    """Share of the pairs (frame, free node) in which the status is `ok` and the 99.9 % ellipsoid does not contain the
    true position: an estimate that is wrong without saying so. Up to 0.001 is consistent."""
    median_sigma_m: float
    """Median over frames and free nodes of the square root of the trace of the node's covariance. Coverage is only
    meaningful together with it."""
    nis: float
    """Mean of ((measured - predicted length) / sigma of the difference)^2 over frames and redundant tendons: 1 is
    consistent."""
    nis_band: tuple[float, float]
    """Interval that contains 95 % of such means when they are consistent: chi-square with N degrees of freedom, divided
    by N, where N is the effective number of independent values of all tendons."""


@dataclass(frozen=True, slots=True)
class Regime:
    """Errors and consistency in the frames of one kind; nan when there are no such frames."""

    name: str
    """`quiet`: no true load at any node is above the threshold; `loaded`: a true load is above it; `slack`: by its
    measurement some tendon is bent or may be bent, with or without load."""
    frames: int
    node_rmse_m: float
    nees: float
    """Mean over frames and free nodes of e^T P^-1 e: 3 is consistent."""
    coverage_68: float
    coverage_95: float
    median_sigma_m: float


@dataclass(frozen=True, slots=True)
class LoadScore:
    """The comparison of estimated loads with the observable part of true loads; nan when there are no cases.

    A case is a pair (frame, free node). It is loaded when its true load is above the threshold.
    """

    threshold_n: float
    """Load above which a case is loaded, and above which an estimate is a detection."""
    loaded_rmse_n: float
    """Square root of the mean of |error|^2 in 3-D over the loaded cases."""
    unloaded_rmse_n: float
    """Square root of the mean of |error|^2 in 3-D over the cases that are not loaded."""
    recall: float
    """Share of the loaded cases that are detected."""
    precision: float
    """Share of the detections that are loaded cases."""
    false_alarm_share: float
    """Share of the cases that are not loaded and yet detected, among all that are not loaded."""
    quiet_false_alarm_share: float
    """Share of the cases that are detected, among all cases in frames in which no node is loaded."""
    clear_frames: int
    """Number of frames with a true load above 0.3 N."""
    most_loaded_share: float
    """Share of these frames in which the node of the largest estimated load is the node of the largest true load."""


@dataclass(frozen=True, slots=True)
class FaultScore:
    """Whether a fault was detected while it lasted, by a flag or an infinite sigma of its tendons."""

    kind: str
    where: str
    """The faulty part: `tendon 3` or `board 1`."""
    from_s: float
    tendons: int
    """Number of tendons whose readings the fault affects."""
    named: int
    """Number of these tendons that were flagged or left out while the fault lasted."""
    delay_s: float | None
    """Time from the start of the fault until all of its tendons had been detected, 0 where they were before; None when
    one was not detected. In batch it is that of hindsight."""


@dataclass(frozen=True, slots=True)
class ContactScore:
    """The contacts that were told, a probability above a half, against the true ones; nan where there are none."""

    precision: float
    """Share of the told contacts that are true, over pairs of frame and node."""
    recall: float
    """Share of the true contacts that are told."""
    still_precision: float
    """Precision while the structure is still."""
    still_recall: float
    moving_precision: float
    """Precision while it moves."""
    moving_recall: float


@dataclass(frozen=True, slots=True)
class PoseScore:
    """The comparison of a free-standing structure with the truth."""

    shape_rmse_m: float
    """RMSE of the nodes after the best rigid motion of each frame: the error of the shape alone."""
    held_rmse_m: float
    """The same for the rest shape, held in all frames."""
    level_rmse_m: float
    """RMSE of the nodes after the best turn about the vertical and the best shift of each frame."""
    tilt_rms_deg: float
    """Root mean square of the angle by which the vertical is wrong."""
    still_tilt_rms_deg: float
    """The same while the structure is still."""
    heading_error_deg: float
    """Turn about the vertical in the last frame, estimated minus true."""
    path_m: float
    """Length of the true path of the centroid, in steps that are larger than its noise."""
    drift_share: float
    """Error of the centroid in the last frame, or of as many as the truth's noise needs, up to 0.2 s, in proportion to
    the path; nan where that is less than a millimetre."""
    centroid_rmse_m: float
    """RMSE of the centroid."""
    contacts: ContactScore | None
    """None when contacts were not estimated, or the true ones are not known."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedFrames:
    """The values of each compared frame from which an evaluation is computed, for figures and for pooling trials."""

    t_s: NDArray[np.float64]
    """(frames,)"""
    estimated_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    true_m: NDArray[np.float64]
    """(frames, nodes, 3) in the coordinate frame of the estimate; nan where unknown."""
    node_sigma_m: NDArray[np.float64]
    """(frames, free nodes) square root of the trace of the node's covariance."""
    height_sigma_m: NDArray[np.float64]
    """(frames, nodes) standard deviation of z."""
    nees: NDArray[np.float64]
    """(frames, free nodes) e^T P^-1 e."""
    node_error_m: NDArray[np.float64]
    """(frames, free nodes, 3) estimated minus true position."""
    face_error_m: NDArray[np.float64]
    """(frames, faces, 3) estimated minus true centre of each face."""
    frame_error_m: NDArray[np.float64]
    """(frames,) square root of the mean of |error|^2 over the free nodes."""
    wrong_branch: NDArray[np.bool_] | None
    """(frames,) whether det J has another sign than at the true shape, and the frame's error is above 5 mm; None when
    the length Jacobian is not square, or no true branch is known."""
    estimated_load_n: NDArray[np.float64] | None
    """(frames, free nodes, 3); None when loads were not estimated, or true loads are not known."""
    true_load_n: NDArray[np.float64] | None
    """(frames, free nodes, 3) observable part of the true loads; None when they are not known."""
    contacts: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    """(frames, nodes) estimated probabilities, and true contacts as `TrueContacts.at` tells them; None without them."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """All results of the comparison of one estimate with the truth."""

    frames: int
    """Number of compared frames, which are those within the times of the truth and not in one of its gaps."""
    frames_without_truth: int
    """Number of frames of the estimate that were not compared."""
    rotation_deg: float | None
    """Angle by which the truth was rotated for alignment; None when it was not aligned."""
    anchors_apart_m: NDArray[np.float64]
    """(anchors,) mean distance of each anchor in the truth from where it is told; nan where it is not in the truth."""
    absolute: ShapeErrors
    """Errors of the positions."""
    displacement: ShapeErrors | None
    """Errors of the displacements from the rest shape, the estimate's from its own and the truth's from the true one;
    None when the truth has no rest."""
    node_rmse_m: NDArray[np.float64]
    """(free nodes,) nan for a node without true positions."""
    node_height_rmse_m: NDArray[np.float64]
    """(free nodes,) square root of the mean squared error of z."""
    worst_node: int
    """The free node with the largest RMSE."""
    consistency: Consistency
    regimes: tuple[Regime, ...]
    """The kinds of frames; quiet and loaded frames only when true loads are known."""
    loads: LoadScore | None
    """None when loads were not estimated, or true loads are not known."""
    first_good_s: float | None
    """Time from the first compared frame to the first frame whose error is at most 5 mm; None when there is none."""
    wrong_branch_frames: int | None
    """Number of frames on the wrong branch; None where `ComparedFrames.wrong_branch` is."""
    faults: tuple[FaultScore, ...]
    false_alarm_share: float
    """Share of the readings (frame, tendon) without a fault that were flagged as faulty or left out."""
    pose: PoseScore | None
    """None for a structure with three anchors or more."""
    in_body: bool
    """Whether the shape is described in body coordinates, so that the truth was laid onto each frame."""
    capture: CaptureFit | None
    """How motion capture was laid onto the estimate; None for a truth on the host's clock."""
    other_offset_s: float
    """What to add to the times of the truth for its motion to be that of the estimate; nan where it is."""
    structure: Structure
    compared: ComparedFrames
