"""The trial.toml of a virtual trial: what a laboratory would have measured, and what only a twin knows."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..structure.structure import Structure
from ..structure_description import geometry_keys
from .geometry_error import ToldErrors
from .plan import Plan
from .specimens import Specimens

LARGE_OHM = 1e6
"""Resistance above which one in trial.toml is told to an ohm; below, a whole ohm would be a coarse measurement."""
LENGTH_DIGITS = 5
"""Lengths and positions in trial.toml are measured to 0.01 mm."""


def told_geometry(
    plan: Plan,
    structure: Structure,
    rest_m: NDArray[np.float64],
    of_rest: np.random.Generator,
    of_told: np.random.Generator,
) -> dict[str, dict[str, Any]]:
    """Return `structure` and `rest` of trial.toml: what was measured of the structure and of its shape at rest.

    Args:
        plan: of the trial.
        structure: with its true lengths.
        rest_m: (nodes, 3) true positions at rest.
        of_rest: random numbers of the measurement of the rest shape.
        of_told: random numbers of `geometry_error`.
    """
    error = ToldErrors.draw(plan.geometry_error, structure, of_told)
    own = len(plan.structure.rods)
    rods_m = (structure.rod_length_m + error.rod_length_m)[:own]
    told = plan.structure
    further = {"unsensed": told.unsensed, "node_position_m": told.node_position_m}
    return {
        "structure": {
            "rods": structure.rods[:own].tolist(),
            "tendons": structure.tendons.tolist(),
            "rod_length_m": _rounded(rods_m) if error.rod_length_m.any() else plan.structure.rod_length_m,
            "natural_length_m": _rounded(structure.natural_length_m + error.natural_length_m),
            "anchors": structure.anchors.tolist(),
            "anchor_position_m": _rounded(rest_m[structure.anchors] + error.anchor_m),
            **{name: value for name, value in further.items() if value},
            **geometry_keys(told.geometry()),
        },
        "rest": _told_rest(plan, rest_m + error.rest_position_m, of_rest),
    }


def _told_rest(plan: Plan, position_m: NDArray[np.float64], rng: np.random.Generator) -> dict[str, Any]:
    """Return `rest` of trial.toml, with a measurement of (nodes, 3) positions if the plan has one."""
    if plan.rest.node_position_sigma_m is None:
        return {"seconds": plan.rest.seconds}
    measured_m = position_m + plan.rest.node_position_sigma_m * rng.normal(size=position_m.shape)
    return {"seconds": plan.rest.seconds, "node_position_m": _rounded(measured_m)}


def trial_metadata(
    plan: Plan, told: Mapping[str, Mapping[str, Any]], specimens: Specimens, provenance: str
) -> dict[str, Any]:
    """Return trial.toml.

    Args:
        plan: of the trial.
        told: see `told_geometry`.
        specimens: the sensors.
        provenance: what trial.toml says about where the trial comes from.
    """
    return {
        "format": 1,
        "name": f"{plan.name}_{plan.seed:02d}",
        "kind": plan.kind,
        "provenance": provenance,
        "structure": told["structure"],
        **({"body": [asdict(body) for body in plan.body]} if plan.body else {}),
        "mechanics": _mechanics(plan),
        "rest": told["rest"],
        **_ground(plan, told),
        **_carried(plan),
        "adc": _adc(plan),
        "sensors": {
            "natural_resistance_ohm": [
                round(value) if value > LARGE_OHM else float(f"{value:.6g}")
                for tendon, value in enumerate(specimens.measured_resistance_ohm.tolist())
                if tendon not in plan.structure.unsensed
            ]
        },
        "board": [
            {"file": f"board{board}.csv", "tendon_of_channel": channels}
            for board, channels in enumerate(plan.boards.tendon_of_channel)
        ],
        "truth": _truth(plan),
    }


def _mechanics(plan: Plan) -> dict[str, Any]:
    """Return `mechanics` of trial.toml: what a pull test and a scale tell, and which tendons are cables."""
    mechanics = plan.mechanics
    told: dict[str, Any] = {
        "tendon_stiffness_n_per_m": mechanics.tendon_stiffness_n_per_m,
        "rod_mass_kg": mechanics.rod_mass_kg,
    }
    if isinstance(mechanics.push_back, list) or mechanics.push_back == 0:
        told["push_back"] = mechanics.push_back
    masses = {"tendon_mass_kg": mechanics.tendon_mass_kg, "knot_mass_kg": mechanics.knot_mass_kg}
    return told | {name: mass_kg for name, mass_kg in masses.items() if mass_kg}


def _ground(plan: Plan, told: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return `ground` of trial.toml, for a structure that stands free on it."""
    if plan.ground is None or told["structure"]["anchors"]:
        return {}
    return {"ground": {"height_m": plan.mechanics.rod_radius_m}}


def _carried(plan: Plan) -> dict[str, Any]:
    """Return `imu`, `range`, `position` and `motor` of trial.toml."""
    imus = [
        {"file": f"imu{number}.csv", "rod": imu.rod, "fraction": imu.fraction, "axis": [0, 0, 1]}
        for number, imu in enumerate(plan.imu)
    ]
    ranges = [
        {"file": f"ranges{number}.csv", "beacon_position_m": [list(beacon) for beacon in ranges.beacon_position_m]}
        for number, ranges in enumerate(plan.range)
    ]
    positions = [{"file": f"positions{number}.csv"} for number in range(len(plan.position))]
    motors = [
        {"file": f"natural_length{number}.csv", "tendons": motor.tendons, "strip_length_m": motor.strip_length_m}
        for number, motor in enumerate(plan.motor)
    ]
    tables = {"imu": imus, "range": ranges, "position": positions, "motor": motors}
    return {name: table for name, table in tables.items() if table}


def _adc(plan: Plan) -> dict[str, Any]:
    supply = {} if plan.adc.supply_volt is None else {"supply_volt": plan.adc.supply_volt}
    return {
        "bits": plan.adc.bits,
        **supply,
        "known_resistor_ohm": plan.adc.known_resistor_ohm,
        "sensor_side": plan.adc.sensor_side,
    }


def _truth(plan: Plan) -> dict[str, Any]:
    """Return what only a twin knows."""
    faults = plan.fault.as_truth(plan.duration_s)
    contacts = {"contacts": "contacts.csv"} if plan.ground and not plan.structure.anchors else {}
    return {"file": "truth.csv", "loads": "loads.csv", **contacts, **({"fault": faults} if faults else {})}


def _rounded(value_m: NDArray[np.float64]) -> list[Any]:
    """Return lengths or positions as they are measured."""
    return [
        round(row, LENGTH_DIGITS) if isinstance(row, float) else [round(value, LENGTH_DIGITS) for value in row]
        for row in value_m.tolist()
    ]
