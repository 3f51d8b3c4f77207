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
from .toml import line_of, read_toml

EXTENDS = "extends"
"""Key at the top of a plan: the path, from the plan's own folder, of the plan that it adds to and replaces keys of."""


@dataclass(frozen=True, slots=True)
class _Layer:
    """One file of a plan."""

    path: Path
    table: dict[str, Any]
    text: str


def read_plan(path: Path) -> Plan:
    """Return a plan that can be simulated.

    A plan that `extends` another has all that the other has. Its tables add keys to the other's tables, or replace
    them; lists, and lists of tables, replace the other's as a whole.

    Raises:
        InputError: naming file, line and key of the first thing that cannot be.
    """
    layers = _layers(path)
    table: dict[str, Any] = {}
    for layer in reversed(layers):
        table = _merged(table, layer.table)

    def place(key: str) -> str:
        layer = _owner(layers, key)
        return f"{layer.path}: line {line_of(layer.text, key)}"

    for key in unknown_keys(Plan, table):
        raise InputError(f"{place(key)}: {key}: is no key of a plan")
    plan = parse_table(Plan, table, place)
    for key, problem in problems(plan):
        raise InputError(f"{place(key)}: {key}: {problem}")
    return plan


def base_plan_path(path: Path) -> Path | None:
    """Return the path of the plan that a plan extends, None if it stands by itself.

    Raises:
        InputError: when it can not be read, or `extends` is no path.
    """
    table = read_toml(path)
    if EXTENDS not in table:
        return None
    base = table[EXTENDS]
    if not isinstance(base, str):
        line = line_of(path.read_text(encoding="utf-8"), EXTENDS)
        raise InputError(f"{path}: line {line}: {EXTENDS}: expected the path of a plan, got {base!r}")
    return path.parent / base


def _layers(path: Path) -> list[_Layer]:
    """Return a plan's files, its own first."""
    layers: list[_Layer] = []
    following: Path | None = path
    while following is not None:
        if any(layer.path.resolve() == following.resolve() for layer in layers):
            line = line_of(layers[-1].text, EXTENDS)
            raise InputError(
                f"{layers[-1].path}: line {line}: {EXTENDS}: comes back to {following}: expected a plan below"
            )
        base = base_plan_path(following)
        table = read_toml(following)
        table.pop(EXTENDS, None)
        layers.append(_Layer(following, table, following.read_text(encoding="utf-8")))
        following = base
    return layers


def _owner(layers: Sequence[_Layer], key: str) -> _Layer:
    """Return the file that a dotted key of a plan comes from, or the innermost table or list around it."""
    holding: list[tuple[_Layer, Any]] = [(layer, layer.table) for layer in layers]
    for part in key.replace("[", ".[").split("."):
        name = int(part[1:-1]) if part.startswith("[") else part
        inner = [(layer, value[name]) for layer, value in holding if _has(value, name)]
        if not inner:
            break
        tables = takewhile(lambda held: isinstance(held[1], dict), inner)
        holding = list(tables) or inner[:1]  # tables are added up, anything else replaces what is below
    return holding[0][0]


def _has(value: Any, name: str | int) -> bool:
    if isinstance(value, dict):
        return name in value
    return isinstance(value, list) and isinstance(name, int) and name < len(value)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with the keys of both; of two tables those of both again, else the one above."""
    both = {
        key: _merged(below[key], value) if isinstance(value, dict) and isinstance(below.get(key), dict) else value
        for key, value in above.items()
    }
    return {**below, **both}
