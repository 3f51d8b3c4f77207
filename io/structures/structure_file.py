"""Structure files: TOML of our own, MuJoCo's MJCF, and YAML of tensegrity simulators, all read as our own tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...models.structure_description import DescribedStructure, describe_structure
from ...models.values.errors import InputError
from ..toml import read_toml
from .mjcf_structure import mjcf_tables
from .yaml_structure import yaml_tables

READ_TABLES = ("structure", "body", "mechanics", "rest")
"""What a structure file tells; other tables of a trial.toml are not read."""


def read_structure(path: str | Path, *, unit_m: float = 1.0) -> DescribedStructure:
    """Return the structure that a file describes.

    Args:
        path: of a structure file or trial.toml (.toml), a MuJoCo model (.xml), or a simulator's file (.yaml, .yml).
        unit_m: unit of the lengths in a YAML file, which do not say it; NTRT's are often in decimetres, 0.1.

    Raises:
        InputError: for a file that cannot be read, or describes no structure; the text names the file and the place.
    """
    return describe_structure(structure_tables(Path(path), unit_m), str(path))


def structure_tables(path: Path, unit_m: float) -> dict[str, Any]:
    """Return the tables `structure`, `body`, `mechanics` and `rest` of a structure file, as in trial.toml.

    Raises:
        InputError: for a file that cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in (".toml", ".xml", ".mjcf", ".yaml", ".yml"):
        raise InputError(f"{path}: expected a structure file: .toml, .xml, .yaml or .yml")
    if suffix not in (".yaml", ".yml") and unit_m != 1.0:
        raise InputError(f"{path}: unit_m: expected none, lengths are in metres: only YAML files have another unit")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if suffix == ".toml":
        told = read_toml(path)
        return {name: table for name, table in with_structure_file(told, path).items() if name in READ_TABLES}
    return yaml_tables(path, unit_m) if suffix in (".yaml", ".yml") else mjcf_tables(path)


def with_structure_file(
    told: Mapping[str, Any], path: Path, others: Sequence[str] = ("body", "mechanics", "rest")
) -> dict[str, Any]:
    """Return the tables of a trial.toml or a plan with those of the file that `[structure] file` names.

    Keys that stand beside `file` replace those of the file, and so do `[[body]]` and the keys of other tables.

    Args:
        told: the parsed file.
        path: of this file.
        others: the tables that are taken from the structure file beside `structure`.

    Raises:
        InputError: when the structure file cannot be read, or names a file itself.
    """
    structure = told.get("structure")
    if not isinstance(structure, dict) or "file" not in structure:
        return dict(told)
    name, unit_m = structure["file"], structure.get("unit_m", 1.0)
    if not isinstance(name, str) or not isinstance(unit_m, int | float) or not 0 < unit_m < float("inf"):
        raise InputError(
            f"{path}: structure: expected the name of a file, and unit_m above 0, got {name!r}, {unit_m!r}"
        )
    file = path.parent / name
    if file.suffix.lower() == ".toml":
        of_file = read_toml(file).get("structure", {})
        if not isinstance(of_file, dict):
            raise InputError(f"{file}: structure: expected a table, got {of_file!r:.60}")
        if "file" in of_file:
            raise InputError(f"{file}: structure.file: expected a file that tells the structure itself")
    below = structure_tables(file, float(unit_m))
    own = {key: value for key, value in structure.items() if key not in ("file", "unit_m")}
    merged = {"structure": {**below["structure"], **own}} if "structure" in below else {"structure": own}
    for table in set(others) & below.keys():
        beside = told.get(table, below[table])
        both = isinstance(below[table], dict) and isinstance(beside, dict)
        merged[table] = {**below[table], **beside} if both else beside
    return {**told, **merged}
