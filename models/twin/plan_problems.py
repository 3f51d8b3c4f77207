"""What cannot be simulated of a plan, key by key."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..balance.joined_rods import JoinedRods
from ..structure.structure import Structure
from ..structure_description import DescribedStructure
from ..values.errors import InputError
from .emulated_boards import BoardPhysics, Unplugged
from .load_problems import problems_of_loads
from .motors import problems_of_motors
from .plan import Plan
from .specimens import SensorPhysics

LARGEST_HUB = 0.25
"""Largest radius of a hub, as a share of the shortest tendon."""
CARRIED = ("imu", "range", "position", "motor")
"""Lists of a plan whose entries have a rate."""
LARGEST_ERROR = 0.1
"""Largest standard deviation or offset of a length, as a share of the shortest one."""


MOST_BYTES = 8 << 30
"""Memory that a simulation may take: half an hour of the paper's structure, in steps of a millisecond, takes 6 GiB."""
BYTES_PER_ROW = 1000
"""Memory that a row of a board or of another sensor takes, as the object that a recorder is given."""
LONGEST_DELAY_S = 60.0
"""Longest delay of a row of a board in a plan; ports take milliseconds."""
LEAST_STEP_S = 1e-4
"""Shortest step of the integration: coming to rest may take five minutes of simulated time."""


def problems(plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what cannot be simulated: the dotted key, and what was expected and found."""
    yield from (
        (key, f"expected a finite number, got {value}")
        for key, value in _numbers(asdict(plan))
        if not np.isfinite(value)
    )
    try:
        told = plan.described()
        plan.adc.divider()
    except InputError as error:
        key, _, text = str(error).partition(": ")
        yield (key if key.startswith(("adc", "body", "mechanics", "structure.")) else f"structure.{key}"), text
        return
    structure = told.structure
    yield from _problems_of_structure(plan, told)
    yield from _problems_of_time(plan)
    yield from _problems_of_size(plan, structure)
    yield from _problems_of_sensors(plan.sensors)
    yield from _problems_of_drift(plan)
    yield from _problems_of_geometry(plan, structure)
    yield from _problems_of_carried(plan, told)
    yield from problems_of_loads(plan, structure)
    yield from problems_of_motors(plan.motor, structure, plan.rest.seconds, plan.duration_s)
    yield from _problems_of_boards(plan.boards, len(structure.tendons), plan.mechanics.step_s)
    yield from _problems_of_faults(plan, len(structure.tendons))


def _problems_of_structure(plan: Plan, told: DescribedStructure) -> Iterator[tuple[str, str]]:
    structure = told.structure
    if plan.ground is not None and len(structure.anchors) in (1, 2):
        yield "ground", f"expected none with {len(structure.anchors)} anchors, from which the structure hangs"
    if plan.ground is None and structure.is_free_standing and plan.mechanics.gravity_m_per_s2 > 0:
        yield "structure.anchors", "expected [ground] where there are none: the structure falls"
    held = structure.anchors if plan.ground is None else np.empty(0, dtype=np.int64)
    assert told.mechanics is not None, "a plan tells the mechanics"
    massless = np.flatnonzero(told.mechanics.node_mass_kg(structure) == 0)
    for node in np.setdiff1d(massless, held):
        yield "mechanics.knot_mass_kg", f"node {node} moves and has no mass: expected some, as it is on no rod"
    yield from _problems_of_parts(plan, told, held)
    position_m = dict(zip(held.tolist(), structure.anchor_position_m, strict=False))
    for rod, ((a, b), length_m) in enumerate(zip(structure.rods.tolist(), structure.rod_length_m, strict=True)):
        if a in position_m and b in position_m:
            apart_m = float(np.linalg.norm(position_m[a] - position_m[b]))
            if abs(apart_m - length_m) > 1e-4:
                yield "structure.anchors", f"rod {rod} is {length_m:g} m long, its anchors {apart_m:g} m apart"


def _problems_of_parts(plan: Plan, told: DescribedStructure, held: NDArray[np.int64]) -> Iterator[tuple[str, str]]:
    for number, nodes in enumerate(told.bodies):
        if np.isin(nodes, held).any() and not np.isin(nodes, held).all():
            yield f"body[{number}].nodes", "expected all of them among the anchors, or none"
    radii = np.size(plan.mechanics.rod_radius_m)
    if np.ndim(plan.mechanics.rod_radius_m) and radii != told.own_rods:
        yield "mechanics.rod_radius_m", f"expected one number or {told.own_rods}, got {radii}"
    if np.ndim(plan.mechanics.rod_radius_m) and plan.ground is not None:
        yield "mechanics.rod_radius_m", f"expected one number with [ground], got {radii}"
    if plan.geometry_error.hub_radius_m is not None and len(JoinedRods(told.structure).rods):
        yield "geometry_error.hub_radius_m", "expected none where rods share a node"


def _problems_of_time(plan: Plan) -> Iterator[tuple[str, str]]:
    step_s = plan.mechanics.step_s
    if plan.rest.seconds >= plan.duration_s:
        yield "rest.seconds", f"expected less than duration_s = {plan.duration_s}, got {plan.rest.seconds}"
    samples = [(f"imu[{number}].rate_hz", 1 / imu.rate_hz) for number, imu in enumerate(plan.imu)]
    for key, period_s in (("duration_s", plan.duration_s), ("truth.rate_hz", 1 / plan.truth.rate_hz), *samples):
        if abs(period_s / step_s - round(period_s / step_s)) > 1e-6 or period_s < step_s:
            yield key, f"expected a whole number of steps of {step_s} s (mechanics.step_s), got {period_s / step_s:.6g}"
            return
    period_us = plan.boards.period_us
    if period_us > 1e6 * plan.duration_s:
        yield "boards.period_us", f"expected a row or more in duration_s = {plan.duration_s}, got {period_us}"


def _problems_of_size(plan: Plan, structure: Structure) -> Iterator[tuple[str, str]]:
    """Yield what would take more memory or time than there is, before any of it is taken."""
    if plan.mechanics.step_s < LEAST_STEP_S:
        yield "mechanics.step_s", f"expected at least {LEAST_STEP_S:g} s, got {plan.mechanics.step_s:g}"
        return
    numbers = 6 * structure.node_count + 10 * len(structure.tendons) + 9 * len(structure.rods)
    steps_bytes = 8.0 * numbers * plan.duration_s / plan.mechanics.step_s
    if steps_bytes > MOST_BYTES:
        yield "duration_s", _too_large(f"{plan.duration_s:g} s in steps of {plan.mechanics.step_s:g} s", steps_bytes)
    rates = {f"{kind}[{k}].rate_hz": one.rate_hz for kind in CARRIED for k, one in enumerate(getattr(plan, kind))}
    rates["boards.period_us"] = len(plan.boards.tendon_of_channel) * 1e6 / plan.boards.period_us
    for key, rate_hz in rates.items():
        rows_bytes = BYTES_PER_ROW * rate_hz * plan.duration_s
        if rows_bytes > MOST_BYTES:
            yield key, _too_large(f"{rate_hz * plan.duration_s:.3g} rows", rows_bytes)


def _too_large(what: str, size_bytes: float) -> str:
    return f"{what} take {size_bytes / 2**30:.3g} GiB of memory: expected at most {MOST_BYTES >> 30} GiB"


def _problems_of_sensors(sensors: SensorPhysics) -> Iterator[tuple[str, str]]:
    corners = sensors.gauge_corner_strain
    for key, expected, got in (
        ("gauge_corner_strain", len(sensors.gauge_factor) - 1, len(corners)),
        ("overstress_time_s", len(sensors.overstress_gain), len(sensors.overstress_time_s)),
        ("hysteresis_strain", len(sensors.hysteresis_gain), len(sensors.hysteresis_strain)),
    ):
        if got != expected:
            yield f"sensors.{key}", f"expected {expected} numbers, got {got}"
    if corners != sorted(corners):
        yield "sensors.gauge_corner_strain", f"expected rising strains, got {corners}"
    for key, share in (("softening", sensors.softening), ("hysteresis_at_rest", sensors.hysteresis_at_rest)):
        if share > 1:
            yield f"sensors.{key}", f"expected at most 1, got {share}"


def _problems_of_drift(plan: Plan) -> Iterator[tuple[str, str]]:
    drift = plan.drift
    if drift is None:
        return
    if drift.from_s >= plan.duration_s:
        yield "drift.from_s", f"expected less than duration_s = {plan.duration_s}, got {drift.from_s}"
    if drift.until_s <= drift.from_s:
        yield "drift.until_s", f"expected a time after from_s = {drift.from_s}, got {drift.until_s}"
    if drift.common_share <= -1:
        yield "drift.common_share", f"expected more than -1, got {drift.common_share}"
    if drift.common_course == "warm_up" and drift.time_constant_s is None:
        yield "drift.common_course", "expected time_constant_s with 'warm_up', got none"
    if drift.common_course == "ramp" and drift.time_constant_s is not None:
        yield "drift.time_constant_s", f"expected none with common_course = 'ramp', got {drift.time_constant_s}"


def _problems_of_geometry(plan: Plan, structure: Structure) -> Iterator[tuple[str, str]]:
    error = plan.geometry_error
    for name, error_m, length_m in (
        ("rod_length_sigma_m", error.rod_length_sigma_m, structure.rod_length_m),
        ("rod_length_offset_m", error.rod_length_offset_m, structure.rod_length_m),
        ("natural_length_sigma_m", error.natural_length_sigma_m, structure.natural_length_m),
    ):
        largest_m = LARGEST_ERROR * length_m.min()
        if abs(error_m) > largest_m:
            yield f"geometry_error.{name}", f"expected at most {largest_m:.3g} m either way, got {error_m}"
    if error.rest_position_sigma_m and plan.rest.node_position_sigma_m is None:
        expected = "expected rest.node_position_sigma_m too, without which the rest shape is not measured"
        yield "geometry_error.rest_position_sigma_m", f"{expected}, got {error.rest_position_sigma_m}"
    if error.hub_radius_m is not None:
        low, high = error.hub_radius_m
        largest_m = LARGEST_HUB * structure.natural_length_m.min()
        if not low <= high <= largest_m:
            yield "geometry_error.hub_radius_m", f"expected [least, most] up to {largest_m:.3g} m, got [{low}, {high}]"


def _problems_of_carried(plan: Plan, told: DescribedStructure) -> Iterator[tuple[str, str]]:
    for number, imu in enumerate(plan.imu):
        if not 0 <= imu.rod < told.own_rods:
            yield f"imu[{number}].rod", f"expected a rod from 0 to {told.own_rods - 1}, got {imu.rod}"
    for number, ranges in enumerate(plan.range):
        if not ranges.beacon_position_m:
            yield f"range[{number}].beacon_position_m", "expected one beacon or more, got none"
    for number, positions in enumerate(plan.position):
        for name in ("seen_s", "hidden_s"):
            if (lasts_s := getattr(positions, name)) < plan.mechanics.step_s:
                yield f"position[{number}].{name}", f"expected mechanics.step_s or more, got {lasts_s:g}"
        for index, node in enumerate(positions.nodes):
            if not 0 <= node < told.structure.node_count:
                expected = f"expected a node from 0 to {told.structure.node_count - 1}, got {node}"
                yield f"position[{number}].nodes[{index}]", expected


def _problems_of_boards(boards: BoardPhysics, tendons: int, step_s: float) -> Iterator[tuple[str, str]]:
    wired: set[int] = set()
    for board, channels in enumerate(boards.tendon_of_channel):
        key = f"boards.tendon_of_channel[{board}]"
        if not channels:
            yield key, "expected at least one tendon, got none"
        for tendon in channels:
            if not 0 <= tendon < tendons:
                yield key, f"expected tendons from 0 to {tendons - 1}, got {tendon}"
            if tendon in wired:
                yield key, f"tendon {tendon} is wired already"
            wired.add(tendon)
    if boards.minimum_delay_s + boards.delay_s > LONGEST_DELAY_S:
        yield "boards.delay_s", f"expected at most {LONGEST_DELAY_S:g} s, got {boards.delay_s:g}"
    if not boards.tendon_of_channel:
        yield "boards.tendon_of_channel", "expected at least one board, got none"
    least_us = round(1e6 * step_s, 3)  # 1e6 * 0.000123 is above 123
    if boards.period_us < least_us:
        yield "boards.period_us", f"expected mechanics.step_s, {least_us:g} us, or more, got {boards.period_us}"


def _problems_of_faults(plan: Plan, tendons: int) -> Iterator[tuple[str, str]]:
    for kind, index, fault in plan.fault.each():
        key = f"fault.{kind}[{index}]"
        if isinstance(fault, Unplugged):
            name = "board"
            number = fault.board
            count = len(plan.boards.tendon_of_channel)
        else:
            name = "tendon"
            number = fault.tendon
            count = tendons
        if not 0 <= number < count:
            yield f"{key}.{name}", f"expected a {name} from 0 to {count - 1}, got {number}"
        elif name == "tendon" and not any(number in channels for channels in plan.boards.tendon_of_channel):
            yield f"{key}.tendon", f"expected a tendon that a board of boards.tendon_of_channel reads, got {number}"
        if not fault.from_s < fault.until_s <= plan.duration_s:
            yield (
                f"{key}.until_s",
                f"expected a time after from_s, up to duration_s = {plan.duration_s}, got {fault.until_s}",
            )


def _numbers(value: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float of a nested table with its dotted key."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _numbers(inner, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _numbers(inner, f"{key}[{index}]")
    elif isinstance(value, float):
        yield key, value
