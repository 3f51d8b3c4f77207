"""A plan of the twin: one structure, what is done to it, and what reads it. Every constant is said, none assumed."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from ..sensor.divider import Divider
from ..structure.structure import Structure
from ..trial_description import AdcTable, StructureTable
from ..values.errors import InputError
from ..values.tables import NotNegative, Positive
from .emulated_boards import BoardPhysics, Faults, Unplugged
from .loads import Hold, Press, RandomPresses, Squeeze
from .specimens import SensorPhysics


@dataclass(frozen=True, slots=True)
class MechanicsPlan:
    """`[mechanics]` of a plan."""

    rod_mass_kg: Positive
    rod_radius_m: Positive
    """Of the rod, and of the round ends that touch the ground."""
    rod_drag_n_s_per_m: NotNegative
    """Of one rod that moves sideways: air, and whatever else stops a sway."""
    tendon_stiffness_n_per_m: Positive
    """As one pull test gives it; trial.toml says this."""
    tendon_stiffness_spread: NotNegative
    """Relative standard deviation over tendons."""
    tendon_damping_n_s_per_m: NotNegative
    push_back: NotNegative
    """Stiffness of a bent tendon over that of a stretched one."""
    natural_length_spread_m: NotNegative
    """Standard deviation over tendons, which trial.toml says tendon by tendon, as measured."""
    gravity_m_per_s2: NotNegative
    step_s: Positive
    """Of the integration."""


@dataclass(frozen=True, slots=True)
class GroundPlan:
    """`[ground]`: the structure lies on it, and nothing holds the anchors; without the table they are held."""

    friction: NotNegative
    """Coulomb's coefficient."""


@dataclass(frozen=True, slots=True)
class RestPlan:
    """`[rest]`: how the trial starts."""

    seconds: Positive
    """Unloaded, at rest."""
    node_position_sigma_m: NotNegative | None = None
    """Error, per axis, with which the rest shape is measured for trial.toml; left out: it is not measured."""


@dataclass(frozen=True, slots=True)
class LoadPlan:
    """`[load]`: lists of each kind, none if not named."""

    press: Sequence[Press] = ()
    squeeze: Sequence[Squeeze] = ()
    hold: Sequence[Hold] = ()
    random: Sequence[RandomPresses] = ()


@dataclass(frozen=True, slots=True)
class TruthPlan:
    """`[truth]`: what is written for evaluation."""

    rate_hz: Positive


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan as it stands."""

    name: str
    """The trial's name is this and the seed: press_01."""
    kind: str
    """As in trial.toml."""
    seed: Annotated[int, Ge(0)]
    duration_s: Positive
    structure: StructureTable
    """Nominal; as in trial.toml."""
    mechanics: MechanicsPlan
    rest: RestPlan
    sensors: SensorPhysics
    adc: AdcTable
    boards: BoardPhysics
    truth: TruthPlan
    format: Literal[1] = 1
    ground: GroundPlan | None = None
    load: LoadPlan = field(default_factory=LoadPlan)
    fault: Faults = field(default_factory=Faults)

    @property
    def steps(self) -> int:
        """How many steps the integration takes."""
        return round(self.duration_s / self.mechanics.step_s)


def problems(plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what can not be simulated: the dotted key, and what was expected and found."""
    yield from (
        (key, f"expected a finite number, got {value}")
        for key, value in _numbers(asdict(plan))
        if not np.isfinite(value)
    )
    try:
        structure = plan.structure.structure()
        Divider(plan.adc.bits, plan.adc.known_resistor_ohm, plan.adc.sensor_side)
    except InputError as error:
        key, _, text = str(error).partition(": ")
        yield (key if key.startswith("adc") else f"structure.{key}"), text
        return
    yield from _problems_of_structure(plan, structure)
    yield from _problems_of_time(plan)
    yield from _problems_of_sensors(plan.sensors)
    yield from _problems_of_loads(plan, structure)
    yield from _problems_of_boards(plan.boards, len(structure.tendons))
    yield from _problems_of_faults(plan, len(structure.tendons))


def _problems_of_structure(plan: Plan, structure: Structure) -> Iterator[tuple[str, str]]:
    held = structure.anchors if plan.ground is None else np.empty(0, dtype=np.int64)
    for node in np.setdiff1d(np.setdiff1d(np.arange(structure.node_count), structure.rods), held):
        yield "structure.rods", f"node {node} is on no rod, and nothing holds it: expected a rod, for its mass"
    position_m = dict(zip(held.tolist(), structure.anchor_position_m, strict=False))
    for rod, ((a, b), length_m) in enumerate(zip(structure.rods.tolist(), structure.rod_length_m, strict=True)):
        if a in position_m and b in position_m:
            apart_m = float(np.linalg.norm(position_m[a] - position_m[b]))
            if abs(apart_m - length_m) > 1e-4:
                yield "structure.anchors", f"rod {rod} is {length_m:g} m long, its anchors {apart_m:g} m apart"


def _problems_of_time(plan: Plan) -> Iterator[tuple[str, str]]:
    step_s = plan.mechanics.step_s
    if plan.rest.seconds >= plan.duration_s:
        yield "rest.seconds", f"expected less than duration_s = {plan.duration_s}, got {plan.rest.seconds}"
    for key, period_s in (("duration_s", plan.duration_s), ("truth.rate_hz", 1 / plan.truth.rate_hz)):
        if abs(period_s / step_s - round(period_s / step_s)) > 1e-6 or period_s < step_s:
            yield key, f"expected a whole number of steps of {step_s} s (mechanics.step_s), got {period_s / step_s:.6g}"
            return


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


def _problems_of_loads(plan: Plan, structure: Structure) -> Iterator[tuple[str, str]]:
    pushable = structure.free_nodes if plan.ground is None else np.arange(structure.node_count)
    for index, load in enumerate(plan.load.random):
        yield from _problems_of_random(f"load.random[{index}]", load, plan.duration_s)
    for kind in ("press", "squeeze", "hold", "random"):
        for index, load in enumerate(getattr(plan.load, kind)):
            key = f"load.{kind}[{index}]"
            start, start_s = ("from_s", load.from_s) if kind == "random" else ("at_s", load.at_s)
            if not plan.rest.seconds <= start_s < plan.duration_s:
                expected = f"rest.seconds = {plan.rest.seconds} to duration_s = {plan.duration_s}"
                yield f"{key}.{start}", f"expected a time from {expected}, got {start_s}"
            for node in load.nodes:
                if node not in pushable:
                    yield f"{key}.nodes", f"expected nodes that can move, of {_listed(pushable)}, got {node}"
            if not load.nodes or len(set(load.nodes)) < len(load.nodes):
                yield f"{key}.nodes", f"expected different nodes, got {_listed(load.nodes)}"
            if kind in ("press", "hold") and not np.any(load.direction):
                yield f"{key}.direction", "expected a direction, got zero"


def _problems_of_random(key: str, load: RandomPresses, duration_s: float) -> Iterator[tuple[str, str]]:
    for name in ("pause_s", "duration_s", "together", "force_n"):
        low, high = getattr(load, name)
        if low > high:
            yield f"{key}.{name}", f"expected [least, most], got [{low}, {high}]"
    if load.together[1] > len(load.nodes):
        yield f"{key}.together", f"expected at most {len(load.nodes)}, as there are nodes, got {load.together[1]}"
    if load.ramp_share > 0.5:
        yield f"{key}.ramp_share", f"expected at most 0.5, got {load.ramp_share}"
    if load.from_s + load.pause_s[0] + load.duration_s[0] >= load.until_s or load.until_s > duration_s:
        yield (
            f"{key}.until_s",
            f"expected room for one press, and at most duration_s = {duration_s}, got {load.until_s}",
        )
    if not np.any(load.direction) and not np.any(load.direction_sigma):
        yield f"{key}.direction", "expected a direction, or a direction_sigma, got zero for both"


def _problems_of_boards(boards: BoardPhysics, tendons: int) -> Iterator[tuple[str, str]]:
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
    if not boards.tendon_of_channel:
        yield "boards.tendon_of_channel", "expected at least one board, got none"


def _problems_of_faults(plan: Plan, tendons: int) -> Iterator[tuple[str, str]]:
    for kind, index, fault in plan.fault.each():
        key = f"fault.{kind}[{index}]"
        if isinstance(fault, Unplugged):
            name, number, count = "board", fault.board, len(plan.boards.tendon_of_channel)
        else:
            name, number, count = "tendon", fault.tendon, tendons
        if not 0 <= number < count:
            yield f"{key}.{name}", f"expected a {name} from 0 to {count - 1}, got {number}"
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


def _listed(nodes: Sequence[int] | NDArray[np.int64]) -> str:
    return ", ".join(map(str, nodes))
