"""`structure`: shows, checks and converts a structure, or starts one."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from ..io.reports.terminal import Terminal
from ..io.structures.new_trial import BuiltIn, write_new_trial
from ..io.structures.structure_file import read_structure
from ..io.structures.structure_output import write_structure
from ..models.structure.form_finding import find_rest_shape
from ..models.structure.rigidity import held_jacobian, rigidity
from ..models.structure_description import DescribedStructure
from ..models.values.errors import IndeterminateError, InputError
from ..models.values.tables import SMALLEST
from ..models.values.units import LARGEST


def show_structure(path: Path, *, unit_m: float, out: list[Path], terminal: Terminal) -> None:
    """Print what a structure file describes, and write it in other formats.

    Args:
        path: of the file.
        unit_m: unit of the lengths in a YAML file.
        out: files to write, see `write_structure`.
        terminal: for the table.

    Raises:
        InputError: for a file that describes no structure, or one that cannot be written.
    """
    told = read_structure(path, unit_m=unit_m)
    table = Table(title=str(path), show_header=False)
    for name, value in _facts(told):
        table.add_row(name, value)
    terminal.news.print(table)
    if out or told.structure.node_count <= 40:
        terminal.news.print(_nodes(told))
    write_structure(told, out, title=path.stem)
    for file in out:
        terminal.written(f"written to {file}")


def start_structure(built_in: BuiltIn, *, out: Path, terminal: Terminal) -> None:
    """Write a commented start of trial.toml and rig.toml for a structure that is ready.

    Args:
        built_in: which structure, and how large.
        out: directory to write, which must not exist.
        terminal: for the paths.

    Raises:
        InputError: for sizes that are impossible, or when `out` exists.
    """
    for file in write_new_trial(built_in, out):
        terminal.written(f"written to {file}")


def _facts(told: DescribedStructure) -> Iterator[tuple[str, str]]:
    s = told.structure
    shared = int(np.bincount(s.rods[: told.own_rods].ravel(), minlength=1).max())
    own = s.rod_length_m[: told.own_rods]
    yield "nodes", f"{s.node_count}, of which {len(s.anchors)} are anchors"
    yield "rods", f"{len(own)}{_range(own)}{f'; up to {shared} share a node (class {shared})' if shared > 1 else ''}"
    if told.bodies:
        yield "rigid bodies", "; ".join(f"{len(nodes)} nodes: {', '.join(map(str, nodes))}" for nodes in told.bodies)
    yield "tendons", f"{len(s.tendons)}, unstretched{_range(s.natural_length_m)}"
    if told.geometry.hub_radius_m:
        yield "hubs", f"tendons end up to {told.geometry.hub_radius_m:.4g} m beside the ends of rods"
    if len(s.unsensed):
        yield "without a sensor", ", ".join(map(str, s.unsensed))
    if told.mechanics:
        cables = np.flatnonzero(np.broadcast_to(told.mechanics.push_back, len(s.tendons)) == 0)
        yield "cables", f"{len(cables)} go slack without pushing back"
        yield "mass", f"{told.mechanics.node_mass_kg(s).sum():.4g} kg"
    else:
        yield "mechanics", "not given: the balance of forces would not be used"
    yield from _facts_of_shape(told)


def _facts_of_shape(told: DescribedStructure) -> Iterator[tuple[str, str]]:
    """Yield what lengths and forces determine at the rest shape: that of least energy, in which forces balance."""
    s, measured_m = told.structure, told.rest_position_m
    try:
        x = find_rest_shape(s, told.node_position_m if measured_m is None else measured_m)
    except IndeterminateError as error:
        if measured_m is None:
            yield "rest shape", f"none: {error}"
            return
        x = measured_m
    facts = rigidity(s, x)
    all_sensed = replace(s, unsensed=np.empty(0, dtype=np.int64))
    of_rods = int(np.linalg.matrix_rank(held_jacobian(all_sensed, x)[: len(s.rods)]))
    stresses = rigidity(all_sensed, x).self_stresses - (len(s.rods) - of_rods)  # without those in rigid bodies
    slack = np.flatnonzero(s.tendon_length_m(x if measured_m is None else measured_m) <= s.natural_length_m)
    yield "self-stress states", str(stresses)
    yield "mechanisms", f"{facts.mechanisms} that measured lengths and rods do not determine to first order"
    yield "weakest motion", f"{facts.smallest_singular_value:.3g} m of length per m"
    if told.mechanics is None and facts.smallest_singular_value < 0.02:
        yield "hint", "lengths alone leave it loose: give [mechanics], so that the balance of forces is used"
    yield "slack at rest", ", ".join(map(str, slack)) or "no tendon"


def _range(values_m: NDArray[np.float64]) -> str:
    if not len(values_m):
        return ""
    low, high = f"{values_m.min():.4g}", f"{values_m.max():.4g}"
    return f" of {low} m" if low == high else f" of {low} to {high} m"


def _nodes(told: DescribedStructure) -> Table:
    """Return a table of what ends at each node."""
    s = told.structure
    table = Table("node", "", "rods", "tendons", "in body")
    for node in range(s.node_count):
        rods, tendons = (
            ", ".join(map(str, np.flatnonzero((members == node).any(axis=1))))
            for members in (s.rods[: told.own_rods], s.tendons)
        )
        bodies = ", ".join(str(number) for number, nodes in enumerate(told.bodies) if node in nodes)
        table.add_row(str(node), "anchor" if node in s.anchors else "", rods, tendons, bodies)
    return table


def check_choice(
    file: Path | None,
    unit_m: float,
    new: str | None,
    rod_m: float | None,
    stages: int | None,
    out: Sequence[Path],
) -> None:
    """Refuse a command line that neither names a file nor starts a structure, does both, or tells what is not used.

    Raises:
        InputError: when it does.
    """
    if (file is None) == (new is None):
        given = "neither" if file is None else "both"
        raise InputError(f"expected a structure file, or --new with --rod, got {given}")
    if (new is None) != (rod_m is None):
        raise InputError("--rod: expected with --new, the length of each rod in metres")
    if new is None and stages is not None:
        raise InputError(f"--stages: only --new tower has stages, got {file}")
    if new is not None and unit_m != 1.0:
        raise InputError(f"--unit: expected none with --new, whose lengths are in metres, got {unit_m:g}")
    if new is not None and len(out) > 1:
        raise InputError(f"--out: expected one directory with --new, got {len(out)}")
    if not SMALLEST <= unit_m <= LARGEST["m"]:
        raise InputError(f"--unit: expected metres above 0, at most {LARGEST['m']:g}, got {unit_m:g}")
