"""Structures written for others: our own TOML, MuJoCo's MJCF, and a picture."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

from ...models.structure.floor import GRAVITY_M_PER_S2
from ...models.structure.form_finding import find_rest_shape, with_rods_as_told
from ...models.structure_description import DescribedStructure, geometry_keys
from ...models.twin.mjcf import Body, mjcf
from ...models.values.errors import InputError
from ..whole import check_vacant, written_whole

WRITTEN = (".toml", ".xml", ".png", ".pdf", ".svg")
"""Suffixes of the formats."""
RADIUS_SHARE = 0.01
"""Radius of a rod in a written model, as a share of its length: a structure does not tell it."""
DRAG_N_S_PER_M = 0.2
"""Drag of a rod and damping of a tendon in a written model, with which a sway dies out within a second."""
MODEL_STEP_S = 0.001


def write_structure(told: DescribedStructure, paths: Sequence[Path], *, title: str) -> None:
    """Write a structure as TOML (.toml), as a MuJoCo model (.xml), or as a picture (.png, .pdf, .svg).

    If one file cannot be made, none is written.

    Raises:
        InputError: for another suffix, a file that exists or stands twice, or a model without mechanics.
    """
    for number, path in enumerate(paths):
        if path.suffix.lower() not in WRITTEN:
            raise InputError(f"{path}: expected {', '.join(WRITTEN[:-1])} or {WRITTEN[-1]}")
        if path in paths[:number]:
            raise InputError(f"{path}: expected each file once")
        check_vacant(path)
    with ExitStack() as all_whole:
        for path in paths:
            (hidden,) = all_whole.enter_context(written_whole(path))
            _write(told, path, hidden, title)


def _write(told: DescribedStructure, path: Path, hidden: Path, title: str) -> None:
    """Write one file, which is at first a hidden one; errors name the path that was told."""
    suffix = path.suffix.lower()
    if suffix == ".toml":
        hidden.write_text(tomlkit.item(structure_toml(told)).as_string(), encoding="utf-8", newline="\n")
    elif suffix == ".xml":
        hidden.write_text(_model(told, path), encoding="utf-8", newline="\n")
    else:
        from ..figures.structure_figure import write_structure_figure  # matplotlib takes a third of a second to import

        write_structure_figure(told, _shape(told), title, hidden)


def structure_toml(told: DescribedStructure) -> dict[str, Any]:
    """Return the tables of a structure file, as `structure_tables` reads them."""
    s, mechanics, own = told.structure, told.mechanics, told.own_rods
    structure = {
        "rods": s.rods[:own].tolist(),
        "tendons": s.tendons.tolist(),
        "rod_length_m": s.rod_length_m[:own].tolist(),
        "natural_length_m": s.natural_length_m.tolist(),
        "anchors": s.anchors.tolist(),
        "anchor_position_m": s.anchor_position_m.tolist(),
    }
    if len(s.unsensed):
        structure["unsensed"] = s.unsensed.tolist()
    if told.node_position_m is not None:
        structure["node_position_m"] = told.node_position_m.tolist()
    structure |= geometry_keys(told.geometry)
    tables: dict[str, Any] = {"structure": structure}
    if mechanics is not None:
        tables["mechanics"] = {
            "tendon_stiffness_n_per_m": mechanics.stiffness_n_per_m.tolist(),
            "rod_mass_kg": np.broadcast_to(mechanics.rod_mass_kg, len(s.rods))[:own].tolist(),
            "push_back": np.broadcast_to(mechanics.push_back, len(s.tendons)).tolist(),
            "tendon_mass_kg": np.broadcast_to(mechanics.tendon_mass_kg, len(s.tendons)).tolist(),
            "knot_mass_kg": np.broadcast_to(mechanics.knot_mass_kg, s.node_count).tolist(),
        }
    if told.rest_position_m is not None:
        tables["rest"] = {"node_position_m": told.rest_position_m.tolist()}
    if told.bodies:  # their mass is in knot_mass_kg
        tables["body"] = [{"nodes": list(nodes)} for nodes in told.bodies]
    return tables


def _shape(told: DescribedStructure) -> NDArray[np.float64]:
    """Return (nodes, 3) the measured rest shape, or that of least energy."""
    if told.rest_position_m is not None:
        return told.rest_position_m
    return find_rest_shape(told.structure, told.node_position_m)


def _model(told: DescribedStructure, path: Path) -> str:
    """Return the MuJoCo model; radii, drag and damping are ordinary ones."""
    s, mechanics = told.structure, told.mechanics
    if mechanics is None:
        raise InputError(f"{path}: expected a structure with [mechanics], which a model needs, got none")
    rod_kg = np.broadcast_to(mechanics.rod_mass_kg, len(s.rods))
    if (rod_kg[: told.own_rods] <= 0).any():
        raise InputError(f"{path}: expected rods with a mass, which a model needs: rod_mass_kg of [mechanics]")
    knot_kg = mechanics.node_mass_kg(s) - 0.5 * np.bincount(s.rods.ravel(), rod_kg.repeat(2), s.node_count)
    loose = np.setdiff1d(np.arange(s.node_count), np.concatenate([s.rods.ravel(), s.anchors]))
    massless = loose[knot_kg[loose] <= 0]
    if len(massless):
        raise InputError(f"{path}: expected mechanics.knot_mass_kg[{massless[0]}] above 0, of a node on no rod")
    body = Body(
        structure=s,
        rod_mass_kg=rod_kg,
        rod_radius_m=RADIUS_SHARE * s.rod_length_m,
        rod_drag_n_s_per_m=DRAG_N_S_PER_M,
        stiffness_n_per_m=mechanics.stiffness_n_per_m,
        damping_n_s_per_m=DRAG_N_S_PER_M,
        push_back=mechanics.push_back,
        gravity_m_per_s2=GRAVITY_M_PER_S2,
        ground_friction=None,
        rigid=told.bodies,
        knot_mass_kg=knot_kg,
        own_rods=told.own_rods,
    )
    return mjcf(body, with_rods_as_told(s, _shape(told)), MODEL_STEP_S)
