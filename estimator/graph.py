"""The factor graph: the factors of one frame, and those that connect it to the frames before it."""

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from ..factors.anchor import anchor_factors
from ..factors.body_frame import body_frame_rows
from ..factors.equilibrium import equilibrium_rows, squared_norms
from ..factors.keys import NodeRows, factor_on_nodes, frame_keys
from ..factors.motion import constant_velocity_factors, still_factors
from ..factors.noise import WeightedLengths
from ..factors.own import own_graph_rows, own_rows
from ..factors.rod import rod_factors
from ..factors.shape_prior import shape_prior_factors
from ..factors.tendon import correlated_tendon_rows, tendon_factors
from ..models.balance.statics import Statics
from ..models.balance.support import Support
from ..models.estimation import NoiseSettings
from ..models.structure.lengths import length_jacobian, propagated_variance
from ..models.structure.rest_shape import RestShape
from ..models.structure.rigidity import SINGULAR, motions_left
from ..models.structure.shape import Reason, Status
from ..models.structure.structure import Structure
from ..models.values.chi_squared import are_improbable
from ..models.values.errors import IndeterminateError
from ..models.values.readings import NaturalLengths, TendonLengths

MAX_FRAME_ITERATIONS = 100
ERROR_TOLERANCE = 1e-2
"""Absolute tolerance of a frame's error, which is half a sum of squares: a seventh of one sigma of one length."""

NOTHING_TOLD = 0.5
"""Ratio of its sigma to a length, from which it tells nothing."""
NEAR_M = 0.001
"""Motion of a node, or winding of a tendon, over which the standard deviation of the balance of forces changes by less
than a tenth."""
NEAR_SIGMA_M = 2e-5
"""Change of the sigma of a natural length over which it does so: 0.008 N at 400 N/m."""


class FrameSearch:
    """The search for a local minimum of the error of one frame's own factors (Levenberg-Marquardt)."""

    def __init__(self, graph: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> None:
        self._parameters = gtsam.LevenbergMarquardtParams()
        self._parameters.setMaxIterations(MAX_FRAME_ITERATIONS)
        self._parameters.setAbsoluteErrorTol(ERROR_TOLERANCE)
        self._optimizer = gtsam.LevenbergMarquardtOptimizer(graph, start, self._parameters)
        self.converged = False
        """Whether the minimum is found."""

    @property
    def error(self) -> float:
        """Half the sum of squares so far, which is the negative log-likelihood up to a constant."""
        return float(self._optimizer.error())

    @property
    def node_position_m(self) -> NDArray[np.float64]:
        """(nodes, 3) the shape so far."""
        return np.array(gtsam.utilities.extractPoint3(self._optimizer.values()))

    @property
    def ended(self) -> bool:
        """Whether the minimum is found, or given up."""
        return self.converged or self._optimizer.iterations() >= MAX_FRAME_ITERATIONS

    def iterate(self) -> None:
        """Do one iteration; none when the search has ended."""
        if not self.ended:
            before = self._optimizer.error()
            self._optimizer.iterate()
            self.converged = gtsam.checkConvergence(self._parameters, before, self._optimizer.error())

    def finished(self) -> "FrameSearch":
        """Return this search after all its iterations."""
        while not self.ended:
            self.iterate()
        return self


class GraphBuilder:
    """Adds the factors of one frame after another to a graph."""

    def __init__(self, structure: Structure, rest: RestShape, noise: NoiseSettings) -> None:
        self.structure = structure
        self.rest = rest
        self.noise = noise
        self.node_count = structure.node_count
        self._free = structure.free_nodes.tolist()
        self.statics = Statics(structure, rest.mechanics) if rest.mechanics else None
        self.starts_at_rest = rest.at_start
        """Whether the structure is at its rest shape in the first frame, as far as is known; see `begin`."""
        self.fixed_motions = motions_left(structure, rest.node_position_m).T
        """(motions, 3 nodes) rigid motions that the anchors leave, and that are fixed; no rows with three anchors."""
        self._near_m = np.full_like(rest.node_position_m, np.inf)
        self.force_sigma_n = np.zeros(0)
        """(rows,) standard deviation of the balance of forces at a node without load, near the present shape."""
        self._near_variance = np.zeros(0)
        self._near_natural: NaturalLengths | None = None
        self.approach(rest.node_position_m)

    def begin(self, lengths: TendonLengths) -> None:
        """Take the first frame: whether it has the lengths at rest, but for the worst, whose sensor may be faulty.

        Of lengths l_e that are those at rest, r_e, the sum of (l_e - r_e)^2 / (sigma_l^2 + sigma_r^2) without the
        largest one is not `are_improbable`.
        """
        rest, read = self.rest.lengths(0.0), lengths.usable
        apart = (lengths.length_m - rest.length_m)[read] / np.hypot(lengths.sigma_m, rest.sigma_m)[read]
        self.starts_at_rest = self.rest.at_start and not are_improbable(apart, faulty=1)

    def approach(self, node_position_m: NDArray[np.float64]) -> None:
        """Compute the standard deviation of the balance of forces near a shape, if it is not near the last one."""
        if self.statics is not None and np.abs(node_position_m - self._near_m).max() >= NEAR_M:
            self._near_m = node_position_m
            self._spread(self.statics)

    def wind(self, natural: NaturalLengths | None) -> None:
        """Use other natural lengths from now on, as motors have changed them; none where no motor changes any."""
        if self.statics is None or self.rest.mechanics is None or natural is None:
            return
        change_m = natural.length_m - self.structure.natural_length_m
        self.statics = self.statics.wound(self.rest.mechanics.natural_length_m + change_m)
        if self._near_natural is None or not are_near(self._near_natural, natural):
            self._near_natural = natural
            self._spread(self.statics)

    def stand_on(self, support: Support) -> None:
        """Use another force of gravity and floor from the next frame on."""
        if self.statics is not None:
            self.statics = self.statics.supported(support)
            self._add_support(self.statics)

    @property
    def internal_variance_n2(self) -> NDArray[np.float64]:
        """(rows,) variance of the balance of forces near the present shape, by unknown mechanics and hubs."""
        return self._near_variance - self.noise.force_n**2

    def _spread(self, statics: Statics) -> None:
        """Compute the variance of the balance of forces at the present shape and natural lengths."""
        natural_sigma_m = None if self._near_natural is None else self._near_natural.sigma_m
        self._near_variance = self.balance_variance_n2(statics, self._near_m, natural_sigma_m)
        self._add_support(statics)

    def balance_variance_n2(
        self, statics: Statics, node_position_m: NDArray[np.float64], natural_sigma_m: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Return (..., rows) the variance of the balance of forces at a node without load, but for that of the support.

        Args:
            statics: the balance, with the natural lengths of the frame, or of each.
            node_position_m: (..., nodes, 3) shapes.
            natural_sigma_m: (..., tendons) standard deviation of the natural lengths; None where no motor changes any.
        """
        lead = node_position_m.shape[:-2]
        variance = np.full((*lead, len(statics.group)), self.noise.force_n**2 + self.rest.hub_force_n**2)
        covariance = self._mechanics_covariance(natural_sigma_m)
        if covariance is not None:
            by_mechanics = np.concatenate(statics.mechanics_jacobian(node_position_m), axis=-1)
            by_row = propagated_variance(by_mechanics, covariance)
            variance += squared_norms(np.sqrt(by_row), statics) / statics.rank_of_row
        return variance

    def _mechanics_covariance(self, natural_sigma_m: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        """(..., 2 tendons, 2 tendons) covariance of log k and of the present L0; None where nothing is uncertain."""
        covariance = self.rest.mechanics_covariance
        if natural_sigma_m is None:
            return covariance
        variance = np.concatenate([np.zeros_like(natural_sigma_m), natural_sigma_m**2], axis=-1)
        wound = variance[..., None] * np.eye(variance.shape[-1])
        return wound if covariance is None else covariance + wound

    def _add_support(self, statics: Statics) -> None:
        self.force_sigma_n = np.sqrt(self._near_variance + statics.support_variance_n2(self._near_m))

    def keys(self, frame: int) -> range:
        """Return the keys of all nodes of a frame."""
        return frame_keys(frame, self.node_count)

    def add_frame(self, graph: gtsam.NonlinearFactorGraph, frame: int, measured: WeightedLengths) -> None:
        """Add a frame's own factors: anchors, rods, tendons, equilibrium, the weak shape prior, and those of one's own.

        The natural lengths of the frame are used from now on.

        Raises:
            IndeterminateError: when these leave some node undetermined.
        """
        self.check_determined(measured.lengths)
        self.wind(measured.lengths.natural)
        keys, shared = self.keys(frame), measured.shared
        for factors in (
            anchor_factors(self.structure, keys, self.noise),
            rod_factors(self.structure, keys, self.noise),
            tendon_factors(self.structure, keys, measured, self.noise.robust) if shared is None else [],
            shape_prior_factors(self._free, keys, self.rest.node_position_m, self.noise.shape_prior_m),
        ):
            _add(graph, factors)
        rows = self._node_rows(measured, shared)
        if rows:
            graph.add(factor_on_nodes(keys, rows))

    def _node_rows(self, measured: WeightedLengths, shared: NDArray[np.float64] | None) -> list[NodeRows]:
        """Return those factors of a frame that are on all its nodes."""
        rows = []
        if shared is not None and measured.count:
            rows.append(correlated_tendon_rows(self.structure, measured, shared))
        if len(self.fixed_motions):
            rows.append(body_frame_rows(self.fixed_motions.T, self.rest.node_position_m))
        if self.statics:
            rows.append(equilibrium_rows(self.statics, self.force_sigma_n))
        lengths = measured.lengths
        if lengths.factors:
            _, by_position = own_rows(lengths.factors, lengths.t_s, self.rest.node_position_m)
            rows.append(own_graph_rows(lengths.factors, lengths.t_s, len(by_position)))
        return rows

    def search(self, measured: WeightedLengths, start_m: NDArray[np.float64]) -> FrameSearch:
        """Return the search for a minimum of the error of a frame's own factors, from (nodes, 3) positions."""
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        keys = self.keys(0)
        self.add_frame(graph, 0, measured)
        for key, position in zip(keys, start_m, strict=True):
            values.insertPoint3(key, position)
        return FrameSearch(graph, values)

    def add_motion(self, graph: gtsam.NonlinearFactorGraph, frame: int, times_s: Sequence[float]) -> None:
        """Add the factors that connect a frame to the two before it, or the first frame to the rest shape.

        A frame that has fewer than two frames before it gets these factors only when the structure starts at rest.

        Args:
            graph: the graph that the factors are added to.
            frame: number of the frame, 0 for the first.
            times_s: times of the last frames, this one included; at least three from frame 2 on.
        """
        q = self.noise.motion_m_per_s15
        keys = self.keys(frame)
        if frame < 2 and not self.starts_at_rest:
            return
        if frame == 0:
            _add(graph, shape_prior_factors(self._free, keys, self.rest.node_position_m, self.rest.largest_sigma_m))
        elif frame == 1:
            _add(graph, still_factors(self._free, self.keys(0), keys, times_s[-1] - times_s[-2], q))
        else:
            frames = (self.keys(frame - 2), self.keys(frame - 1), keys)
            steps_s = (times_s[-2] - times_s[-3], times_s[-1] - times_s[-2])
            _add(graph, constant_velocity_factors(self._free, frames, steps_s, q))

    def check_determined(self, lengths: TendonLengths) -> None:
        """Check that a frame's own factors determine all nodes.

        Raises:
            IndeterminateError: when they leave some node undetermined.
        """
        missing = self._missing_information(lengths)
        if missing:
            raise IndeterminateError(f"t = {lengths.t_s:.3f} s: {missing}")

    def _missing_information(self, lengths: TendonLengths) -> str | None:
        """Return which nodes a frame's own factors leave undetermined and why, or None when they determine all."""
        if np.isfinite(self.noise.shape_prior_m) or self.statics:
            return None
        members = np.concatenate([self.structure.rods, self.structure.tendons[lengths.usable]])
        jacobian = length_jacobian(self.rest.node_position_m, members, self.structure.free_coordinates)
        others = self.fixed_motions[:, self.structure.free_coordinates]
        if lengths.factors:
            _, by_position = own_rows(lengths.factors, lengths.t_s, self.rest.node_position_m)
            scale = np.maximum(np.linalg.norm(by_position, axis=1, keepdims=True), SINGULAR)
            others = np.concatenate([others, (by_position / scale)[:, self.structure.free_coordinates]])
        _, singular_value, motion = np.linalg.svd(np.concatenate([jacobian, others]))
        rank = int((singular_value > SINGULAR).sum())
        if rank == jacobian.shape[1]:
            return None
        moved = np.linalg.norm(motion[rank:].reshape(-1, len(self._free), 3), axis=(0, 2)) > 1e-3
        nodes = ", ".join(str(n) for n, m in zip(self._free, moved, strict=True) if m)
        left_out = ", ".join(map(str, np.flatnonzero(~lengths.usable))) or "none"
        return (
            f"nodes {nodes}: lengths leave {jacobian.shape[1] - rank} of their motions free (tendons left out: "
            f"{left_out}); a finite noise.shape_prior_m, or [mechanics] in trial.toml, would determine them"
        )


def are_near(one: NaturalLengths, other: NaturalLengths) -> bool:
    """Return whether the balance of forces has about the same standard deviation at the natural lengths of both."""
    lengths_are = np.abs(one.length_m - other.length_m).max() < NEAR_M
    return bool(lengths_are and np.abs(one.sigma_m - other.sigma_m).max() < NEAR_SIGMA_M)


def _add(graph: gtsam.NonlinearFactorGraph, factors: Sequence[gtsam.NonlinearFactor]) -> None:
    add = graph.add  # takes a fifth of the time of push_back
    for factor in factors:
        add(factor)


def status_of(lengths: TendonLengths, structure: Structure, doubt: Reason | None = None) -> Status:
    """Return the status of a frame whose optimisation has converged, by its doubt and its measured tendons.

    A length whose sigma is more than half of it was not measured.
    """
    is_measured = (lengths.usable & (lengths.sigma_m < NOTHING_TOLD * lengths.length_m))[structure.free_tendons]
    if not is_measured.any():
        return Status.PRIOR_ONLY
    if doubt is not None:
        return Status.DOUBT
    return Status.OK if is_measured.all() else Status.PARTIAL
