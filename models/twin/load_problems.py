"""What cannot be simulated of the loads of a plan, key by key."""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from .loads import Hold, Press, RandomPresses, RandomTimes, Squeeze
from .plan import Plan
from .spread_loads import HELD, RandomHugs, RandomLifts, RandomShakes, RandomTips, WindPlan

MOST_LOADS = 2000
"""Largest number of loads that a table may draw: each step of the integration asks all of them. A press each second is
1800 of them in half an hour."""
STEPS_A_CYCLE = 20
"""Fewest steps of the integration in one cycle of a shake."""
RANGES = (
    "pause_s",
    "duration_s",
    "together",
    "force_n",
    "frequency_hz",
    "gust_period_s",
    "height_m",
    "aside_m",
    "turn_rad",
)
"""Keys with the least and the most of what the seed draws, where they are no single number."""
Load = Press | Squeeze | Hold | RandomPresses | RandomHugs | RandomShakes | RandomTips | RandomLifts | WindPlan


def problems_of_loads(plan: Plan, structure: Structure) -> Iterator[tuple[str, str]]:
    """Yield the dotted key of each problem, and what was expected and found."""
    pushable = structure.free_nodes if plan.ground is None else np.arange(structure.node_count)
    for kind in fields(plan.load):
        for index, load in enumerate(getattr(plan.load, kind.name)):
            key = f"load.{kind.name}[{index}]"
            yield from _problems_of_ranges(key, load)
            if isinstance(load, RandomTimes):
                yield from _problems_of_random(key, load, plan)
            yield from _problems_of_course(key, load, plan)
            yield from _problems_of_start(key, load, plan)
            yield from _problems_of_nodes(key, load.nodes, pushable)
            if isinstance(load, Press | Hold | WindPlan) and not np.any(load.direction):
                yield f"{key}.direction", "expected a direction, got zero"


def _problems_of_start(key: str, load: Load, plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the time at which a load begins."""
    if isinstance(load, RandomTimes):
        name = "from_s"
        start_s = load.from_s
    else:
        name = "at_s"
        start_s = load.at_s
    if isinstance(load, Press | Squeeze | Hold) and load.during_rest:
        first = "0.0"
        first_s = 0.0
    else:
        first = f"rest.seconds = {plan.rest.seconds}"
        first_s = plan.rest.seconds
    if not first_s <= start_s < plan.duration_s:
        yield f"{key}.{name}", f"expected a time from {first} to duration_s = {plan.duration_s}, got {start_s}"


def _problems_of_nodes(key: str, nodes: Sequence[int], pushable: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the nodes of a load."""
    for node in nodes:
        if node not in pushable:
            yield f"{key}.nodes", f"expected nodes that can move, of {_listed(pushable)}, got {node}"
    if not nodes or len(set(nodes)) < len(nodes):
        yield f"{key}.nodes", f"expected different nodes, got {_listed(nodes)}"


def _problems_of_random(key: str, load: RandomTimes, plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the times of a load that is drawn."""
    if load.duration_s[0] < plan.mechanics.step_s:
        yield f"{key}.duration_s", f"expected mechanics.step_s or more, got {load.duration_s[0]:g}"
    most = (load.until_s - load.from_s) / (load.pause_s[0] + load.duration_s[0])
    if most > MOST_LOADS:
        yield f"{key}.duration_s", f"expected pauses and durations for {MOST_LOADS} loads at most, got {most:.0f}"
    if load.ramp_share > 0.5:
        yield f"{key}.ramp_share", f"expected at most 0.5, got {load.ramp_share}"
    if load.from_s + load.pause_s[0] + load.duration_s[0] >= load.until_s or load.until_s > plan.duration_s:
        yield (
            f"{key}.until_s",
            f"expected time for one load, and at most duration_s = {plan.duration_s}, got {load.until_s}",
        )


def _problems_of_course(key: str, load: Load, plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with a load's own numbers."""
    if isinstance(load, RandomPresses | RandomHugs | RandomShakes) and load.together[1] > len(load.nodes):
        yield f"{key}.together", f"expected at most {len(load.nodes)}, the number of nodes, got {load.together[1]}"
    if (
        isinstance(load, RandomPresses | RandomShakes)
        and not np.any(load.direction)
        and not np.any(load.direction_sigma)
    ):
        yield f"{key}.direction", "expected a direction, or a direction_sigma, got zero for both"
    if isinstance(load, RandomHugs) and load.together[0] < 2:
        yield f"{key}.together", f"expected at least 2 nodes, got {load.together[0]}"
    if isinstance(load, RandomShakes):
        highest_hz = 1 / (STEPS_A_CYCLE * plan.mechanics.step_s)
        if load.frequency_hz[1] > highest_hz:
            expected = f"expected at most {highest_hz:g}, which is {STEPS_A_CYCLE} steps of mechanics.step_s a cycle"
            yield f"{key}.frequency_hz", f"{expected}, got {load.frequency_hz[1]}"
    if isinstance(load, RandomLifts):
        if len(load.nodes) < HELD:
            yield f"{key}.nodes", f"expected at least {HELD}, got {len(load.nodes)}"
        if plan.ground is None:
            yield key, "expected [ground]: what is lifted has no anchors"


def _problems_of_ranges(key: str, load: Load) -> Iterator[tuple[str, str]]:
    """Yield of which range the least is above the most."""
    for name in RANGES:
        bounds = getattr(load, name, None)
        if isinstance(bounds, tuple) and bounds[0] > bounds[1]:
            yield f"{key}.{name}", f"expected [least, most], got [{bounds[0]}, {bounds[1]}]"


def _listed(nodes: Sequence[int] | NDArray[np.int64]) -> str:
    return ", ".join(map(str, nodes))
