"""Which parts of the geometry were told wrongly, by the evidence at rest; see `rest_step`."""

from itertools import combinations

import numpy as np

from ...models.structure.rest_shape import RestSource, UncertainPart
from ...models.values.errors import IndeterminateError
from .rest_problem import MOST_STEPS, Minimum, RestProblem

LOG_PRIOR_ODDS = 3.0
"""Log of the prior odds of a part told correctly to one told wrongly: one trial in twenty."""
ASIDE_M = 0.0015
"""Distance of an anchor from where it is told to be, beyond which the axes may be others: less is an error of measured
positions, by which the nodes are as little off."""
ALIKE_LOG_ODDS = 10.0
"""Log of the odds of wrong anchors to wrong axes, below which one cannot be told from the other: 1 to 4 where a shape
was measured in axes that are turned by 1 to 4 degrees or shifted by 3 mm, 36 or more where each anchor is 2 mm off."""


def most_probable(told: RestProblem, source: RestSource) -> tuple[RestProblem, Minimum, tuple[UncertainPart, ...]]:
    """Return the problem of most evidence, its minimum, and the parts of the geometry that it takes as told wrongly.

    Several parts are asked for together only where one is wrong, and the shape was measured: lengths alone, of which
    some may be wrong, do not tell them apart. Lengths whose sensors are wrong are less certain.

    Raises:
        IndeterminateError: when none of them has a minimum.
    """
    parts = _uncertain_parts(told, source)
    minima = {wrong: _minimum(told, wrong) for wrong in [(), *((part,) for part in parts)]}
    anchors = told.structure.anchors
    aside_m = told.position_m(minima["anchors",][1].z)[anchors] - told.structure.anchor_position_m
    if source == "measured" and told.structure.is_held and np.abs(aside_m).max() >= ASIDE_M:
        parts.append("axes")
        minima["axes",] = _minimum(told, ("axes",))

    def log_odds(wrong: tuple[UncertainPart, ...]) -> float:
        improbable = len(wrong) + ("hubs" in wrong and "natural lengths" in parts)  # tendons rarely end beside rods
        return minima[wrong][1].log_evidence - LOG_PRIOR_ODDS * improbable

    likeliest = max(minima, key=log_odds)
    wrong_lengths, evidence = _with_wrong_lengths(told, minima[()][1])
    if wrong_lengths is not told and evidence - LOG_PRIOR_ODDS > log_odds(likeliest):
        return most_probable(wrong_lengths, source)
    if likeliest and source == "measured":
        together = [wrong for count in range(2, len(parts) + 1) for wrong in combinations(parts, count)]
        together = [wrong for wrong in together if not ("axes" in wrong and {"anchors", "rest shape"} & {*wrong})]
        minima |= {wrong: _minimum(told, wrong) for wrong in together}
        likeliest = max(minima, key=log_odds)
        by_axes = tuple(part for part in (*likeliest, "axes") if part != "anchors")
        if "anchors" in likeliest and by_axes in minima and log_odds(likeliest) - log_odds(by_axes) < ALIKE_LOG_ODDS:
            likeliest = by_axes
    problem, minimum = minima[likeliest]
    if np.isinf(minimum.log_evidence):
        raise IndeterminateError(
            f"no forces of the tendons balance at rest, in {MOST_STEPS} steps: are all lengths in m, the stiffnesses "
            "in N/m and the masses in kg?"
        )
    return problem, minimum, likeliest


def _minimum(told: RestProblem, wrong: tuple[UncertainPart, ...]) -> tuple[RestProblem, Minimum]:
    """Return the problem in which some parts are wrong, and its minimum; of several ones that of most evidence."""
    tried = [(problem, problem.minimum()) for problem in told.less_certain(wrong)]
    return max(tried, key=lambda one: one[1].log_evidence)


def _uncertain_parts(told: RestProblem, source: RestSource) -> list[UncertainPart]:
    """Return the parts of the geometry that may have been told wrongly, without the axes of a measured shape."""
    parts: list[UncertainPart] = ["rods", "anchors"]
    if source == "measured":
        parts.append("rest shape")
    if told.nominal is not None and told.geometry.hub_radius_m == 0:
        parts.append("hubs")
    if told.nominal is not None and source == "lengths":
        parts.append("natural lengths")
    return parts


def _with_wrong_lengths(told: RestProblem, minimum: Minimum) -> tuple[RestProblem, float]:
    """Return the problem of most evidence in which no length or some are wrong, and the log of its evidence."""
    best = told, minimum.log_evidence
    wider = told.with_wrong_length(minimum.z)
    while wider is not None:
        minimum = wider.minimum()
        if minimum.log_evidence > best[1]:
            best = wider, minimum.log_evidence
        wider = wider.with_wrong_length(minimum.z)
    return best
