"""How far estimates are from the truth. Only the root may import this: an estimator never sees truth."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ..structure.external_loads import LOAD_THRESHOLD_N, observable_part
from ..structure.reconstruction import Reconstruction
from ..structure.rigidity import branch
from ..structure.structure import Structure
from ..values.correlation import correlation_samples
from ..values.errors import InputError
from ..values.readings import MOMENTARY, Flag, Mode
from .truth import (
    ComparedFrames,
    Consistency,
    Errors,
    Estimate,
    Evaluation,
    Fault,
    FaultScore,
    LoadScore,
    Regime,
    ShapeErrors,
    TrueLoads,
    Truth,
)

GOOD_M = 0.005
"""A frame's error up to which its shape is good, and above which the other sign of det J means the wrong branch."""
MAX_HOLE = 3.0
"""Truth is not interpolated across holes of more than so many of its own median steps."""
REDUNDANT = 0.1
"""A length whose innovation has less than this share of its own sigma was taken by the shape as it came: no check."""
CLEAR_LOAD_N = 0.3
"""A true load above it is large enough to ask which node carries it."""


def evaluate(
    structure: Structure,
    rest_position_m: NDArray[np.float64],
    estimate: Estimate,
    truth: Truth,
    *,
    align: bool = False,
    load_threshold_n: float = LOAD_THRESHOLD_N,
) -> Evaluation:
    """Compare an estimate with the truth.

    Args:
        structure: whose shape it is.
        rest_position_m: (nodes, 3) the rest shape that the estimate started from.
        estimate: in the anchors' frame.
        truth: in the same frame, unless aligned.
        align: turn and shift the truth as a whole so that it fits best over all frames and free nodes; its
            loads are in the anchors' frame as they stand.
        load_threshold_n: a node with a larger load is loaded.

    Raises:
        InputError: when they have no frame in common.
    """
    true_m = interpolated(estimate.t_s, truth.t_s, truth.node_position_m)
    free = structure.free_nodes
    known = np.asarray(np.isfinite(true_m[:, free]).all(axis=-1).any(axis=-1))
    if not known.any():
        raise InputError(
            f"truth from {truth.t_s[0]:.3f} to {truth.t_s[-1]:.3f} s covers no frame of the estimate, "
            f"{estimate.t_s[0]:.3f} to {estimate.t_s[-1]:.3f} s: expected both on the host clock"
        )
    rest = (estimate.t_s <= estimate.t_s[0] + truth.rest_seconds) & (truth.rest_seconds > 0)
    true_rest_m = mean_over_frames(true_m[rest])
    rotation_deg = None
    if align:
        rotation, shift_m = rigid_alignment(
            true_m[known][:, free].reshape(-1, 3), estimate.node_position_m[known][:, free].reshape(-1, 3)
        )
        true_m, true_rest_m = true_m @ rotation.as_matrix().T + shift_m, true_rest_m @ rotation.as_matrix().T + shift_m
        rotation_deg = float(np.rad2deg(rotation.magnitude()))
    compared = compare_frames(structure, estimate, true_m, known, truth.loads)
    moved = compared.node_error_m - (rest_position_m - true_rest_m)[free]
    faces = structure.faces
    moved_faces = compared.face_error_m - (rest_position_m - true_rest_m)[faces].mean(axis=1)
    node_rmse_m = np.sqrt(mean_over_frames((compared.node_error_m**2).sum(axis=-1)))
    node_height_rmse_m = np.sqrt(mean_over_frames(compared.node_error_m[..., 2] ** 2))
    good = np.flatnonzero(compared.frame_error_m <= GOOD_M)
    return Evaluation(
        frames=int(known.sum()),
        frames_without_truth=int((~known).sum()),
        rotation_deg=rotation_deg,
        absolute=shape_errors(compared.node_error_m, compared.face_error_m),
        displacement=shape_errors(moved, moved_faces) if np.isfinite(moved).any() else None,
        node_rmse_m=node_rmse_m,
        node_height_rmse_m=node_height_rmse_m,
        worst_node=int(free[np.nanargmax(node_rmse_m)]),
        consistency=consistency(structure, estimate, compared),
        regimes=regimes(compared, slack_frames(structure, estimate)[known], load_threshold_n),
        loads=score_loads(compared, load_threshold_n),
        first_good_s=float(compared.t_s[good[0]] - compared.t_s[0]) if len(good) else None,
        wrong_branch_frames=int(compared.wrong_branch.sum()) if structure.is_square else None,
        faults=tuple(score_fault(fault, estimate) for fault in truth.faults),
        false_alarm_share=false_alarm_share(truth.faults, estimate),
        structure=structure,
        compared=compared,
    )


def compare_frames(
    structure: Structure,
    estimate: Estimate,
    true_m: NDArray[np.float64],
    known: NDArray[np.bool_],
    loads: TrueLoads | None = None,
) -> ComparedFrames:
    """Return what can be said frame by frame.

    Args:
        structure: whose shape it is.
        estimate: of the whole run.
        true_m: (frames, nodes, 3) truth at the estimate's frames.
        known: (frames,) which of them to compare.
        loads: true ones, if they are known.
    """
    free = structure.free_nodes
    estimated_m, true_m = estimate.node_position_m[known], true_m[known]
    covariance_m2 = estimate.node_covariance_m2[known]
    error_m = estimated_m - true_m
    node_error_m = error_m[:, free]
    frame_error_m = np.sqrt(np.nanmean((node_error_m**2).sum(axis=-1), axis=1))
    true_load_n = estimated_load_n = None
    if loads:
        force_n = interpolated(estimate.t_s[known], loads.t_s, loads.force_n)
        true_load_n = observable_part(structure, force_n, true_m)[:, free]
        estimated_load_n = estimate.loads.force_n[known][:, free] if estimate.loads else None
    other_sign = branch(structure, estimated_m) * branch(structure, true_m) < 0
    return ComparedFrames(
        t_s=estimate.t_s[known],
        estimated_m=estimated_m,
        true_m=true_m,
        node_sigma_m=np.sqrt(np.trace(covariance_m2[:, free], axis1=-2, axis2=-1)),
        height_sigma_m=np.sqrt(covariance_m2[..., 2, 2]),
        nees=normalised_error_squared(node_error_m, covariance_m2[:, free]),
        node_error_m=node_error_m,
        face_error_m=error_m[:, structure.faces].mean(axis=-2),
        frame_error_m=frame_error_m,
        wrong_branch=other_sign & (frame_error_m > GOOD_M),
        estimated_load_n=estimated_load_n,
        true_load_n=true_load_n,
    )


def shape_errors(node_error_m: NDArray[np.float64], face_error_m: NDArray[np.float64]) -> ShapeErrors:
    """Return the paper's three figures of (..., 3) errors of free nodes and of faces' centres."""
    nodes, faces = node_error_m.reshape(-1, 3), face_error_m.reshape(-1, 3)
    return ShapeErrors(errors_of(nodes), errors_of(faces), errors_of(np.concatenate([nodes, faces])))


def errors_of(error_m: NDArray[np.float64]) -> Errors:
    """Summarise (points, 3) errors; those with a nan are left out."""
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


def normalised_error_squared(error_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...,) NEES e^T P^-1 e of (..., 3) errors; nan where either is unknown."""
    known = np.isfinite(error_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-2, -1))
    e, covariance = error_m[known], covariance_m2[known]
    sure = np.linalg.eigvalsh(covariance)[:, 0] <= 0  # claims to know some direction exactly
    solved = np.linalg.solve(np.where(sure[:, None, None], np.eye(3), covariance), e[..., None])[..., 0]
    nees = np.full(known.shape, np.nan)
    nees[known] = np.where(sure, np.inf, np.einsum("ni,ni->n", e, solved))
    return nees


def consistency(structure: Structure, estimate: Estimate, compared: ComparedFrames) -> Consistency:
    """Return whether errors and innovations are as large as the covariances say."""
    tendons = structure.free_tendons
    predicted_m = structure.tendon_length_m(estimate.node_position_m)
    innovation = ((estimate.length_m - predicted_m) / np.maximum(estimate.innovation_sigma_m, 1e-9))[:, tendons]
    sigma_m = estimate.sigma_m[:, tendons]
    checked = np.isfinite(sigma_m) & (estimate.innovation_sigma_m[:, tendons] > REDUNDANT * sigma_m)
    nis = np.where(checked, innovation**2, np.nan)
    count = np.array([independent_count(column) for column in compared.nees.T])
    return Consistency(
        nees=mean_over_frames(compared.nees),
        nees_band=np.array([mean_band(3, n) for n in count]),
        independent_frames=count,
        coverage_50=coverage(compared.nees, 0.50),
        coverage_68=coverage(compared.nees, 0.68),
        coverage_95=coverage(compared.nees, 0.95),
        median_sigma_m=_of_known(np.median, compared.node_sigma_m),
        nis=_of_known(np.mean, nis),
        nis_band=mean_band(1, sum(independent_count(column) for column in nis.T)),
    )


def slack_frames(structure: Structure, estimate: Estimate) -> NDArray[np.bool_]:
    """Return (frames,) in which some tendon, as measured, is bent or may be."""
    slack = (estimate.mode == Mode.BENDING) | ((estimate.flags & Flag.AMBIGUOUS) != 0)
    return np.asarray((slack & np.isfinite(estimate.length_m))[:, structure.free_tendons].any(axis=1))


def regimes(compared: ComparedFrames, slack: NDArray[np.bool_], load_threshold_n: float) -> tuple[Regime, ...]:
    """Return errors and consistency of quiet, loaded and slack frames, see `Regime`."""
    masks = {"slack": slack}
    if compared.true_load_n is not None:
        loaded = (np.linalg.norm(compared.true_load_n, axis=-1) > load_threshold_n).any(axis=1)
        masks = {"quiet": ~loaded, "loaded": loaded} | masks
    return tuple(
        Regime(
            name,
            int(mask.sum()),
            errors_of(compared.node_error_m[mask].reshape(-1, 3)).rmse_m,
            _of_known(np.mean, compared.nees[mask]),
            coverage(compared.nees[mask], 0.68),
            coverage(compared.nees[mask], 0.95),
            _of_known(np.median, compared.node_sigma_m[mask]),
        )
        for name, mask in masks.items()
    )


def score_loads(compared: ComparedFrames, threshold_n: float) -> LoadScore | None:
    """Return how far the estimated loads are from the true ones, if both are there."""
    if compared.estimated_load_n is None or compared.true_load_n is None:
        return None
    error_n = np.linalg.norm(compared.estimated_load_n - compared.true_load_n, axis=-1)
    true_n = np.linalg.norm(compared.true_load_n, axis=-1)
    estimated_n = np.linalg.norm(compared.estimated_load_n, axis=-1)
    known = np.isfinite(error_n)
    loaded, called = known & (true_n > threshold_n), known & (estimated_n > threshold_n)
    quiet = known & ~loaded.any(axis=1)[:, None]
    clear = np.where(known, true_n, 0.0).max(axis=1) > CLEAR_LOAD_N
    true_n, estimated_n = (np.where(known, n, -np.inf)[clear] for n in (true_n, estimated_n))
    return LoadScore(
        threshold_n,
        loaded_rmse_n=_root_mean_square(error_n[loaded]),
        unloaded_rmse_n=_root_mean_square(error_n[known & ~loaded]),
        recall=_share(called[loaded]),
        precision=_share(loaded[called]),
        false_alarm_share=_share(called[known & ~loaded]),
        quiet_false_alarm_share=_share(called[quiet]),
        clear_frames=int(clear.sum()),
        most_loaded_share=_share(true_n.argmax(axis=1) == estimated_n.argmax(axis=1)),
    )


def coverage(nees: NDArray[np.float64], probability: float) -> float:
    """Return the share of errors within the ellipsoid of some probability, e^T P^-1 e <= chi2_3; nan of none."""
    return _of_known(lambda known: np.mean(known <= chi2.ppf(probability, 3)), nees)


def mean_band(degrees: int, count: float) -> tuple[float, float]:
    """Return where 95 % of the means of so many independent chi-square values lie; nan of none."""
    low, high = chi2.ppf([0.025, 0.975], degrees * count) / count if count > 0 else (np.nan, np.nan)
    return float(low), float(high)


def independent_count(series: NDArray[np.float64]) -> float:
    """Return how many independent values are worth as much for a mean as this series: n / (1 + 2 sum rho_k).

    rho is the autocorrelation, summed up to where it first is not positive (Geyer, Statistical Science 7, 1992, cuts
    likewise); 0 of an empty series, 1 of a constant one.
    """
    series = series[np.isfinite(series)]
    if len(series) == 0 or np.ptp(series) == 0:
        return float(min(len(series), 1))
    return max(len(series) / correlation_samples(series - series.mean()), 1.0)


def named_as_fault(estimate: Estimate) -> NDArray[np.bool_]:
    """Return (frames, tendons) where a flag tells of the sensor, or the length was left out."""
    return np.asarray(((estimate.flags & ~int(MOMENTARY)) != 0) | ~np.isfinite(estimate.sigma_m))


def score_fault(fault: Fault, estimate: Estimate) -> FaultScore:
    """Return whether and when a fault was seen."""
    during = (estimate.t_s >= fault.from_s) & (estimate.t_s <= fault.until_s)
    named = named_as_fault(estimate)[during][:, fault.tendons]
    seen = np.asarray(named.any(axis=0))
    delay_s = None
    if len(seen) and seen.all():
        delay_s = float((estimate.t_s[during][named.argmax(axis=0)] - fault.from_s).max())
    return FaultScore(fault.kind, fault.where, fault.from_s, len(seen), int(seen.sum()), delay_s)


def false_alarm_share(faults: Iterable[Fault], estimate: Estimate) -> float:
    """Return the share of the readings without a fault that are named as one."""
    healthy = np.ones(estimate.flags.shape, dtype=np.bool_)
    for fault in faults:
        during = (estimate.t_s >= fault.from_s) & (estimate.t_s <= fault.until_s)
        healthy[np.ix_(during, fault.tendons)] = False
    return float(np.mean(named_as_fault(estimate)[healthy])) if healthy.any() else np.nan


def rigid_alignment(points_m: NDArray[np.float64], onto_m: NDArray[np.float64]) -> tuple[Rotation, NDArray[np.float64]]:
    """Return the rotation R and shift t with the least sum of |R p + t - q|^2 (Umeyama 1991, without scale).

    Args:
        points_m: (points, 3) p; rows with a nan are left out.
        onto_m: (points, 3) q.
    """
    known = np.isfinite(points_m).all(axis=1)
    points_m, onto_m = points_m[known], onto_m[known]
    rotation, _ = Rotation.align_vectors(onto_m - onto_m.mean(axis=0), points_m - points_m.mean(axis=0))
    return rotation, onto_m.mean(axis=0) - rotation.apply(points_m.mean(axis=0))


def node_rmse_m(
    reconstruction: Reconstruction, truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> float:
    """Return the root of the mean of |error|^2 (3-D) over the free nodes and all frames that the truth covers."""
    true_m = interpolated(reconstruction.t_s, truth_s, truth_position_m)
    error_m = (reconstruction.node_position_m - true_m)[:, reconstruction.structure.free_nodes]
    return errors_of(error_m.reshape(-1, 3)).rmse_m


def interpolated(
    t_s: NDArray[np.float64], truth_s: NDArray[np.float64], truth_position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (frames, nodes, 3) true positions at some times, on straight lines between the given ones.

    They are nan before the first and after the last time, in holes of the truth, and next to a node's nan.
    """
    after = np.clip(np.searchsorted(truth_s, t_s), 1, len(truth_s) - 1)
    step_s = truth_s[after] - truth_s[after - 1]
    share = (t_s - truth_s[after - 1]) / step_s
    outside = (share < 0) | (share > 1) | (step_s > MAX_HOLE * np.median(np.diff(truth_s)))
    share = np.where(outside & (share != 0) & (share != 1), np.nan, share)[:, None, None]
    before_m, after_m = truth_position_m[after - 1], truth_position_m[after]
    between = (1 - share) * before_m + share * after_m
    return np.asarray(np.where(share == 0, before_m, np.where(share == 1, after_m, between)))


def mean_over_frames(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over the first axis of what is not nan; nan of nothing."""
    known = ~np.isnan(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _share(cases: NDArray[np.bool_]) -> float:
    return float(cases.mean()) if len(cases) else np.nan


def _root_mean_square(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(_of_known(np.mean, values**2)))


def _of_known(statistic: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]) -> float:
    known = values[~np.isnan(values)]
    return float(statistic(known)) if len(known) else np.nan
