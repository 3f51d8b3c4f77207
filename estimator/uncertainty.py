"""The covariance of a shape and of the loads on it, from the factors of one frame alone.

It is the inverse Hessian of a frame's own factors at the estimate, plus the covariance of the rest shape, whose error
shifts every frame in the same way. The smoother's own marginals are not used: over several frames they would average
the errors of readings that repeat from frame to frame.

Forces hold a shape only as far as no load hides behind it. A node n has a load with a prior probability p_0, and then
its balance r_n is wrong by sigma_L. Whether it has one is judged by the shape as all else determines it (the cavity):

    C_n = R_n P R_n^T,   C'_n = (1 - C_n W_n)^-1 C_n,   r'_n = r_n + C'_n psi_n r_n
    L_n = N(r'_n; 0, C'_n + sigma_L^2) / N(r'_n; 0, C'_n + sigma_F^2)
    p_n = p_0 L_n / (1 - p_0 + p_0 L_n),   Var(r_n) = (1 - p_n) / W_n + p_n sigma_L^2, at least 1 / W_n

with Cauchy's weight W_n = 1 / (sigma_F (1 + q_n))^2 and pull psi_n = 1 / (sigma_F^2 (1 + q_n)). Where lengths are
measured, C'_n is small and p_n tells loads from none; where they are missing, L_n = 1, and the ellipsoids are those of
all shapes that a probable load would make. With these variances in place of the kernel the shape would be another one,
by

    delta = -P R^T (1 / Var(r) - psi) r

whose square is part of the ellipsoids, too.

Without forces, the lengths tell the motion v of which they say least to second order only, where det J is near zero.
With s^2 the variance along v, r'' the second derivatives of the lengths along it over their sigmas, and C_o the
covariance of the other motions, which adapt by a^2 u, u = -C_o J^T r'' / 2, the error of the frame is

    E(a) = a^2 / (2 s^2) + (J v . r'') a^3 / 2 + (r'' . r'' - (J^T r'') . C_o (J^T r'')) a^4 / 8

Two minima that no barrier of E parts are one wide one. Shape and covariance are the mean and the covariance of
x + a v + a^2 u with the density exp(-E). What lies beyond a barrier counts the less the higher that is: it is another
shape (`OtherBranch`). Where a second motion is about as uncertain, with the variance s_2^2, v is arbitrary: the shape
goes the share 1 - s_2^2 / s^2 of the way to the mean, and the rest of it is in the covariance.

With a probability that the doubt about the model gives (`ModelDoubt`), many nodes are loaded at once. Shape and
covariance are those of the mixture of both: the mean, the covariances, and the square of the distance between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from ..models.balance.observable_loads import external_loads
from ..models.balance.statics import Statics
from ..models.estimation import DoubtSettings
from ..models.structure.external_loads import ExternalLoads
from ..models.structure.lengths import length_curvature_per_m, propagated_variance
from ..models.structure.shape import Reason, Shape, Status
from ..models.values.errors import UNDETERMINED, IndeterminateError
from ..models.values.readings import TendonLengths
from .doubt import WIDEST_M, Doubt
from .graph import GraphBuilder
from .linear_frame import LinearFrame

NO_DOUBT = Doubt()
SHAKEN_SCALE = 15.0
"""Factor of the sigmas of rods and lengths in the covariance while the robot is shaken: its nodes swing so far
that the lengths are no longer linear in their positions."""
BARRIERS = (2.0, 4.5)
"""Errors of a frame, of two and three standard deviations: another minimum beyond the first counts less, and one beyond
the second is another shape."""
STEPS = np.linspace(-1, 1, 321)
"""Steps along a motion over the farthest one."""
FARTHEST_STEP = 16.0
"""Over the standard deviation. Of an error a^2 (1 + a / w)^2 / (2 s^2) the second minimum, at -w, is farther away than
12 s where the barrier between both, w^2 / (32 s^2), is beyond the second of `BARRIERS`."""
ENOUGH = 20.0
"""Error at which a density has ended."""


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """How far the model is doubted; leading axes are frames."""

    many_loads: NDArray[np.float64]
    """(...,) probability that many nodes are loaded at once."""
    many_loads_n: NDArray[np.float64]
    """(...,) standard deviation of these loads."""
    in_motion: NDArray[np.bool_]
    """(...,) whether the robot is shaken."""

    @classmethod
    def of(cls, doubts: Sequence[Doubt]) -> "Mixture":
        """Return the doubt about each of several frames."""
        in_motion = np.array([doubt.reason is Reason.MOTION for doubt in doubts], dtype=np.bool_)
        return cls(
            many_loads=np.array([doubt.many_loads for doubt in doubts]),
            many_loads_n=np.array([doubt.many_loads_n for doubt in doubts]),
            in_motion=in_motion,
        )

    @classmethod
    def of_one(cls, doubt: Doubt) -> "Mixture":
        """Return the doubt about one frame, without a leading axis."""
        in_motion = np.asarray(doubt.reason is Reason.MOTION)
        return cls(np.asarray(doubt.many_loads), np.asarray(doubt.many_loads_n), in_motion)

    @property
    def share_of_lengths(self) -> NDArray[np.float64]:
        """(...,) share of the lengths' information that counts in the covariance."""
        return np.where(self.in_motion, 1 / SHAKEN_SCALE**2, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """The shapes of frames, their covariances, and the loads on them; leading axes are frames."""

    node_position_m: NDArray[np.float64]
    """(..., nodes, 3) mean of the shapes with a few and with many loads; the estimate, where many are improbable."""
    covariance_m2: NDArray[np.float64]
    """(..., 3 nodes, 3 nodes) covariance of all coordinates, ordered by node."""
    loads: ExternalLoads | None
    """None where the stiffness of the tendons is not known."""
    apart_m: NDArray[np.float64]
    """(..., free) step to the shape with the loads that may be hidden; its square is not in `covariance_m2`, from which
    the modes of tendons are learned."""
    factor_innovation: NDArray[np.float64] | None
    """(..., rows) see `Shape`; None without factors of one's own."""

    @classmethod
    def joined(cls, parts: Sequence["Assessment"]) -> "Assessment":
        """Return the frames of all parts, one part after the other."""
        loads = [part.loads for part in parts if part.loads is not None]
        force_n = np.concatenate([one.force_n for one in loads]) if loads else None
        innovations = [part.factor_innovation for part in parts if part.factor_innovation is not None]
        return cls(
            np.concatenate([part.node_position_m for part in parts]),
            np.concatenate([part.covariance_m2 for part in parts]),
            None if force_n is None else ExternalLoads(force_n, np.concatenate([one.sigma_n for one in loads])),
            np.concatenate([part.apart_m for part in parts]),
            np.concatenate(innovations) if innovations else None,
        )

    def shape(self, lengths: TendonLengths, status: Status, doubt: Reason | None = None) -> Shape:
        """Return the shape of a single frame, without the step `apart_m` in its covariance."""
        return Shape(
            t_s=lengths.t_s,
            node_position_m=self.node_position_m,
            covariance_m2=self.covariance_m2,
            status=status,
            lengths=lengths,
            loads=self.loads,
            doubt=doubt,
            factor_innovation=self.factor_innovation,
        )

    def __getitem__(self, frames: int | slice) -> "Assessment":
        return Assessment(
            self.node_position_m[frames],
            self.covariance_m2[frames],
            self.loads.part(frames) if self.loads else None,
            self.apart_m[frames],
            None if self.factor_innovation is None else self.factor_innovation[frames],
        )


class FrameEvidence:
    """Computes the covariance and the loads of shapes, each from the factors of its own frame."""

    def __init__(self, builder: GraphBuilder, settings: DoubtSettings) -> None:
        self._builder = builder
        self._settings = settings
        self._rest_covariance_m2 = builder.rest.covariance_m2.copy()
        anchored = builder.structure.anchored_coordinates
        self._rest_covariance_m2[anchored, anchored] += builder.noise.anchor_m**2

    def assess(self, frame: LinearFrame, node_position_m: NDArray[np.float64], doubt: Doubt = NO_DOUBT) -> Assessment:
        """Return a shape with its covariance, and the loads on it where stiffness is known.

        Args:
            frame: the factors of the frame, linearised at the estimate.
            node_position_m: (nodes, 3) the estimate.
            doubt: the doubt about the model in the frame.

        Raises:
            IndeterminateError: see `assess_frames`.
        """
        return self.assess_frames(frame, node_position_m, self._builder.statics, Mixture.of_one(doubt))

    def assess_frames(
        self, frame: LinearFrame, node_position_m: NDArray[np.float64], statics: Statics | None, mixture: Mixture
    ) -> Assessment:
        """Return the shapes of frames with their covariances, and the loads on them where stiffness is known.

        Args:
            frame: the factors of the frames, linearised at the estimates.
            node_position_m: (..., nodes, 3) the estimates.
            statics: the balance of forces in these frames; None where stiffness is not known.
            mixture: the doubt about the model in each frame.

        Raises:
            IndeterminateError: when there is no shape prior and no other factor determines some motion.
        """
        free = self._builder.structure.free_coordinates
        lead = node_position_m.shape[:-2]
        covariance = np.tile(self._rest_covariance_m2, (*lead, 1, 1))
        try:
            held, gradient = frame.without_forces(mixture.share_of_lengths)
            if statics is None:
                few, apart_m = None, np.zeros_like(gradient)
                linear_m2 = np.asarray(np.linalg.inv(held), dtype=np.float64)
                step_m, free_covariance = self._second_order(frame, node_position_m, linear_m2, mixture)
            else:
                few = self._force_variance(frame, statics, held)
                step_m, apart_m, free_covariance = self._mixed(frame, few, held, gradient, mixture)
            innovation = self._innovation(frame, held, gradient, few)
        except np.linalg.LinAlgError as error:
            raise IndeterminateError(UNDETERMINED) from error
        covariance[..., free[:, None], free] += free_covariance
        mean_m = self._moved(node_position_m, step_m)
        loads = None if statics is None else _loads(frame, statics, mean_m, step_m, free_covariance)
        return Assessment(mean_m, covariance, loads, apart_m, innovation)

    def _moved(self, node_position_m: NDArray[np.float64], step_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., nodes, 3) shapes whose free coordinates are moved by (..., free) steps."""
        moved_m = node_position_m.reshape(*step_m.shape[:-1], -1).copy()
        moved_m[..., self._builder.structure.free_coordinates] += step_m
        return moved_m.reshape(node_position_m.shape)

    def _second_order(
        self,
        frame: LinearFrame,
        node_position_m: NDArray[np.float64],
        covariance_m2: NDArray[np.float64],
        mixture: Mixture,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (..., free) step towards the mean, and the (..., free, free) covariance, to second order.

        Args:
            frame: see `assess_frames`.
            node_position_m: (..., nodes, 3) the estimates.
            covariance_m2: (..., free, free) the inverse Hessian.
            mixture: see `assess_frames`.
        """
        structure = self._builder.structure
        values, vectors = np.linalg.eigh(covariance_m2)
        variance, widest = values[..., -1], vectors[..., -1:]
        motion = self._moved(np.zeros_like(node_position_m), widest[..., 0])
        bent_per_m = length_curvature_per_m(node_position_m, structure.free_members, motion)
        _, jacobian, bent = frame.weighted_with(bent_per_m[..., None])
        root = np.sqrt(mixture.share_of_lengths)[..., None, None]
        jacobian, bent = root * jacobian, root * bent
        by_motion = np.swapaxes(jacobian, -1, -2) @ bent
        others_m2 = covariance_m2 - variance[..., None, None] * widest @ np.swapaxes(widest, -1, -2)
        adapted = -0.5 * others_m2 @ by_motion  # u
        cubic = np.sum(widest * by_motion, axis=(-2, -1))
        quartic = np.sum(bent**2, axis=(-2, -1)) + 2 * np.sum(by_motion * adapted, axis=(-2, -1))
        first, second, third, fourth = moments_of(variance, cubic, quartic)
        mean_m = first[..., None] * widest[..., 0] + second[..., None] * adapted[..., 0]
        share = (1 - values[..., -2] / variance)[..., None]
        left_m = ((1 - share) * mean_m)[..., None]
        directions = np.concatenate([widest, adapted], axis=-1)
        crossed = third - first * second
        spread = np.stack(
            [np.stack([second - first**2, crossed], axis=-1), np.stack([crossed, fourth - second**2], axis=-1)], axis=-1
        )
        covariance_m2 = others_m2 + directions @ spread @ np.swapaxes(directions, -1, -2)
        return share * mean_m, covariance_m2 + left_m @ np.swapaxes(left_m, -1, -2)

    def _innovation(
        self,
        frame: LinearFrame,
        held: NDArray[np.float64],
        gradient_of_held: NDArray[np.float64],
        force_variance: NDArray[np.float64] | None,
    ) -> NDArray[np.float64] | None:
        """Return (..., rows) how far factors of one's own are from what all else says, see `Shape.factor_innovation`.

        With z and A their residuals and derivatives, H and g the information and the gradient of all other factors of
        the frame, and R the covariance of the rest shape, it is (z - A C g) / sqrt(diag(1 + A (C + R) A^T)), where
        C = (H + 1 / WIDEST_M^2)^-1.
        """
        if not frame.own_error.shape[-1]:
            return None
        own_information, own_gradient = frame.own
        information, gradient = held - own_information, gradient_of_held - own_gradient
        if force_variance is not None:
            weighted = np.swapaxes(frame.force_jacobian / force_variance[..., None], -1, -2)
            information = information + weighted @ frame.force_jacobian
            gradient = gradient + (weighted @ frame.force_n[..., None])[..., 0]
        free, rows = self._builder.structure.free_coordinates, frame.own_jacobian
        covariance_m2 = np.linalg.inv(information + np.eye(len(free)) / WIDEST_M**2)
        moved = (rows @ covariance_m2 @ gradient[..., None])[..., 0]
        variance = 1 + propagated_variance(rows, covariance_m2 + self._rest_covariance_m2[np.ix_(free, free)])
        return np.where(rows.any(axis=-1), (frame.own_error - moved) / np.sqrt(variance), np.nan)

    def _mixed(
        self,
        frame: LinearFrame,
        few: NDArray[np.float64],
        held: NDArray[np.float64],
        gradient_of_held: NDArray[np.float64],
        mixture: Mixture,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the (..., free) step to the mean of the mixture of a few and of many loads, and its covariance.

        Between both is the (..., free) step to the shape of a few loads, `Assessment.apart_m`.

        Args:
            frame: see `assess`.
            few: (..., rows) variance of the balance of forces with a few loads.
            held: (..., free, free) information of all but forces.
            gradient_of_held: (..., free) the gradient of its error.
            mixture: see `assess_frames`.
        """
        many = np.maximum(few, mixture.many_loads_n[..., None] ** 2)
        forces = frame.force_jacobian
        weighted = forces[..., None, :, :] / np.stack([few, many], axis=-2)[..., None]
        information = held[..., None, :, :] + np.swapaxes(weighted, -1, -2) @ forces[..., None, :, :]
        covariance_few, covariance_many = np.moveaxis(np.linalg.inv(information), -3, 0)
        by_force = np.swapaxes(forces, -1, -2)
        gradient = gradient_of_held + (by_force @ (frame.force_n / many)[..., None])[..., 0]
        many_loads = mixture.many_loads[..., None, None]
        to_many_m = -(covariance_many @ gradient[..., None])[..., 0]
        to_few_m = -(covariance_few @ by_force @ (frame.force_n / few - frame.force_pull)[..., None])[..., 0]
        covariance = (1 - many_loads) * covariance_few + many_loads * covariance_many
        between = to_many_m[..., :, None] * to_many_m[..., None, :]
        # of a shaken robot the mean is so far away that the factors are not linear
        in_motion = mixture.in_motion[..., None]
        step_m = np.where(in_motion, 0.0, many_loads[..., 0] * to_many_m)
        factor = np.where(in_motion[..., None], many_loads, many_loads * (1 - many_loads))
        to_few_m = np.where(in_motion, 0.0, (1 - many_loads[..., 0]) * to_few_m)
        return step_m, to_few_m, covariance + factor * between

    def _force_variance(self, frame: LinearFrame, statics: Statics, held: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., rows) the variance of the balance of forces, with loads that may be hidden."""
        variance = 1 / frame.force_weight_per_n**2
        by_row = frame.force_jacobian
        covariance = np.linalg.inv(held + np.swapaxes(by_row / variance[..., None], -1, -2) @ by_row)
        of_rows = by_row @ covariance @ np.swapaxes(by_row, -1, -2)
        cavities, squares = [], []
        at_nodes = 3 * len(statics.nodes)
        for rows, dimension in ((np.arange(at_nodes), 3), (np.arange(at_nodes, by_row.shape[-2]), 1)):
            groups = rows.reshape(-1, dimension)
            weighted = of_rows[..., groups[:, :, None], groups[:, None, :]]
            excused = variance[..., groups[:, :1], None]
            cavity = np.linalg.solve((1 + 1e-6) * np.eye(dimension) - weighted / excused, weighted)
            without_n = frame.force_n[..., groups] + (cavity @ frame.force_pull[..., groups, None])[..., 0]
            cavities.append(np.trace(cavity, axis1=-2, axis2=-1))
            squares.append((without_n**2).sum(axis=-1))
        start = statics.group_start
        independent = statics.rank_of_row[start]
        cavity_n2 = np.maximum(np.concatenate(cavities, axis=-1) / independent, 0)
        squared_n2 = np.concatenate(squares, axis=-1)
        loaded = self._loaded_probability(squared_n2, cavity_n2, independent, frame.force_sigma_n[..., start])
        mixed = (1 - loaded) * variance[..., start] + loaded * self._settings.load_n**2
        return np.maximum(variance, mixed[..., statics.group])

    def _loaded_probability(
        self,
        squared_n2: NDArray[np.float64],
        cavity_n2: NDArray[np.float64],
        independent: NDArray[np.float64],
        sigma_n: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return (groups,) the probability p_n of a load, with the cavity's covariance taken as isotropic."""
        without = cavity_n2 + sigma_n**2
        with_load = cavity_n2 + self._settings.load_n**2
        log_ratio = 0.5 * independent * np.log(without / with_load) + 0.5 * squared_n2 * (1 / without - 1 / with_load)
        return np.asarray(expit(logit(self._settings.loaded_share) + log_ratio))


def _loads(
    frame: LinearFrame,
    statics: Statics,
    mean_m: NDArray[np.float64],
    step_m: NDArray[np.float64],
    covariance_m2: NDArray[np.float64],
) -> ExternalLoads:
    """Return the loads on (..., nodes, 3) shapes, (..., free) steps away from where the factors are linearised."""
    force_n = frame.force_n + (frame.force_jacobian @ step_m[..., None])[..., 0]
    variance = propagated_variance(frame.force_jacobian, covariance_m2)
    return external_loads(statics, mean_m, force_n, variance)


def moments_of(
    variance: NDArray[np.float64], cubic: NDArray[np.float64], quartic: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Return the (...,) means of a, a^2, a^3 and a^4 with the density exp(-E).

    E is a^2 / (2 s^2) + c_3 a^3 / 2 + c_4 a^4 / 8. Where E falls again beyond a maximum, the density counts by a share
    that is 1 up to the first of `BARRIERS` and 0 from the second on.

    Args:
        variance: (...,) s^2.
        cubic: (...,) c_3.
        quartic: (...,) c_4, at least c_3^2 s^2, so that E is nowhere negative; smaller ones count as that.
    """
    sigma = np.sqrt(variance)
    # in units of s
    skew = (cubic * sigma**3)[..., None]
    flat = np.maximum(quartic * variance**2, skew[..., 0] ** 2)[..., None]
    reach = np.minimum(FARTHEST_STEP, 2 * (8 * ENOUGH / np.maximum(flat, 1e-12)) ** 0.25)
    step = reach * STEPS
    error = 0.5 * step**2 + 0.5 * skew * step**3 + 0.125 * flat * step**4
    middle = len(STEPS) // 2
    below, above = _share_beyond(error[..., middle::-1])[..., ::-1], _share_beyond(error[..., middle:])
    density = np.concatenate([below, above[..., 1:]], axis=-1) * np.exp(-error)
    density /= density.sum(axis=-1, keepdims=True)
    return tuple(np.asarray(sigma**n * np.sum(density * step**n, axis=-1)) for n in (1, 2, 3, 4))


def _share_beyond(error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., steps) by which share the density of each step counts, one farther out after the other."""
    highest = np.maximum.accumulate(error, axis=-1)
    beyond = np.maximum.accumulate(np.where(error < highest, highest, 0.0), axis=-1)
    lower, upper = BARRIERS
    return np.clip((upper - beyond) / (upper - lower), 0.0, 1.0)
