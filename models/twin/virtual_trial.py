"""A whole trial of the twin: from a plan to what the boards send, and what was true."""

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..sensor.divider import Divider
from ..structure.rigidity import find_rest_shape
from ..structure.structure import Structure
from ..values.readings import BoardReading
from .emulated_boards import Signal, board_rows
from .engine import Twin, TwinMotion
from .geometry_error import ToldErrors, end_to_end_m, hub_offset_m
from .loads import Loads, SpreadLoad
from .mjcf import Body
from .plan import Plan
from .specimens import Sensors, Specimens, drift

SPREAD_KINDS = 3
"""Kinds of loads on many nodes, each with random numbers of its own: hugs, shakes, wind."""
LENGTH_DIGITS = 5
"""Lengths and positions in trial.toml are measured to 0.01 mm."""


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


def simulate(plan: Plan, provenance: str) -> VirtualTrial:
    """Return the trial that a plan and its seed make; same plan, same seed, same trial.

    Args:
        plan: without problems.
        provenance: what trial.toml says of where it comes from.

    Raises:
        IndeterminateError: when the structure has no rest shape.
        TensegraphError: when it does not come to rest, its motion runs away, or MuJoCo is not installed.
    """
    # one stream of random numbers each, so that another load, say, leaves the sensors what they are
    root = np.random.SeedSequence(plan.seed)
    seeds = root.spawn(5 + len(plan.boards.tendon_of_channel))
    of_body, of_loads, of_rest, of_specimens, of_drift, *of_boards = map(np.random.default_rng, seeds)
    # causes come after them, so that a plan without any makes what it always made
    of_hubs, of_told, of_warmth, *of_spread = map(np.random.default_rng, root.spawn(3 + SPREAD_KINDS))
    body, start_m = _body(plan, of_body, of_hubs)
    twin = Twin(body, plan.mechanics.step_s, start_m)
    twin.settle()
    motion = twin.run(_loads(plan, body.structure.node_count, of_loads, of_spread), plan.steps)
    specimens = Specimens.draw(plan.sensors, len(body.structure.tendons), of_specimens)
    signal = _signal(plan, body.structure, motion, specimens, of_drift, of_warmth)
    divider = Divider(plan.adc.bits, plan.adc.known_resistor_ohm, plan.adc.sensor_side)
    rows = (board_rows(board, plan.boards, divider, signal, plan.fault, rng) for board, rng in enumerate(of_boards))
    told = _told(plan, body.structure, motion.node_position_m[0], of_rest, of_told)
    every = round(1 / plan.truth.rate_hz / plan.mechanics.step_s)
    return VirtualTrial(
        _metadata(plan, told, specimens, provenance),
        list(heapq.merge(*rows, key=lambda row: row.host_s)),
        motion.t_s[::every],
        motion.node_position_m[::every],
        motion.load_n[::every],
    )


def _body(plan: Plan, rng: np.random.Generator, of_hubs: np.random.Generator) -> tuple[Body, NDArray[np.float64]]:
    """Draw what differs from tendon to tendon; return it with the (nodes, 3) shape to start from."""
    m, structure = plan.mechanics, plan.structure.structure()
    count = len(structure.tendons)
    natural_m = structure.natural_length_m + m.natural_length_spread_m * rng.normal(size=count)
    stiffness = m.tendon_stiffness_n_per_m * np.maximum(1 + m.tendon_stiffness_spread * rng.normal(size=count), 0.1)
    structure = replace(structure, natural_length_m=natural_m)
    start_m, offset_m = find_rest_shape(structure), None
    if plan.geometry_error.hub_radius_m is not None:
        offset_m = hub_offset_m(structure, start_m, plan.geometry_error.hub_radius_m, of_hubs)
        shortened = end_to_end_m(structure, start_m, offset_m) / structure.tendon_length_m(start_m)
        structure = replace(structure, natural_length_m=shortened * natural_m)
    body = Body(
        structure=structure,
        rod_mass_kg=m.rod_mass_kg,
        rod_radius_m=m.rod_radius_m,
        rod_drag_n_s_per_m=m.rod_drag_n_s_per_m,
        stiffness_n_per_m=stiffness,
        damping_n_s_per_m=m.tendon_damping_n_s_per_m,
        push_back=m.push_back,
        gravity_m_per_s2=m.gravity_m_per_s2,
        ground_friction=plan.ground.friction if plan.ground else None,
        hub_offset_m=offset_m,
    )
    return body, start_m


def _loads(plan: Plan, node_count: int, of_loads: np.random.Generator, of_spread: list[np.random.Generator]) -> Loads:
    """Draw the loads that the seed decides."""
    random = [press for load in plan.load.random for press in load.draw(of_loads)]
    of_hugs, of_shakes, of_wind = of_spread
    spread: list[SpreadLoad] = [hug for load in plan.load.hug for hug in load.draw(of_hugs)]
    spread += [shake for load in plan.load.shake for shake in load.draw(of_shakes)]
    spread += [load.draw(of_wind) for load in plan.load.wind]
    return Loads([*plan.load.press, *plan.load.squeeze, *plan.load.hold, *random], node_count, spread)


def _signal(
    plan: Plan,
    structure: Structure,
    motion: TwinMotion,
    specimens: Specimens,
    rng: np.random.Generator,
    of_warmth: np.random.Generator,
) -> Signal:
    """Return the sensors' resistances: each follows its tendon's strain, drifts, and is noisy."""
    step_s = plan.mechanics.step_s
    sensors = plan.hysteresis.applied(plan.sensors) if plan.hysteresis else plan.sensors
    strain = motion.tendon_length_m / structure.natural_length_m - 1
    change = np.array(list(Sensors(sensors, specimens.gain, strain[0]).changes(strain, step_s)))
    noise = np.hypot(sensors.noise_sigma, sensors.noise_share * change)
    change += drift(sensors, len(change), change.shape[1], step_s, rng)
    resistance = 1 + change
    if plan.drift is not None:
        slow = plan.drift.drift(motion.t_s, change.shape[1], of_warmth)
        resistance = resistance * (1 + slow) if plan.drift.of == "resistance" else resistance + slow
    return Signal(motion.t_s, specimens.natural_resistance_ohm * np.maximum(resistance, 0.0), noise)


def _told(
    plan: Plan,
    structure: Structure,
    rest_m: NDArray[np.float64],
    of_rest: np.random.Generator,
    of_told: np.random.Generator,
) -> dict[str, dict[str, Any]]:
    """Return `[structure]` and `[rest]` of trial.toml: what was measured of the structure and of its shape at rest."""
    error = ToldErrors.draw(plan.geometry_error, structure, of_told)
    rods_m = structure.rod_length_m + error.rod_length_m
    rest: dict[str, Any] = {"seconds": plan.rest.seconds}
    if plan.rest.node_position_sigma_m is not None:
        seen_m = rest_m + plan.rest.node_position_sigma_m * of_rest.normal(size=rest_m.shape)
        rest["node_position_m"] = _rounded(seen_m + error.rest_position_m)
    return {
        "structure": {
            "rods": structure.rods.tolist(),
            "tendons": structure.tendons.tolist(),
            "rod_length_m": _rounded(rods_m) if error.rod_length_m.any() else plan.structure.rod_length_m,
            "natural_length_m": _rounded(structure.natural_length_m + error.natural_length_m),
            "anchors": structure.anchors.tolist(),
            "anchor_position_m": _rounded(rest_m[structure.anchors] + error.anchor_m),
        },
        "rest": rest,
    }


def _rounded(value_m: NDArray[np.float64]) -> list[Any]:
    """Return lengths or positions as they are measured."""
    return [
        round(row, LENGTH_DIGITS) if isinstance(row, float) else [round(value, LENGTH_DIGITS) for value in row]
        for row in value_m.tolist()
    ]


def _metadata(
    plan: Plan, told: Mapping[str, Mapping[str, Any]], specimens: Specimens, provenance: str
) -> dict[str, Any]:
    """Return trial.toml: what a lab would know, and under `truth` what only a twin does."""
    truth: dict[str, Any] = {"file": "truth.csv", "loads": "loads.csv"}
    faults = plan.fault.as_truth()
    return {
        "format": 1,
        "name": f"{plan.name}_{plan.seed:02d}",
        "kind": plan.kind,
        "provenance": provenance,
        "structure": told["structure"],
        "mechanics": {
            "tendon_stiffness_n_per_m": plan.mechanics.tendon_stiffness_n_per_m,
            "rod_mass_kg": plan.mechanics.rod_mass_kg,
        },
        "rest": told["rest"],
        "adc": {
            "bits": plan.adc.bits,
            **({"supply_volt": plan.adc.supply_volt} if plan.adc.supply_volt is not None else {}),
            "known_resistor_ohm": plan.adc.known_resistor_ohm,
            "sensor_side": plan.adc.sensor_side,
        },
        "sensors": {"natural_resistance_ohm": [round(value) for value in specimens.measured_resistance_ohm.tolist()]},
        "board": [
            {"file": f"board{board}.csv", "tendon_of_channel": channels}
            for board, channels in enumerate(plan.boards.tendon_of_channel)
        ],
        "truth": truth | ({"fault": faults} if faults else {}),
    }
