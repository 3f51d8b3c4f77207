"""A commented start of trial.toml and rig.toml for the structures that are ready."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...models.ready_structures import prism_tower, saddle_tower, six_strut
from ...models.structure.form_finding import find_rest_shape
from ...models.structure.structure import Structure
from ...models.values.errors import InputError
from ..toml import commented
from ..whole import check_vacant, written_whole

CHANNELS = 12
"""Channels of a board that are used, as in examples/firmware."""
RODS_M = (0.001, 100.0)
"""Shortest and longest rod of a start: its stiffness and masses are those of a robot for the hand."""
SIDE_PER_ROD = 0.5
"""Side of the triangles over the rod of a prism, with which it is about as high as wide."""
HEADS = {
    "trial.toml": "A start: every number is nominal. Put your own in; docs/formats/trial.md describes every key.\n"
    "# For resistances, [resistance] with a file, a CSV with t_s, r0_ohm ..., stands in place of [adc] and [[board]].\n"
    "# For lengths, [lengths] with a file, a CSV with t_s, l0_m ... and sigmas s0_m ..., stands in place of [adc],\n"
    "# [sensors] and [[board]], with strips = false if the sensors are no strips.",
    "rig.toml": "What stands in the lab, for `tensegraph record` and `tensegraph live`. Put your own numbers in.",
}
COMMENTS_OF_START = {
    "structure.rod_length_m": "measure: between the two ends to which tendons are tied",
    "structure.natural_length_m": "measure: L0 of each tendon, unstretched",
    "structure.anchors": "these are held where anchor_position_m says",
    "structure.node_position_m": "about as at rest: the search for the rest shape starts there",
    "mechanics.tendon_stiffness_n_per_m": "measure: from one pull test",
    "mechanics.rod_mass_kg": "measure: of each rod",
    "rest.seconds": "the structure stands still and unloaded this long at the start",
    "adc.known_resistor_ohm": "the resistor beside each sensor",
    "adc.sensor_side": "ground: V = supply * R / (R + known); supply: V = supply * known / (R + known)",
    "sensors.natural_resistance_ohm": "measure: R0 of each sensor at L0, before it is mounted",
}


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """One of the structures that are ready."""

    name: Literal["prism", "six-strut", "tower", "saddle-tower"]
    rod_length_m: float
    stages: int | None = None
    """Number of prisms of a tower; two if None."""

    def structure(self) -> tuple[Structure, NDArray[np.float64]]:
        """Return the structure, and (nodes, 3) its shape at rest.

        Raises:
            InputError: for sizes that are impossible, or stages of something else than a tower.
        """
        if self.stages is not None and self.name != "tower":
            raise InputError(f"--stages: only --new tower has stages, got --new {self.name}")
        shortest_m, longest_m = RODS_M
        if not shortest_m <= self.rod_length_m <= longest_m:
            raise InputError(
                f"--rod: expected {shortest_m:g} to {longest_m:g} m, got {self.rod_length_m:g}: is the unit right?"
            )
        if self.name == "six-strut":
            structure = six_strut(self.rod_length_m)
            return structure, find_rest_shape(structure)
        if self.name == "saddle-tower":
            return saddle_tower(self.rod_length_m, SIDE_PER_ROD * self.rod_length_m)
        stages = 1 if self.name == "prism" else self.stages or 2
        return prism_tower(stages, self.rod_length_m, SIDE_PER_ROD * self.rod_length_m)


def write_new_trial(built_in: BuiltIn, out: Path) -> list[Path]:
    """Write trial.toml and rig.toml into a new directory, completely or not at all; return their paths.

    Raises:
        InputError: for sizes that are impossible, or when the directory exists or cannot be written.
    """
    check_vacant(out)
    tables = _tables(built_in)
    with written_whole(out) as (inside,):
        inside.mkdir()
        for name, head in HEADS.items():
            (inside / name).write_text(
                f"# {head}\n{commented(tables, COMMENTS_OF_START)}", encoding="utf-8", newline="\n"
            )
    return [out / name for name in HEADS]


def _tables(built_in: BuiltIn) -> dict[str, Any]:
    structure, position_m = built_in.structure()
    tendons = list(range(len(structure.tendons)))
    boards = [tendons[first : first + CHANNELS] for first in range(0, len(tendons), CHANNELS)]
    return {
        "format": 1,
        "name": built_in.name,
        "structure": {
            "rods": structure.rods.tolist(),
            "tendons": structure.tendons.tolist(),
            "rod_length_m": built_in.rod_length_m,
            "natural_length_m": structure.natural_length_m.round(6).tolist(),
            "anchors": structure.anchors.tolist(),
            "anchor_position_m": structure.anchor_position_m.round(6).tolist(),
            "node_position_m": position_m.round(6).tolist(),
        },
        "mechanics": {"tendon_stiffness_n_per_m": 400.0, "rod_mass_kg": 0.03},
        "rest": {"seconds": 2.0},
        "adc": {"bits": 10, "known_resistor_ohm": 5.8e6, "sensor_side": "ground"},
        "sensors": {"natural_resistance_ohm": [5.8e6] * len(tendons)},
        "board": [
            {"file": f"board{number}.csv", "board_id": number, "tendon_of_channel": channels}
            for number, channels in enumerate(boards)
        ],
    }
