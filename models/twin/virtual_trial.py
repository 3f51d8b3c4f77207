"""A whole trial of the twin: from a plan to what the boards send, and what was true."""

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..sensor.divider import Divider
from ..structure.structure import Structure
from ..values.readings import BoardReading
from .emulated_boards import Signal, board_rows
from .engine import Twin, TwinMotion
from .loads import Loads
from .mjcf import Body
from .plan import Plan
from .specimens import Sensors, Specimens, drift

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
    seeds = np.random.SeedSequence(plan.seed).spawn(5 + len(plan.boards.tendon_of_channel))
    of_body, of_loads, of_rest, of_specimens, of_drift, *of_boards = map(np.random.default_rng, seeds)
    body = _body(plan, of_body)
    random = [press for load in plan.load.random for press in load.draw(of_loads)]
    loads = Loads([*plan.load.press, *plan.load.squeeze, *plan.load.hold, *random], body.structure.node_count)
    twin = Twin(body, plan.mechanics.step_s)
    twin.settle()
    motion = twin.run(loads, plan.steps)
    specimens = Specimens.draw(plan.sensors, len(body.structure.tendons), of_specimens)
    signal = _signal(plan, body.structure, motion, specimens, of_drift)
    divider = Divider(plan.adc.bits, plan.adc.known_resistor_ohm, plan.adc.sensor_side)
    rows = (board_rows(board, plan.boards, divider, signal, plan.fault, rng) for board, rng in enumerate(of_boards))
    every = round(1 / plan.truth.rate_hz / plan.mechanics.step_s)
    return VirtualTrial(
        _metadata(plan, body.structure, specimens, motion.node_position_m[0], provenance, of_rest),
        list(heapq.merge(*rows, key=lambda row: row.host_s)),
        motion.t_s[::every],
        motion.node_position_m[::every],
        motion.load_n[::every],
    )


def _body(plan: Plan, rng: np.random.Generator) -> Body:
    """Draw what differs from tendon to tendon."""
    m, structure = plan.mechanics, plan.structure.structure()
    count = len(structure.tendons)
    natural_m = structure.natural_length_m + m.natural_length_spread_m * rng.normal(size=count)
    stiffness = m.tendon_stiffness_n_per_m * np.maximum(1 + m.tendon_stiffness_spread * rng.normal(size=count), 0.1)
    return Body(
        replace(structure, natural_length_m=natural_m),
        m.rod_mass_kg,
        m.rod_radius_m,
        m.rod_drag_n_s_per_m,
        stiffness,
        m.tendon_damping_n_s_per_m,
        m.push_back,
        m.gravity_m_per_s2,
        plan.ground.friction if plan.ground else None,
    )


def _signal(
    plan: Plan, structure: Structure, motion: TwinMotion, specimens: Specimens, rng: np.random.Generator
) -> Signal:
    """Return the sensors' resistances: each follows its tendon's strain, drifts, and is noisy."""
    step_s = plan.mechanics.step_s
    strain = structure.tendon_length_m(motion.node_position_m) / structure.natural_length_m - 1
    change = np.array(list(Sensors(plan.sensors, specimens.gain, strain[0]).changes(strain, step_s)))
    noise = np.hypot(plan.sensors.noise_sigma, plan.sensors.noise_share * change)
    change += drift(plan.sensors, len(change), change.shape[1], step_s, rng)
    return Signal(motion.t_s, specimens.natural_resistance_ohm * np.maximum(1 + change, 0.0), noise)


def _metadata(
    plan: Plan,
    structure: Structure,
    specimens: Specimens,
    rest_m: NDArray[np.float64],
    provenance: str,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Return trial.toml: what a lab would know, and under `truth` what only a twin does."""

    def measured(position_m: NDArray[np.float64]) -> list[Any]:
        return [[round(value, LENGTH_DIGITS) for value in row] for row in position_m.tolist()]

    rest: dict[str, Any] = {"seconds": plan.rest.seconds}
    if plan.rest.node_position_sigma_m is not None:
        error_m = plan.rest.node_position_sigma_m * rng.normal(size=rest_m.shape)
        rest["node_position_m"] = measured(rest_m + error_m)
    truth: dict[str, Any] = {"file": "truth.csv", "loads": "loads.csv"}
    faults = plan.fault.as_truth()
    return {
        "format": 1,
        "name": f"{plan.name}_{plan.seed:02d}",
        "kind": plan.kind,
        "provenance": provenance,
        "structure": {
            "rods": structure.rods.tolist(),
            "tendons": structure.tendons.tolist(),
            "rod_length_m": plan.structure.rod_length_m,
            "natural_length_m": [round(value, LENGTH_DIGITS) for value in structure.natural_length_m.tolist()],
            "anchors": structure.anchors.tolist(),
            "anchor_position_m": measured(rest_m[structure.anchors]),
        },
        "mechanics": {
            "tendon_stiffness_n_per_m": plan.mechanics.tendon_stiffness_n_per_m,
            "rod_mass_kg": plan.mechanics.rod_mass_kg,
        },
        "rest": rest,
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
