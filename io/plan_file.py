"""Plans of the twin, from TOML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

from ..models.twin.plan import Plan
from ..models.twin.plan_problems import problems
from ..models.values.errors import InputError
from ..models.values.tables import parse_table, unknown_keys
from .input_files import real_path
from .structures.structure_file import with_structure_file
from .toml import line_of, read_toml

EXTENDS = "extends"
"""Key at the top of a plan: the path, from the plan's own folder, of another plan, to which it adds its own keys."""


@dataclass(frozen=True, slots=True)
class _Layer:
    """One file of a plan."""

    path: Path
    table: dict[str, Any]


def read_plan(path: Path) -> Plan:
    """Return a plan that can be simulated.

    A plan that `extends` another has all keys of the other. Its own tables add keys to the tables of the other or
    replace keys of them. Its own lists, and lists of tables, replace those of the other as a whole.

    Raises:
        InputError: naming file, line and key of the first thing that cannot be simulated.
    """
    layers = _layers(path)
    table: dict[str, Any] = {}
    for layer in reversed(layers):
        table = _merged(table, layer.table)

    def place(key: str) -> str:
        return _place(_owner(layers, key).path, key)

    for unknown in unknown_keys(Plan, table):
        raise InputError(f"{place(unknown.name)}: {unknown.name}: is no key of a plan{unknown.hint}")
    plan = parse_table(Plan, table, place)
    for key, problem in problems(plan):
        raise InputError(f"{place(key)}: {key}: {problem}")
    return plan


def plan_files(path: Path) -> list[Path]:
    """Return the files of a plan: its own, the one that it extends, and so on.

    Raises:
        InputError: when one of them cannot be read, or they extend each other in a circle.
    """
    return [layer.path for layer in _layers(path)]


def _base_path(path: Path, table: Mapping[str, Any]) -> Path | None:
    if EXTENDS not in table:
        return None
    base = table[EXTENDS]
    if not isinstance(base, str) or "\0" in base:
        raise InputError(f"{_place(path, EXTENDS)}: {EXTENDS}: expected the path of a plan, got {base!r}")
    return path.parent / base


def _place(path: Path, key: str) -> str:
    """Return the file and the line of a key, for the text of an error."""
    return f"{path}: line {line_of(path.read_text(encoding='utf-8-sig'), key)}"


def _layers(path: Path) -> list[_Layer]:
    """Return what each of `plan_files` says."""
    layers: list[_Layer] = []
    seen: set[Path] = set()
    following: Path | None = path
    while following is not None:
        if real_path(following) in seen:
            place = _place(layers[-1].path, EXTENDS)
            raise InputError(f"{place}: {EXTENDS}: leads back to {following}: expected a plan that does not")
        table = with_structure_file(read_toml(following), following, ("body", "mechanics"))
        base = _base_path(following, table)
        if base is not None and not base.exists():
            raise InputError(f"{_place(following, EXTENDS)}: {EXTENDS}: {base}: no such file")
        table.pop(EXTENDS, None)
        seen.add(real_path(following))
        layers.append(_Layer(following, table))
        following = base
    return layers


def _owner(layers: Sequence[_Layer], key: str) -> _Layer:
    """Return the file from which a dotted key of a plan comes; if none has it, that of the table or list around it."""
    for layer in layers:
        if key in layer.table:  # also a key with dots and brackets in its name
            return layer
    holding: list[tuple[_Layer, Any]] = [(layer, layer.table) for layer in layers]
    for part in key.replace("[", ".[").split("."):
        try:
            name = int(part[1:-1]) if part.startswith("[") else part
        except ValueError:  # a bracket in the name of a key
            break
        inner = [(layer, value[name]) for layer, value in holding if _has(value, name)]
        if not inner:
            break
        tables = takewhile(lambda held: isinstance(held[1], dict), inner)
        holding = list(tables) or inner[:1]  # tables are merged, anything else replaces what is below
    return holding[0][0]


def _has(value: Any, name: str | int) -> bool:
    if isinstance(value, dict):
        return name in value
    return isinstance(value, list) and isinstance(name, int) and name < len(value)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with the keys of both. If both have a key, two tables are merged; otherwise `above` counts."""
    both = {
        key: _merged(below[key], value) if isinstance(value, dict) and isinstance(below.get(key), dict) else value
        for key, value in above.items()
    }
    return {**below, **both}
