"""The rest step, before the first frame: it estimates the rest shape, the geometry and the mechanics of the tendons.

Known beforehand, each with its sigma, are the lengths of rods, the positions of anchors, the nominal stiffnesses and
natural lengths, and the shape, if it was measured. Without load the forces balance. The most probable nodes x,
stiffnesses k and natural lengths L0 minimise

    |(l_rod(x) - L_rod) / sigma_rod|^2 + |(x_anchor - a) / sigma_anchor|^2 + |(x - x_known) / sigma_x|^2
        + |r(x; k, L0) / sigma_F|^2 + |log(k / k_nominal) / spread|^2 + |(L0 - L0_given) / sigma_L0|^2

with r of `Statics`, and as further terms the lengths of stiff cables that are taut (`TautCables`), and, where the shape
was not measured, those of the tendons at rest, if these were, |(l(x) - l_rest) / sigma_l|^2. One common scale of
all k does not change the balance; the prior determines it, and it has little effect on shapes. Ratios of k that do not
balance at rest, in contrast, would shift the shape in every frame.

What was told of the geometry may be wrong. The minimum is therefore also computed with each part of it less certain
(rods, anchors, the measured shape or its axes, the ends of the tendons), or several, and the evidence, which is the
Laplace approximation of the probability of all that is known, decides:

    log p = -1/2 (minimum) - 1/2 log |H| - sum log sigma,    H = half the second derivative at the minimum

Rods and anchors keep, in all frames, the lengths and positions that they have in the estimated rest shape. Anchors that
are told too high or too low cannot be told from a rest shape that was measured in tilted axes: where neither is much
more probable, the axes are doubted. Where some error is larger than `LARGEST_SIGMA`, whatever parts are taken as wrong,
more is wrong.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..factors.tendon import TautCables
from ..models.balance.statics import Statics
from ..models.balance.support import Support, in_the_air, standing
from ..models.structure.floor import UP, Floor
from ..models.structure.form_finding import find_rest_shape
from ..models.structure.lengths import length_jacobian, member_length_m
from ..models.structure.mechanics import Mechanics
from ..models.structure.rest_shape import (
    MENDED,
    GeometrySigma,
    RestSettings,
    RestShape,
    RestSource,
    UncertainPart,
    WrongPart,
)
from ..models.structure.rigidity import rigid_motions
from ..models.structure.structure import Structure
from ..models.trial_description import TrialDescription
from ..models.values.errors import IndeterminateError
from ..models.values.readings import RestLengths
from .own_evidence import own_rows

WRONG_ROD_M = 0.001
"""Standard deviation of a rod's length, if the rods are what was told wrongly."""
WRONG_ANCHOR_M = 0.002
"""Standard deviation of an anchor's position per axis, if the anchors are what was told wrongly."""
WRONG_SHAPE_M = 0.002
"""Standard deviation of a measured position per axis, if the measured shape is what was told wrongly."""
WRONG_AXES_M = 0.005
"""Root mean square over the nodes of what a measured shape is moved by, if it was measured in other axes than those of
the anchors: a turn by 2 degrees about its middle, or a shift."""
WRONG_NATURAL_M = 0.003
"""Standard deviation of a natural length, if the natural lengths are what was told wrongly."""
WRONG_LENGTH_M = 0.02
"""Standard deviation of a length that was measured at rest, if its sensor is wrong."""
WRONG_LENGTHS = 2
"""Largest number of such lengths."""
WRONG_HUB_M = 0.0075
"""Distance from a rod's end at which its tendons end, if it was not told that they end on hubs."""
MOST_STEPS = 200
"""Number of steps to a minimum after which there is none; six to eight are usual, from a measured shape."""
LOG_PRIOR_ODDS = 3.0
"""Log of the prior odds of a part told correctly to one told wrongly: one trial in twenty."""
ASIDE_M = 0.0015
"""Distance of an anchor from where it is told to be, beyond which the axes may be others: less is an error of measured
positions, by which the nodes are as little off."""
ALIKE_LOG_ODDS = 10.0
"""Log of the odds of wrong anchors to wrong axes, below which one cannot be told from the other: 1 to 4 where a shape
was measured in axes that are turned by 1 to 4 degrees or shifted by 3 mm, 36 or more where each anchor is 2 mm off."""
LARGEST_SIGMA = 5.0
"""Largest error of all that is known, in standard deviations, beyond which more is wrong: of simulated trials it is 2
to 3.5, where two tendons are exchanged or five lengths are 10 mm too long 6 to 15."""
OFF_FLOOR_M = 0.002
"""Distance of one of the three lowest nodes of the rest shape from standing on the floor, beyond which height or normal
of the floor are others than told."""


def rest_step(
    structure: Structure,
    mechanics: Mechanics | None,
    measured_position_m: NDArray[np.float64] | None,
    geometry: GeometrySigma,
    settings: RestSettings,
    floor: Floor | None = None,
    near_position_m: NDArray[np.float64] | None = None,
    lengths: RestLengths | None = None,
) -> RestShape:
    """Return the rest shape with its covariance, the geometry estimated with it, and the mechanics that balance there.

    Args:
        structure: rods and anchors as told.
        mechanics: the nominal mechanics; None where stiffness is not known, and then forces are not used.
        measured_position_m: (nodes, 3) the measured rest shape; None where it was not measured.
        geometry: how exactly rods, anchors and the ends of the tendons are known.
        settings: the standard deviations of what else is known beforehand.
        floor: the floor that the structure stands on; None where anchors hold it.
        near_position_m: (nodes, 3) about the rest shape, from which the search for it starts, if it was not measured.
        lengths: the lengths of the tendons as they were measured at rest, nan of those that were not; None without any.

    Raises:
        IndeterminateError: when neither a measurement nor form finding gives a shape, or no forces balance there.
    """
    known_m, sigma_m = _known_shape(structure, mechanics, measured_position_m, near_position_m, settings)
    support = _support(structure, mechanics, known_m, floor)
    is_body = structure.is_free_standing and floor is None  # it has no place of which it may be uncertain
    root_m = _root_m(known_m, sigma_m, settings.measured_sigma_m if is_body else sigma_m)
    told = _RestProblem(structure, mechanics, known_m, root_m, geometry, settings, support, lengths)
    source: RestSource = "measured" if measured_position_m is not None else "found" if lengths is None else "lengths"
    problem, minimum, parts = _most_probable(told, source)
    position_m = problem.position_m(minimum.z)
    coordinates = problem.coordinates
    covariance = np.linalg.inv(minimum.information)[:coordinates, :coordinates]
    wrong: tuple[WrongPart, ...] = parts
    is_mended = MENDED.issuperset(parts)
    if is_mended and minimum.largest_error > LARGEST_SIGMA:
        wrong = ("several",)
    elif not wrong and floor is not None and floor.normal_sigma_rad == 0 and _is_off(floor, position_m):
        wrong = ("floor",)
    elif is_mended and measured_position_m is None and near_position_m is None and not structure.is_held:
        wrong = ("mirror",)
    found = RestShape(
        structure=replace(
            structure,
            rod_length_m=member_length_m(position_m, structure.rods),
            anchor_position_m=position_m[structure.anchors],
        ),
        node_position_m=position_m,
        covariance_m2=problem.root_m @ covariance @ problem.root_m.T,
        source=source,
        wrong=wrong,
    )
    return found if mechanics is None else _balanced(found, problem, minimum, mechanics)


def rest_shape_of(trial: TrialDescription, settings: RestSettings, lengths: RestLengths | None = None) -> RestShape:
    """Return the rest shape of a trial as its description tells it, and lengths at rest, if any; see `rest_step`."""
    rest = rest_step(
        trial.structure,
        trial.mechanics,
        trial.rest_position_m,
        trial.geometry,
        settings,
        trial.floor,
        trial.near_position_m,
        lengths,
    )
    return replace(rest, at_start=trial.rest_seconds > 0)


def _known_shape(
    structure: Structure,
    mechanics: Mechanics | None,
    measured_position_m: NDArray[np.float64] | None,
    near_position_m: NDArray[np.float64] | None,
    settings: RestSettings,
) -> tuple[NDArray[np.float64], float]:
    """Return (nodes, 3) the rest shape as known beforehand, measured or found, and its standard deviation per axis."""
    if measured_position_m is not None:
        return measured_position_m, settings.measured_sigma_m
    found_m = structure.with_anchors_placed(find_rest_shape(structure, near_position_m))
    # with mechanics the equilibrium corrects the shape; without, it is that of equally stiff tendons
    return found_m, settings.found_sigma_m if mechanics is None else float(structure.rod_length_m.mean())


def _balanced(found: RestShape, problem: "_RestProblem", minimum: "_Minimum", nominal: Mechanics) -> RestShape:
    """Return the rest shape with the mechanics whose forces balance there, and their covariance."""
    structure, settings = problem.structure, problem.settings
    tared = problem.tared(nominal, minimum.z)
    supported = problem.supported(minimum.z)
    as_given = Statics(structure, nominal).supported(supported)
    as_tared = Statics(structure, tared).supported(supported)
    unbalanced_n = (_rms_n(as_given, found.node_position_m), _rms_n(as_tared, found.node_position_m))
    if problem.geometry.hub_radius_m > 0:
        tared = replace(tared, offset_n=-as_tared.node_residual_n(found.node_position_m))
    tendons = len(structure.tendons)
    scale = np.repeat([settings.stiffness_spread, settings.natural_length_sigma_m], tendons)
    of_mechanics = slice(problem.coordinates, None)
    by_mechanics = np.linalg.inv(minimum.information[of_mechanics, of_mechanics])[: 2 * tendons, : 2 * tendons]
    return replace(
        found,
        mechanics=tared,
        mechanics_covariance=scale[:, None] * by_mechanics * scale,
        unbalanced_n=unbalanced_n,
        hub_force_n=problem.hub_force_n,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Minimum:
    """The most probable z of one problem."""

    z: NDArray[np.float64]
    information: NDArray[np.float64]
    """Half the second derivative of the sum at z."""
    log_evidence: float
    """Up to a constant that all problems have in common."""
    largest_error: float
    """Of all that is known, in standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class _RestProblem:
    """The sum to minimise as a function of z.

    z holds the deviations of nodes, log stiffnesses, natural lengths, and forces of the floor at the nodes that it
    carries from their known values, each divided by its sigma, or by the root of their covariance.
    """

    structure: Structure
    nominal: Mechanics | None
    known_m: NDArray[np.float64]
    """(nodes, 3) the positions known beforehand, x_known."""
    root_m: NDArray[np.float64]
    """(3 nodes, 3 nodes) square root of the covariance of known_m."""
    geometry: GeometrySigma
    settings: RestSettings
    support: Support | None
    """The force of gravity and floor; None without mechanics."""
    lengths: RestLengths | None
    """The measured lengths of the tendons; None without any."""

    @property
    def coordinates(self) -> int:
        """The number of coordinates, with which z begins."""
        return 3 * self.structure.node_count

    @property
    def hub_force_n(self) -> float:
        """Standard deviation of the unbalanced force at a node, whose tendons pull in the direction of a hub."""
        if self.nominal is None:
            return 0.0
        length_m = self.structure.tendon_length_m(self.known_m)
        tension_n = self.nominal.stiffness_n_per_m * np.maximum(length_m - self.nominal.natural_length_m, 0)
        tension_n[self.nominal.stiff_cables] = 0.0  # unknown
        squared = np.zeros(self.structure.node_count)
        np.add.at(squared, self.structure.tendons, ((tension_n / length_m) ** 2)[:, None])
        return self.geometry.hub_radius_m * float(np.sqrt(squared.mean() / 3))

    def position_m(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (nodes, 3) positions at z."""
        return self.known_m + (self.root_m @ z[: self.coordinates]).reshape(-1, 3)

    def tared(self, nominal: Mechanics, z: NDArray[np.float64]) -> Mechanics:
        """Return the nominal mechanics with the stiffnesses and natural lengths at z."""
        tendons = len(self.structure.tendons)
        by_log_stiffness, by_length = z[self.coordinates : self.coordinates + 2 * tendons].reshape(2, -1)
        stiffness = nominal.stiffness_n_per_m * np.exp(self.settings.stiffness_spread * by_log_stiffness)
        natural_length_m = nominal.natural_length_m + self.settings.natural_length_sigma_m * by_length
        return replace(nominal, stiffness_n_per_m=stiffness, natural_length_m=natural_length_m)

    def less_certain(self, wrong: tuple[UncertainPart, ...]) -> "_RestProblem":
        """Return the problem in which some parts of the geometry may be as far off as they are where told wrongly."""
        problem = self
        for part in wrong:
            problem = problem._less_certain(part)
        return problem

    def _less_certain(self, part: UncertainPart) -> "_RestProblem":
        geometry, settings = self.geometry, self.settings
        measured_m = settings.measured_sigma_m
        match part:
            case "rods":
                rod_length_m = max(geometry.rod_length_m, WRONG_ROD_M)
                return replace(self, geometry=replace(geometry, rod_length_m=rod_length_m))
            case "anchors":
                return replace(self, geometry=replace(geometry, anchor_m=max(geometry.anchor_m, WRONG_ANCHOR_M)))
            case "rest shape":
                return replace(self, root_m=max(measured_m, WRONG_SHAPE_M) * np.eye(self.coordinates))
            case "axes":
                moved_m = float(np.hypot(measured_m, WRONG_AXES_M * np.sqrt(self.structure.node_count)))
                return replace(self, root_m=_root_m(self.known_m, measured_m, moved_m))
            case "hubs":
                return replace(self, geometry=replace(geometry, hub_radius_m=WRONG_HUB_M))
            case "natural lengths":
                natural_m = max(settings.natural_length_sigma_m, WRONG_NATURAL_M)
                return replace(self, settings=replace(settings, natural_length_sigma_m=natural_m))

    def minimum(self) -> _Minimum:
        """Return the z that minimises |rows(z)|^2 + |z|^2."""
        size = self.coordinates + (2 * len(self.structure.tendons) + 3 * len(self._carried) if self.nominal else 0)
        solution = least_squares(
            lambda z: np.concatenate([self.rows(z)[0], z]),
            np.zeros(size),
            lambda z: np.concatenate([self.rows(z)[1], np.eye(size)]),
            method="lm",
            xtol=1e-10,
            max_nfev=MOST_STEPS,
        )
        hessian = solution.jac.T @ solution.jac
        log_sigma = len(self.structure.rods) * np.log(self.geometry.rod_length_m)
        log_sigma += 3 * len(self.structure.anchors) * np.log(self.geometry.anchor_m)
        if self.nominal:
            statics = Statics(self.structure, self.nominal)
            log_sigma += statics.rank * np.log(self._force_sigma_n)
        if self.lengths:
            log_sigma += np.log(self.lengths.sigma_m[self.lengths.is_read]).sum()
        log_evidence = -solution.cost - 0.5 * np.linalg.slogdet(hessian)[1] - log_sigma
        return _Minimum(
            z=solution.x,
            information=hessian,
            log_evidence=float(log_evidence) if solution.success else -np.inf,
            largest_error=float(np.abs(solution.fun).max()),
        )

    def rows(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals over their sigmas, without those of the priors, and their Jacobian by z."""
        position_m = self.position_m(z)
        structure = self.structure
        rod_error = member_length_m(position_m, structure.rods) - structure.rod_length_m
        cable_rows, by_cables = self._cables(position_m)
        length_rows, by_lengths = self._lengths(position_m)
        anchor_error = (position_m[structure.anchors] - structure.anchor_position_m).ravel()
        by_position = np.concatenate(
            [
                length_jacobian(position_m, structure.rods) / self.geometry.rod_length_m,
                np.eye(self.coordinates)[structure.anchored_coordinates] / self.geometry.anchor_m,
                by_cables,
                by_lengths,
            ]
        )
        jacobian = np.zeros((len(by_position), len(z)))
        jacobian[:, : self.coordinates] = by_position @ self.root_m
        force_rows, force_jacobian = self._balance(z)
        of_geometry = [rod_error / self.geometry.rod_length_m, anchor_error / self.geometry.anchor_m]
        rows = [*of_geometry, cable_rows, length_rows, force_rows]
        return np.concatenate(rows), np.concatenate([jacobian, force_jacobian])

    def _cables(self, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of taut cables over their sigma, and their Jacobian; no rows without stiff cables."""
        if self.nominal is None or not len(self.nominal.stiff_cables):
            return np.zeros(0), np.zeros((0, self.coordinates))
        return own_rows([TautCables.of(self.structure, self.nominal, by_forces=False)], 0.0, position_m)

    def with_wrong_length(self, z: NDArray[np.float64]) -> "_RestProblem | None":
        """Return the problem in which the length that fits worst at z is wrong; None where enough are, or all are."""
        lengths = self.lengths
        if lengths is None or np.count_nonzero(lengths.sigma_m == WRONG_LENGTH_M) >= WRONG_LENGTHS:
            return None
        is_trusted = lengths.is_read & (lengths.sigma_m < WRONG_LENGTH_M)
        if not is_trusted.any():
            return None
        apart_m = member_length_m(self.position_m(z), self.structure.tendons) - lengths.length_m
        apart = np.where(is_trusted, np.abs(apart_m) / lengths.sigma_m, -np.inf)
        worst = np.arange(len(apart)) == np.argmax(apart)
        return replace(self, lengths=replace(lengths, sigma_m=np.where(worst, WRONG_LENGTH_M, lengths.sigma_m)))

    def _lengths(self, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of measured lengths over their sigma, and their Jacobian; no rows without any."""
        if self.lengths is None:
            return np.zeros(0), np.zeros((0, self.coordinates))
        read = self.lengths.is_read
        tendons, sigma_m = self.structure.tendons[read], self.lengths.sigma_m[read]
        error_m = member_length_m(position_m, tendons) - self.lengths.length_m[read]
        return error_m / sigma_m, length_jacobian(position_m, tendons) / sigma_m[:, None]

    @property
    def _carried(self) -> NDArray[np.int64]:
        """(carried,) the nodes that the floor may carry."""
        if self.support is None:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(np.trace(self.support.covariance_n2, axis1=1, axis2=2) > 0)

    @property
    def _support_root_n(self) -> NDArray[np.float64]:
        """(carried, 3, 3) square root of the covariance of the floor's force, which is 0 along it at a bare touch."""
        assert self.support is not None, "forces need mechanics"
        variance, axes = np.linalg.eigh(self.support.covariance_n2[self._carried])
        return np.asarray(axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :])

    def supported(self, z: NDArray[np.float64]) -> Support:
        """Return the force of gravity and floor at z."""
        assert self.support is not None, "forces need mechanics"
        carried = self._carried
        force_n = self.support.force_n.copy()
        force_n[carried] += np.einsum("nij,nj->ni", self._support_root_n, z[len(z) - 3 * len(carried) :].reshape(-1, 3))
        return Support(force_n, np.zeros_like(self.support.covariance_n2))

    @property
    def _force_sigma_n(self) -> float:
        return float(np.hypot(self.settings.force_sigma_n, self.hub_force_n))

    def _balance(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the residuals of `Statics` over their sigma, and their Jacobian by z; no rows without mechanics."""
        if self.nominal is None:
            return np.zeros(0), np.zeros((0, len(z)))
        assert self.support is not None, "forces need mechanics"
        statics = Statics(self.structure, self.tared(self.nominal, z)).supported(self.supported(z))
        position = self.position_m(z)
        carried = self._carried
        by_force = statics.outer_force_jacobian(position).reshape(len(statics.group), -1, 3)[:, carried]
        by_force = np.einsum("rnj,nji->rni", by_force, self._support_root_n)
        r, by_position = statics.residual_and_jacobian(position)
        by_log_stiffness, by_natural_length = statics.mechanics_jacobian(position)
        parts = [
            by_position @ self.root_m,
            self.settings.stiffness_spread * by_log_stiffness,
            self.settings.natural_length_sigma_m * by_natural_length,
            by_force.reshape(len(r), -1),
        ]
        return r / self._force_sigma_n, np.concatenate(parts, axis=1) / self._force_sigma_n


def _most_probable(told: _RestProblem, source: RestSource) -> tuple[_RestProblem, _Minimum, tuple[UncertainPart, ...]]:
    """Return the problem of most evidence, its minimum, and the parts of the geometry that it takes as told wrongly.

    Several parts are asked for together only where one is wrong, and the shape was measured: lengths alone, of which
    some may be wrong, do not tell them apart. Lengths whose sensors are wrong are less certain.

    Raises:
        IndeterminateError: when none of them has a minimum.
    """
    parts = _uncertain_parts(told, source)
    minima = {wrong: told.less_certain(wrong).minimum() for wrong in [(), *((part,) for part in parts)]}
    anchors = told.structure.anchors
    aside_m = told.position_m(minima["anchors",].z)[anchors] - told.structure.anchor_position_m
    if source == "measured" and told.structure.is_held and np.abs(aside_m).max() >= ASIDE_M:
        parts.append("axes")
        minima["axes",] = told.less_certain(("axes",)).minimum()

    def log_odds(wrong: tuple[UncertainPart, ...]) -> float:
        less = len(wrong) + ("hubs" in wrong and "natural lengths" in parts)  # tendons rarely end beside rods
        return minima[wrong].log_evidence - LOG_PRIOR_ODDS * less

    likeliest = max(minima, key=log_odds)
    wrong_lengths, evidence = _with_wrong_lengths(told, minima[()])
    if wrong_lengths is not told and evidence - LOG_PRIOR_ODDS > log_odds(likeliest):
        return _most_probable(wrong_lengths, source)
    if likeliest and source == "measured":
        together = [wrong for count in range(2, len(parts) + 1) for wrong in combinations(parts, count)]
        together = [wrong for wrong in together if not ("axes" in wrong and {"anchors", "rest shape"} & {*wrong})]
        minima |= {wrong: told.less_certain(wrong).minimum() for wrong in together}
        likeliest = max(minima, key=log_odds)
        by_axes = tuple(part for part in (*likeliest, "axes") if part != "anchors")
        if "anchors" in likeliest and by_axes in minima and log_odds(likeliest) - log_odds(by_axes) < ALIKE_LOG_ODDS:
            likeliest = by_axes
    if np.isinf(minima[likeliest].log_evidence):
        raise IndeterminateError(
            f"no forces of the tendons balance at rest, in {MOST_STEPS} steps: are all lengths in m, the stiffnesses "
            "in N/m and the masses in kg?"
        )
    return told.less_certain(likeliest), minima[likeliest], likeliest


def _uncertain_parts(told: _RestProblem, source: RestSource) -> list[UncertainPart]:
    """Return the parts of the geometry that may have been told wrongly, without the axes of a measured shape."""
    parts: list[UncertainPart] = ["rods", "anchors"]
    if source == "measured":
        parts.append("rest shape")
    if told.nominal is not None and told.geometry.hub_radius_m == 0:
        parts.append("hubs")
    if told.nominal is not None and source == "lengths":
        parts.append("natural lengths")
    return parts


def _with_wrong_lengths(told: _RestProblem, minimum: _Minimum) -> tuple[_RestProblem, float]:
    """Return the problem of most evidence in which no length or some are wrong, and the log of its evidence."""
    best = told, minimum.log_evidence
    wider = told.with_wrong_length(minimum.z)
    while wider is not None:
        minimum = wider.minimum()
        if minimum.log_evidence > best[1]:
            best = wider, minimum.log_evidence
        wider = wider.with_wrong_length(minimum.z)
    return best


def _root_m(known_m: NDArray[np.float64], sigma_m: float, moved_m: float) -> NDArray[np.float64]:
    """Return the root of the covariance of (nodes, 3) positions.

    Args:
        known_m: (nodes, 3) the positions.
        sigma_m: standard deviation per axis of a node in the shape.
        moved_m: standard deviation of the shape along each of its shifts and turns, over all nodes.
    """
    motions = rigid_motions(known_m)
    return np.asarray(sigma_m * np.eye(known_m.size) + (moved_m - sigma_m) * motions @ motions.T)


def _is_off(floor: Floor, rest_m: NDArray[np.float64]) -> bool:
    """Return whether the three lowest nodes of (nodes, 3) a rest shape are elsewhere than nodes that stand."""
    return bool(np.abs(np.sort(floor.clearance_m(rest_m))[:3]).max() > OFF_FLOOR_M)


def _support(
    structure: Structure, mechanics: Mechanics | None, node_position_m: NDArray[np.float64], floor: Floor | None
) -> Support | None:
    """Return the force of gravity and floor at rest; None without mechanics."""
    if mechanics is None:
        return None
    if floor is None:
        return in_the_air(structure, mechanics.node_mass_kg(structure))
    carried = floor.carries_at_rest(node_position_m).astype(np.float64)
    return standing(mechanics.node_mass_kg(structure), node_position_m, UP, 0.0, carried)


def _rms_n(statics: Statics, position_m: NDArray[np.float64]) -> float:
    """Return the root mean square of the unbalanced forces."""
    return float(np.sqrt(np.mean(statics.residual_n(position_m) ** 2)))
