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
more probable, the axes are doubted. Several parts are tried where one is wrong and the shape was measured. Where some
error is larger than `LARGEST_SIGMA`, although rods, anchors or natural lengths may be wrong, more is wrong.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.balance.statics import Statics
from ...models.balance.support import Support, in_the_air, standing
from ...models.structure.floor import UP, Floor
from ...models.structure.form_finding import find_rest_shape
from ...models.structure.lengths import member_length_m
from ...models.structure.mechanics import Mechanics
from ...models.structure.rest_shape import MENDED, GeometrySigma, RestSettings, RestShape, RestSource, WrongPart
from ...models.structure.structure import Structure
from ...models.trial_description import TrialDescription
from ...models.values.readings import RestLengths
from .rest_problem import Minimum, RestProblem, covariance_root_m
from .wrong_parts import most_probable

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
    root_m = covariance_root_m(known_m, sigma_m, settings.measured_sigma_m if is_body else sigma_m)
    told = RestProblem(structure, mechanics, known_m, root_m, geometry, settings, support, lengths)
    source: RestSource = "measured" if measured_position_m is not None else "found" if lengths is None else "lengths"
    problem, minimum, parts = most_probable(told, source)
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


def _balanced(found: RestShape, problem: RestProblem, minimum: Minimum, nominal: Mechanics) -> RestShape:
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
