"""A whole trial of the twin: from a plan to what the boards send, and what was true."""

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..structure.form_finding import find_rest_shape
from ..structure.natural_lengths import strip_length_m
from ..structure.structure import Structure
from ..values.readings import BoardReading, OtherReading
from .emulated_boards import Signal, board_rows
from .engine import Twin, TwinMotion
from .geometry_error import end_to_end_m, hub_offset_m
from .loads import Load, Loads
from .mjcf import Body
from .motors import wound_m
from .plan import Plan
from .specimens import Sensors, Specimens, drift
from .trial_metadata import told_geometry, trial_metadata

TOUCHING_M = 2e-4
"""Height of a node above one that stands, below which it stands too: the ground is as soft as the engine's step."""


@dataclass(frozen=True, slots=True, eq=False)
class VirtualTrial:
    """What a trial directory holds."""

    metadata: Mapping[str, Any]
    """trial.toml."""
    readings: list[BoardReading]
    """Of all boards, in order of arrival."""
    t_s: NDArray[np.float64]
    """(rows,) of the truth, host clock."""
    node_position_m: NDArray[np.float64]
    """(rows, nodes, 3)"""
    load_n: NDArray[np.float64]
    """(rows, nodes, 3)"""
    carried: list[OtherReading]
    """Of all further sensors and the motors, in order of time."""
    standing: NDArray[np.bool_] | None
    """(rows, nodes) which nodes stand on the ground; None without ground."""


@dataclass(frozen=True, slots=True, eq=False)
class RandomStreams:
    """The random numbers of one seed.

    Each use has its own stream, so that another load, for example, does not change the sensors.
    """

    body: np.random.Generator
    """For what differs from tendon to tendon."""
    loads: np.random.Generator
    """For random presses."""
    rest: np.random.Generator
    """For the measurement of the rest shape."""
    specimens: np.random.Generator
    """For what differs from sensor to sensor."""
    drift: np.random.Generator
    """For `[sensors]`, the drift that every sensor has."""
    boards: list[np.random.Generator]
    """One for each board."""
    hubs: np.random.Generator
    """For the radii of hubs."""
    told: np.random.Generator
    """For the errors of the geometry in trial.toml."""
    slow_drift: np.random.Generator
    """For `[drift]`."""
    hugs: np.random.Generator
    shakes: np.random.Generator
    wind: np.random.Generator
    tips: np.random.Generator
    carried: np.random.Generator
    """For inertial sensors, ranges and positions."""
    motors: np.random.Generator
    lifts: np.random.Generator

    @classmethod
    def of(cls, seed: int, boards: int) -> "RandomStreams":
        """Return the streams of a seed, which are spawned in the order of the fields.

        The streams of the causes follow all others, so that a plan without causes makes the same trial as it did before
        there were any.
        """
        root = np.random.SeedSequence(seed)
        body, loads, rest, specimens, of_drift, *of_boards = map(np.random.default_rng, root.spawn(5 + boards))
        return cls(body, loads, rest, specimens, of_drift, of_boards, *map(np.random.default_rng, root.spawn(10)))


def simulate(plan: Plan, provenance: str, progress: Callable[[float], None] = lambda share: None) -> VirtualTrial:
    """Return the trial that a plan and its seed make; the same plan and seed make the same trial.

    Args:
        plan: without problems.
        provenance: what trial.toml says about where the trial comes from.
        progress: called now and then with the share of the motion that is done; the sensors follow.

    Raises:
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    streams = RandomStreams.of(plan.seed, len(plan.boards.tendon_of_channel))
    body, start_m = _body(plan, streams)
    structure = body.structure
    twin = Twin(body, plan.mechanics.step_s, start_m)
    twin.settle()
    steps_s = plan.mechanics.step_s * np.arange(plan.steps, dtype=np.float64)
    change_m = wound_m(plan.motor, steps_s, len(structure.tendons), streams.motors)
    motion = twin.run(
        _loads(plan, streams),
        plan.steps,
        wound_m=change_m if plan.motor else None,
        with_turns=bool(plan.imu),
        progress=progress,
    )
    specimens = Specimens.draw(plan.sensors, len(structure.tendons), streams.specimens)
    told = told_geometry(plan, structure, motion.node_position_m[0], streams.rest, streams.told)
    every = round(1 / plan.truth.rate_hz / plan.mechanics.step_s)
    return VirtualTrial(
        metadata=trial_metadata(plan, told, specimens, provenance),
        readings=_readings(plan, _signal(plan, structure, motion, change_m, specimens, streams), streams),
        t_s=motion.t_s[::every],
        node_position_m=motion.node_position_m[::every],
        load_n=motion.load_n[::every],
        carried=_carried(plan, structure, motion, told["structure"]["natural_length_m"], streams),
        standing=_standing(motion)[::every] if plan.ground else None,
    )


def _body(plan: Plan, streams: RandomStreams) -> tuple[Body, NDArray[np.float64]]:
    """Draw what differs from tendon to tendon; return it with the (nodes, 3) shape to start from."""
    mechanics = plan.mechanics
    told = plan.described()
    structure = told.structure
    count = len(structure.tendons)
    natural_m = structure.natural_length_m + mechanics.natural_length_spread_m * streams.body.normal(size=count)
    share = np.maximum(1 + mechanics.tendon_stiffness_spread * streams.body.normal(size=count), 0.1)
    structure = replace(structure, natural_length_m=natural_m)
    start_m = find_rest_shape(structure, told.node_position_m)
    if structure.is_free_standing:  # its caps on the plane z = 0
        lowest_m = float(start_m[:, 2].min())
        start_m = start_m + np.array([0.0, 0.0, float(np.max(mechanics.rod_radius_m)) - lowest_m])
    offset_m = None
    if plan.geometry_error.hub_radius_m is not None:
        offset_m = hub_offset_m(structure, start_m, plan.geometry_error.hub_radius_m, streams.hubs)
        shortened = end_to_end_m(structure, start_m, offset_m) / structure.tendon_length_m(start_m)
        structure = replace(structure, natural_length_m=shortened * natural_m)
    assert told.mechanics is not None, "a plan tells the mechanics"
    body = Body(
        structure=structure,
        rod_mass_kg=told.mechanics.rod_mass_kg,
        rod_radius_m=np.array(mechanics.rod_radius_m),
        rod_drag_n_s_per_m=mechanics.rod_drag_n_s_per_m,
        stiffness_n_per_m=told.mechanics.stiffness_n_per_m * share,
        damping_n_s_per_m=mechanics.tendon_damping_n_s_per_m,
        push_back=told.mechanics.push_back,
        gravity_m_per_s2=mechanics.gravity_m_per_s2,
        ground_friction=plan.ground.friction if plan.ground else None,
        hub_offset_m=offset_m,
        rigid=told.bodies,
        knot_mass_kg=replace(told.mechanics, rod_mass_kg=0.0).node_mass_kg(structure),
        own_rods=told.own_rods,
    )
    return body, start_m


def _carried(
    plan: Plan, structure: Structure, motion: TwinMotion, told_natural_m: Sequence[float], streams: RandomStreams
) -> list[OtherReading]:
    """Return the readings of motors, inertial sensors, ranges and positions, in order of time."""
    rng = streams.carried
    readings: list[Iterable[OtherReading]] = [
        *(
            imu.readings(number, motion, structure, plan.mechanics.gravity_m_per_s2, rng)
            for number, imu in enumerate(plan.imu)
        ),
        *(ranges.readings(number, motion, rng) for number, ranges in enumerate(plan.range)),
        *(position.readings(number, motion, rng) for number, position in enumerate(plan.position)),
    ]
    motors = [motor.readings(told_natural_m, plan.duration_s, streams.motors) for motor in plan.motor]
    return list(heapq.merge(*motors, *readings, key=lambda reading: reading.t_s))


def _standing(motion: TwinMotion) -> NDArray[np.bool_]:
    """Return (steps, nodes) which nodes touch the ground, which is below the lowest node at the start."""
    height_m = motion.node_position_m[0, :, 2].min()
    return np.asarray(motion.node_position_m[..., 2] < height_m + TOUCHING_M)


def _loads(plan: Plan, streams: RandomStreams) -> Loads:
    """Draw the loads that the seed decides."""
    told = plan.load
    loads: list[Load] = [*told.press, *told.hold]
    loads += [press for load in told.random for press in load.draw(streams.loads)]
    loads += told.squeeze
    loads += [hug for load in told.hug for hug in load.draw(streams.hugs)]
    loads += [shake for load in told.shake for shake in load.draw(streams.shakes)]
    loads += [load.draw(streams.wind) for load in told.wind]
    loads += [tip for load in told.tip for tip in load.draw(streams.tips)]
    loads += [lift for load in told.lift for lift in load.draw(streams.lifts)]
    return Loads(loads)


def _signal(
    plan: Plan,
    structure: Structure,
    motion: TwinMotion,
    change_m: NDArray[np.float64],
    specimens: Specimens,
    streams: RandomStreams,
) -> Signal:
    """Return the sensors' resistances: each follows its strip's strain, drifts, and is noisy."""
    step_s = plan.mechanics.step_s
    sensors = plan.hysteresis.applied(plan.sensors) if plan.hysteresis else plan.sensors
    strip_m = strip_length_m(structure, [motor.motors for motor in plan.motor])
    string_m = structure.natural_length_m - strip_m + change_m
    strain = (motion.tendon_length_m - string_m) / strip_m - 1
    change = np.array(list(Sensors(sensors, specimens.gain, strain[0]).changes(strain, step_s)))
    noise = np.hypot(sensors.noise_sigma, sensors.noise_share * change)
    change += drift(sensors, len(change), change.shape[1], step_s, streams.drift)
    resistance = 1 + change
    if plan.drift is not None:
        slow = plan.drift.drift(motion.t_s, change.shape[1], streams.slow_drift)
        resistance = resistance * (1 + slow) if plan.drift.of == "resistance" else resistance + slow
    return Signal(motion.t_s, specimens.natural_resistance_ohm * np.maximum(resistance, 0.0), noise)


def _readings(plan: Plan, signal: Signal, streams: RandomStreams) -> list[BoardReading]:
    """Return the rows of all boards, in order of arrival."""
    divider = plan.adc.divider()
    rows = (
        board_rows(board, plan.boards, divider, signal, plan.fault, rng) for board, rng in enumerate(streams.boards)
    )
    return list(heapq.merge(*rows, key=lambda row: row.host_s))
