"""Errors of an estimate against the truth. An estimator must not import this module, because it must not use truth."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..balance.observable_loads import observable_part
from ..structure.external_loads import LOAD_THRESHOLD_N
from ..structure.reconstruction import Reconstruction
from ..structure.rigidity import branch
from ..structure.shape import node_sigma_m
from ..structure.structure import Structure
from ..values.errors import InputError
from ..values.readings import Flag, Mode
from ..values.stamps import rest_until_s
from ..values.time_series import mean_over_frames
from ..values.units import OTHER_UNIT
from .alignment import interpolated_within, laid_on_each_frame, rigid_alignment
from .consistency import consistency, coverage, normalised_error_squared
from .evaluation import ComparedFrames, Errors, Evaluation, Regime, ShapeErrors
from .fault_score import false_alarm_share, score_fault
from .load_score import score_loads
from .motion_capture import check_rods, other_offset_s
from .pose_score import score_pose
from .statistics import of_known
from .truth import Truth

GOOD_M = 0.005
"""Largest error of a frame with a good shape; above it a different sign of det J means the wrong branch."""


def evaluate(
    rest_position_m: NDArray[np.float64],
    estimate: Reconstruction,
    truth: Truth,
    *,
    align: bool = False,
    load_threshold_n: float = LOAD_THRESHOLD_N,
) -> Evaluation:
    """Compare an estimate with the truth.

    Args:
        rest_position_m: (nodes, 3) the rest shape from which the estimate started.
        estimate: shapes in the coordinate frame that it tells.
        truth: true shapes in the same coordinate frame, unless they are to be aligned. Where the shape is described in
            body coordinates, because nothing tells where it is, the truth is laid onto each frame by its best rigid
            motion, and all errors are of the shape alone.
        align: whether to rotate and translate the truth by one rigid motion, the best fit over all frames and free
            nodes. True loads are not rotated.
        load_threshold_n: load above which a node counts as loaded.

    Raises:
        InputError: when the truth covers no frame of the estimate, or is in another unit.
    """
    structure = estimate.structure
    true_m = _true_positions(structure, estimate.t_s, truth.t_s, truth.node_position_m)
    in_body = estimate.coordinate_frame == "body"
    if in_body:  # in which nobody knows the directions of true loads
        true_m, truth = _laid_on_shapes(true_m, estimate), replace(truth, loads=None)
    free = structure.free_nodes
    known = np.asarray(np.isfinite(true_m[:, free]).all(axis=-1).any(axis=-1))
    true_m, rotation_deg = _aligned(true_m, estimate) if align else (true_m, None)
    start_s = estimate.t_s[0] if truth.start_s is None else truth.start_s
    rest = estimate.t_s < rest_until_s(start_s, truth.rest_seconds)
    rest_error_m = rest_position_m - mean_over_frames(true_m[rest])
    compared = compare_frames(estimate, true_m, known, truth)
    pose = None if structure.is_held else score_pose(compared, rest_position_m, in_body=in_body)
    node_rmse_m = np.sqrt(mean_over_frames((compared.node_error_m**2).sum(axis=-1)))
    node_height_rmse_m = np.sqrt(mean_over_frames(compared.node_error_m[..., 2] ** 2))
    good = np.flatnonzero(compared.frame_error_m <= GOOD_M)
    return Evaluation(
        frames=int(known.sum()),
        frames_without_truth=int((~known).sum()),
        rotation_deg=rotation_deg,
        anchors_apart_m=mean_over_frames(
            np.linalg.norm(true_m[:, structure.anchors] - structure.anchor_position_m, axis=-1)
        ),
        absolute=shape_errors(compared.node_error_m, compared.face_error_m),
        displacement=_displacement_errors(structure, compared, rest_error_m),
        node_rmse_m=node_rmse_m,
        node_height_rmse_m=node_height_rmse_m,
        worst_node=int(free[np.nanargmax(node_rmse_m)]),
        consistency=consistency(estimate, compared),
        regimes=regimes(compared, slack_frames(estimate)[known], load_threshold_n),
        loads=score_loads(compared, load_threshold_n),
        first_good_s=float(compared.t_s[good[0]] - compared.t_s[0]) if len(good) else None,
        wrong_branch_frames=None if compared.wrong_branch is None else int(compared.wrong_branch.sum()),
        faults=tuple(score_fault(fault, estimate) for fault in truth.faults if fault.during(estimate.t_s).any()),
        false_alarm_share=false_alarm_share(truth.faults, estimate),
        pose=pose,
        in_body=in_body,
        capture=truth.capture,
        other_offset_s=other_offset_s(truth.t_s, truth.node_position_m, estimate),
        structure=structure,
        compared=compared,
    )


def _displacement_errors(
    structure: Structure, compared: ComparedFrames, rest_error_m: NDArray[np.float64]
) -> ShapeErrors | None:
    """Return the errors of the displacements from the rest shape; None when the true rest shape is not known.

    Args:
        structure: the structure whose shape was estimated.
        compared: the compared frames.
        rest_error_m: (nodes, 3) estimated minus true rest shape; nan where the true one is not known.
    """
    nodes = compared.node_error_m - rest_error_m[structure.free_nodes]
    faces = compared.face_error_m - rest_error_m[structure.faces].mean(axis=1)
    return shape_errors(nodes, faces) if np.isfinite(nodes).any() else None


def compare_frames(
    estimate: Reconstruction, true_m: NDArray[np.float64], known: NDArray[np.bool_], truth: Truth
) -> ComparedFrames:
    """Return the errors and other values of each compared frame.

    Args:
        estimate: the estimate in all frames of the run.
        true_m: (frames, nodes, 3) true positions at the times of these frames.
        known: (frames,) which frames to compare.
        truth: true loads and contacts, where they are known.
    """
    structure = estimate.structure
    contacts = None
    if truth.contacts and estimate.contacts is not None:
        contacts = estimate.contacts[known], truth.contacts.at(estimate.t_s[known])
    free = structure.free_nodes
    estimated_m = estimate.node_position_m[known]
    true_m = true_m[known]
    covariance_m2 = estimate.node_covariance_m2[known]
    error_m = estimated_m - true_m
    node_error_m = error_m[:, free]
    frame_error_m = np.sqrt(np.nanmean((node_error_m**2).sum(axis=-1), axis=1))
    true_load_n = None
    estimated_load_n = None
    if truth.loads:
        force_n = interpolated_within(estimate.t_s[known], truth.loads.t_s, truth.loads.force_n)
        true_load_n = observable_part(structure, force_n, true_m)[:, free]
        estimated_load_n = estimate.loads.force_n[known][:, free] if estimate.loads else None
    true_branch = branch(structure, structure.with_anchors_placed(true_m))  # truth need not tell anchors
    other_sign = branch(structure, estimated_m) * true_branch < 0
    return ComparedFrames(
        t_s=estimate.t_s[known],
        estimated_m=estimated_m,
        true_m=true_m,
        node_sigma_m=node_sigma_m(covariance_m2[:, free]),
        height_sigma_m=np.sqrt(covariance_m2[..., 2, 2]),
        nees=normalised_error_squared(node_error_m, covariance_m2[:, free]),
        node_error_m=node_error_m,
        face_error_m=error_m[:, structure.faces].mean(axis=-2),
        frame_error_m=frame_error_m,
        wrong_branch=other_sign & (frame_error_m > GOOD_M) if true_branch.any() else None,
        estimated_load_n=estimated_load_n,
        true_load_n=true_load_n,
        contacts=contacts,
    )


def shape_errors(node_error_m: NDArray[np.float64], face_error_m: NDArray[np.float64]) -> ShapeErrors:
    """Return the paper's three error measures from (..., 3) errors of free nodes and of the centres of faces."""
    nodes = node_error_m.reshape(-1, 3)
    faces = face_error_m.reshape(-1, 3)
    return ShapeErrors(errors_of(nodes), errors_of(faces), errors_of(np.concatenate([nodes, faces])))


def errors_of(error_m: NDArray[np.float64]) -> Errors:
    """Return the statistics of (points, 3) errors; points with a nan are left out."""
    error_m = error_m[np.isfinite(error_m).all(axis=-1)]
    if len(error_m) == 0:
        return Errors(np.nan, np.nan, np.nan, np.nan)
    distance_m = np.linalg.norm(error_m, axis=-1)
    return Errors(
        float(np.sqrt(np.mean(distance_m**2))),
        float(np.sqrt(np.mean(error_m[:, 2] ** 2))),
        float(np.median(distance_m)),
        float(np.quantile(distance_m, 0.95)),
    )


def regimes(compared: ComparedFrames, slack: NDArray[np.bool_], load_threshold_n: float) -> tuple[Regime, ...]:
    """Return errors and consistency in quiet, loaded and slack frames, see `Regime`."""
    masks = {"slack": slack}
    if compared.true_load_n is not None:
        loaded = (np.linalg.norm(compared.true_load_n, axis=-1) > load_threshold_n).any(axis=1)
        known = np.asarray(np.isfinite(compared.true_load_n).all(axis=-1))
        quiet = ~loaded & known[:, known.any(axis=0)].all(axis=1)  # of nodes whose loads are measured at all
        masks = {"quiet": quiet, "loaded": loaded} | masks
    return tuple(
        Regime(
            name=name,
            frames=int(mask.sum()),
            node_rmse_m=errors_of(compared.node_error_m[mask].reshape(-1, 3)).rmse_m,
            nees=of_known(np.mean, compared.nees[mask]),
            coverage_68=coverage(compared.nees[mask], 0.68),
            coverage_95=coverage(compared.nees[mask], 0.95),
            median_sigma_m=of_known(np.median, compared.node_sigma_m[mask]),
        )
        for name, mask in masks.items()
    )


def node_rmse_m(
    reconstruction: Reconstruction, truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> float:
    """Return the square root of the mean of |error|^2 in 3-D over free nodes and all frames that the truth covers.

    In body coordinates the truth is laid onto each frame, see `evaluate`.

    Raises:
        InputError: see `evaluate`.
    """
    true_m = _true_positions(reconstruction.structure, reconstruction.t_s, truth_s, truth_position_m)
    if reconstruction.coordinate_frame == "body":
        true_m = _laid_on_shapes(true_m, reconstruction)
    error_m = (reconstruction.node_position_m - true_m)[:, reconstruction.structure.free_nodes]
    return errors_of(error_m.reshape(-1, 3)).rmse_m


def _true_positions(
    structure: Structure, t_s: NDArray[np.float64], truth_s: NDArray[np.float64], truth_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (frames, nodes, 3) the true positions at the times of the frames; nan where they are not known."""
    structure.check_unit("truth", truth_m)
    _check_apart(structure, truth_s, truth_m)
    if not np.isfinite(truth_m[:, structure.free_nodes]).all(axis=-1).any():
        raise InputError("truth: expected positions of nodes that are no anchors, got none")
    true_m = interpolated_within(t_s, truth_s, truth_m)
    if not np.isfinite(true_m[:, structure.free_nodes]).all(axis=-1).any():
        raise InputError(
            f"truth from {truth_s[0]:.3f} to {truth_s[-1]:.3f} s covers no frame of the estimate, "
            f"{t_s[0]:.3f} to {t_s[-1]:.3f} s: expected both on the host clock"
        )
    check_rods(structure, "truth", true_m)
    return true_m


def _laid_on_shapes(true_m: NDArray[np.float64], estimate: Reconstruction) -> NDArray[np.float64]:
    """Return (frames, nodes, 3) true positions, those of each frame laid onto its shape in body coordinates."""
    laid_m = laid_on_each_frame(true_m, estimate.node_position_m)
    if not np.isfinite(laid_m).any():
        raise InputError("truth: expected three nodes not on one line in some frame, to be laid onto its shape")
    return laid_m


def _aligned(true_m: NDArray[np.float64], estimate: Reconstruction) -> tuple[NDArray[np.float64], float]:
    """Return (frames, nodes, 3) true positions by the rigid motion that fits all free nodes best, and its angle."""
    free = estimate.structure.free_nodes
    rotation, shift_m = rigid_alignment(
        true_m[:, free].reshape(-1, 3), estimate.node_position_m[:, free].reshape(-1, 3)
    )
    return true_m @ rotation.as_matrix().T + shift_m, float(np.rad2deg(rotation.magnitude()))


def _check_apart(structure: Structure, truth_s: NDArray[np.float64], truth_m: NDArray[np.float64]) -> None:
    """Raise InputError for a time at which true nodes are a hundred times as far apart as the rods are long."""
    apart_m = (np.fmax.reduce(truth_m, axis=1) - np.fmin.reduce(truth_m, axis=1)).max(axis=-1)
    rod_m = float(structure.rod_length_m.max())
    for index in np.flatnonzero(apart_m > OTHER_UNIT * rod_m)[:1]:
        raise InputError(
            f"truth at {truth_s[index]:.3f} s: expected nodes as far apart as rods of {rod_m:g} m hold them, got "
            f"{apart_m[index]:g} m: leave the cells of a node that was not seen blank"
        )


def slack_frames(estimate: Reconstruction) -> NDArray[np.bool_]:
    """Return (frames,) whether some tendon is bent or may be bent, by its measurement."""
    slack = (estimate.mode == Mode.BENDING) | ((estimate.flags & Flag.AMBIGUOUS) != 0)
    return np.asarray((slack & np.isfinite(estimate.length_m))[:, estimate.structure.free_tendons].any(axis=1))
