"""YAML of tensegrity simulators: `nodes`, members in `pair_groups` or `connections`, and what they are in `builders`.

The NASA Tensegrity Robotics Toolkit writes `pair_groups`, and builders with `class: tgRodInfo` and `parameters`; y is
up there, so that (x, y, z) become (x, -z, y). Others write `connections`, and builders with `type: bar` or `string`.
A tendon's natural length follows from its pretension T, l - T / k, or from `initial_length_ratio`.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ...models.values.errors import InputError, needs_extra, reason_of
from ...models.values.units import LARGEST_NUMBER
from ..input_files import LARGEST_TOML_BYTES, check_regular
from ..toml import INTEGER_BITS

ROD_WORDS = ("rod", "bar", "strut")
TENDON_WORDS = ("string", "cable", "actuator", "muscle", "tendon", "spring")
"""Words in the class, the type or the name of a builder by which its members are rods or tendons."""
REAL_NUMBER = re.compile(r"[-+]?([0-9]+|[0-9]*\.[0-9]+|[0-9]+\.)([eE][-+]?[0-9]+)?$")
"""A number of YAML 1.2; those of YAML 1.1, as PyYAML reads them, need a dot."""
MOST_VALUES = 10**6
"""Number of values, aliases written out, below which a document is no bomb: a few aliases of aliases make billions."""


@dataclass(frozen=True, slots=True)
class _Members:
    """Members of one kind."""

    name: str
    is_rod: bool
    pairs: tuple[tuple[str, str], ...]
    parameters: Mapping[str, Any]


def yaml_tables(path: Path, unit_m: float) -> dict[str, Any]:
    """Return the tables `structure` and `mechanics` of trial.toml that a YAML file tells.

    Args:
        path: of the file.
        unit_m: unit of its lengths.

    Raises:
        InputError: for a file that is no such YAML, or needs a library that is not installed.
    """
    document = _document(path)
    nodes = _nodes(path, document)
    groups = list(_groups(path, document, nodes))
    if any(str(builder.get("class", "")).startswith("tg") for builder in _builders(path, document).values()):
        nodes = {name: (x, -z, y) for name, (x, y, z) in nodes.items()}
    number = {name: index for index, name in enumerate(nodes)}
    position_m = unit_m * np.array(list(nodes.values()))
    members: dict[bool, list[dict[str, Any]]] = {True: [], False: []}
    for group in groups:
        for a, b in group.pairs:
            length_m = float(np.linalg.norm(position_m[number[a]] - position_m[number[b]]))
            told = _rod(path, group, length_m, unit_m) if group.is_rod else _tendon(path, group, length_m, unit_m)
            members[group.is_rod].append({"nodes": [number[a], number[b]], **told})
    rods, tendons = members[True], members[False]
    if not rods or not tendons:
        raise InputError(f"{path}: expected rods and tendons, got {len(rods)} and {len(tendons)}")
    return {
        "structure": {
            "rods": [rod["nodes"] for rod in rods],
            "tendons": [tendon["nodes"] for tendon in tendons],
            "rod_length_m": [rod["length_m"] for rod in rods],
            "natural_length_m": [tendon["natural_length_m"] for tendon in tendons],
            "anchors": [],
            "anchor_position_m": [],
            "node_position_m": position_m.tolist(),
        },
        "mechanics": {
            "tendon_stiffness_n_per_m": [tendon["stiffness_n_per_m"] for tendon in tendons],
            "rod_mass_kg": [rod["mass_kg"] for rod in rods],
            "push_back": 0.0,
        },
    }


def _document(path: Path) -> dict[str, Any]:
    with needs_extra("a structure in YAML", "yaml"):
        import yaml
    check_regular(path, LARGEST_TOML_BYTES)
    try:
        document = _loader(yaml)(path.read_text(encoding="utf-8-sig")).get_single_data()
        size = _size(document, {})
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {reason_of(error)}") from error
    except (AttributeError, TypeError, LookupError) as error:  # of PyYAML
        raise InputError(f"{path}: is no YAML: a value is not what its tag says") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}: " if mark else ""
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"{path}: {place}is no YAML: {reason}") from error
    if not size < MOST_VALUES:
        raise InputError(f"{path}: expected fewer than {MOST_VALUES} values, got aliases that repeat each other")
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected nodes, connections or pair_groups, and builders, got no table")
    for name in ("substructures", "bond_groups"):
        if name in document:
            raise InputError(f"{path}: {name}: is not read: expected all nodes and members in this file")
    return document


def _loader(yaml: Any) -> Any:
    """Return PyYAML's safe loader, which also reads `1e-05` as a number, and refuses a key that comes twice."""

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        def compose_mapping_node(self, anchor: Any) -> Any:
            node = super().compose_mapping_node(anchor)
            known: set[tuple[str, str]] = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if (key.tag, key.value) in known:
                    raise yaml.constructor.ConstructorError(
                        problem=f"the key '{key.value}' comes twice", problem_mark=key.start_mark
                    )
                known.add((key.tag, key.value))
            return node

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", REAL_NUMBER, list("+-.0123456789"))
    return Loader


def _size(value: object, known: dict[int, float]) -> float:
    """Return the number of keys and values in a document, aliases written out; infinite for one that holds itself.

    Raises:
        ValueError: for a whole number of more than 64 bits, with which neither NumPy computes nor Python shows it.
    """
    if isinstance(value, int) and value.bit_length() >= INTEGER_BITS:
        raise ValueError(f"expected whole numbers of {INTEGER_BITS} bits, got one of {value.bit_length()} bits")
    if not isinstance(value, dict | list):
        return 1.0
    if id(value) not in known:
        known[id(value)] = np.inf
        parts = chain(value, value.values()) if isinstance(value, dict) else value
        known[id(value)] = 1.0 + sum(_size(part, known) for part in parts)
    return known[id(value)]


def _table(path: Path, document: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Return the first of several tables that a file has."""
    for name in names:
        if name in document:
            if not isinstance(document[name], dict):
                raise InputError(f"{path}: {name}: expected a table, got {document[name]!r:.60}")
            return {str(key): value for key, value in document[name].items()}
    raise InputError(f"{path}: {' or '.join(names)}: is missing")


def _builders(path: Path, document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    builders = _table(path, document, "builders")
    for name, builder in builders.items():
        if not isinstance(builder, dict) or not isinstance(builder.get("parameters", {}), dict):
            raise InputError(f"{path}: builders.{name}: expected a table of parameters, got {builder!r:.60}")
    return builders


def _nodes(path: Path, document: Mapping[str, Any]) -> dict[str, tuple[float, float, float]]:
    nodes: dict[str, tuple[float, float, float]] = {}
    for name, value in _table(path, document, "nodes").items():
        numbers = value if isinstance(value, list) else []
        if len(numbers) != 3 or not all(_is_number(part) for part in numbers):
            expected = f"three numbers of a magnitude of at most {LARGEST_NUMBER:g}"
            raise InputError(f"{path}: nodes.{name}: expected {expected}, got {value!r:.60}")
        nodes[name] = (float(numbers[0]), float(numbers[1]), float(numbers[2]))
    return nodes


def _is_number(value: object) -> bool:
    """Return whether a value is a number with which can be computed."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER


def _groups(path: Path, document: Mapping[str, Any], nodes: Mapping[str, Any]) -> Iterator[_Members]:
    builders = _builders(path, document)
    key = "pair_groups" if "pair_groups" in document else "connections"
    for name, value in _table(path, document, "pair_groups", "connections").items():
        if name not in builders:
            raise InputError(f"{path}: {key}.{name}: expected a builder of this name, got {', '.join(builders)}")
        builder = builders[name]
        words = " ".join(str(builder.get(word, "")) for word in ("class", "type")).lower()
        kinds = [
            (any(word in text for word in ROD_WORDS), any(word in text for word in TENDON_WORDS))
            for text in (words, name.lower())
        ]
        is_rod, is_tendon = next((kind for kind in kinds if kind[0] != kind[1]), (False, False))
        if is_rod == is_tendon:
            raise InputError(f"{path}: builders.{name}: expected a class or type that names rods or strings, got none")
        parameters = {**builder, **builder.get("parameters", {})}
        pairs = _pairs(path, f"{key}.{name}", value, nodes)
        yield _Members(name, is_rod, pairs, parameters)


def _pairs(path: Path, here: str, value: object, nodes: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    if not isinstance(value, list):
        raise InputError(f"{path}: {here}: expected a list of node pairs, got {value!r:.60}")
    pairs = []
    for index, member in enumerate(value):
        if isinstance(member, dict) and len(member) == 1:  # a member with a name
            (member,) = member.values()
        names = [str(name) for name in member] if isinstance(member, list) else []
        if len(names) != 2:
            raise InputError(f"{path}: {here}[{index}]: expected two nodes, got {member!r:.60}")
        for name in names:
            if name not in nodes:
                raise InputError(f"{path}: {here}[{index}]: there is no node {name}")
        pairs.append((names[0], names[1]))
    return tuple(pairs)


def _parameter(path: Path, group: _Members, name: str, default: float | None = None) -> float:
    value = group.parameters.get(name, default)
    if value is None:
        raise InputError(f"{path}: builders.{group.name}.{name}: is missing")
    if not _is_number(value) or value < 0:
        expected = f"a number from 0 to {LARGEST_NUMBER:g}"
        raise InputError(f"{path}: builders.{group.name}.{name}: expected {expected}, got {value!r:.60}")
    return float(value)


def _rod(path: Path, group: _Members, length_m: float, unit_m: float) -> dict[str, float]:
    """Return length and mass of a rod, from its mass, or from radius and density, which are in the file's unit."""
    volume = np.pi * _parameter(path, group, "radius", 0.0) ** 2 * length_m / unit_m
    mass_kg = _parameter(path, group, "mass", float(_parameter(path, group, "density", 0.0) * volume))
    return {"length_m": length_m, "mass_kg": mass_kg}


def _tendon(path: Path, group: _Members, length_m: float, unit_m: float) -> dict[str, float]:
    stiffness = _parameter(path, group, "stiffness")
    if stiffness == 0:
        raise InputError(f"{path}: builders.{group.name}.stiffness: expected a number above 0, got 0")
    pretension_n = unit_m * _parameter(path, group, "pretension", 0.0)
    natural_m = _parameter(path, group, "initial_length_ratio", 1.0) * length_m - pretension_n / stiffness
    if natural_m <= 0:
        raise InputError(
            f"{path}: builders.{group.name}.pretension: expected less than {stiffness * length_m / unit_m:.4g}, which "
            f"takes the whole length of a tendon, got {pretension_n / unit_m:.4g}"
        )
    return {"natural_length_m": natural_m, "stiffness_n_per_m": stiffness}
