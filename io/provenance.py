"""The origin of a result: versions of software, the path to its trial, and a hash of all that it was made from."""

import hashlib
import json
import os
import platform
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..models.plug_ins import PlugIn
from .input_files import check_beginning, check_regular, real_path
from .model_file import model_path
from .shape_network_file import shape_network_path
from .toml import read_toml

FINGERPRINT = "fingerprint"
"""Key in the TOML file of a result: the hash of all that it was made from."""
PACKAGE = Path(__file__).parents[1]
FOLDERS = ("commands", "estimator", "factors", "io", "live", "models", "scoring")


def versions(solver: str = "gtsam") -> dict[str, str]:
    """Return the versions of the software that made a result; for a model, `solver` is torch."""
    packages = ("tensegraph", solver, "numpy", "scipy")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and bytes of all files of a directory.

    Raises:
        InputError: for what is neither, or is no file in the directory, such as a pipe; and for one that does not
            begin as its name says.
    """
    digest = hashlib.sha256()
    for part in sorted(path.iterdir()) if path.is_dir() else [path]:
        check_regular(part)
        if part != path:
            digest.update(part.name.encode())
        check_beginning(part)
        with part.open("rb") as file:
            hashlib.file_digest(file, lambda: digest)
    return digest.hexdigest()


@cache
def code_hash() -> str:
    """Return the SHA-256 of the package's modules and data: two checkouts of one version may compute differently."""
    files = [path for folder in FOLDERS for path in (PACKAGE / folder).rglob("*")] + list(PACKAGE.glob("*.py"))
    digest = hashlib.sha256()
    for path in sorted(path for path in files if path.suffix in (".py", ".safetensors")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def model_tables(model: Path | None, method: str) -> dict[str, dict[str, str]]:
    """Return name and SHA-256 of each model file that a result is made with.

    Args:
        model: file of the sensor model; the one in the package if None.
        method: of the estimate; `network` has a model of its own.
    """
    files = {"model": model_path(model)} | ({"shape_network": shape_network_path()} if method == "network" else {})
    return {key: {"file": path.name, "sha256": sha256_of(path)} for key, path in files.items()}


def plug_in_tables(used: Iterable[PlugIn]) -> dict[str, dict[str, dict[str, str]]]:
    """Return, by kind and name, package, version and SHA-256 of each plug-in that a result was made with."""
    tables: dict[str, dict[str, dict[str, str]]] = {}
    for one in used:
        told = {"package": one.package, "version": one.version, "sha256": _sha256_of_module(one.entry.module)}
        tables.setdefault(one.kind, {})[one.entry.name] = told
    return tables


def _sha256_of_module(name: str) -> str:
    """Return the SHA-256 of the outermost package that a module is in, of all its files; of a module that is alone."""
    spec = find_spec(name.partition(".")[0])
    assert spec is not None, "the part has been imported"
    places = [Path(place) for place in spec.submodule_search_locations or [str(spec.origin)]]
    digest = hashlib.sha256()
    for place in places:
        files = place.rglob("*") if place.is_dir() else [place]
        for path in sorted(path for path in files if path.is_file() and path.suffix != ".pyc"):
            digest.update(path.relative_to(place.parent).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def fingerprint(made_from: Mapping[str, Any]) -> str:
    """Return the SHA-256 of inputs, settings and options of a result, and of the software that makes it.

    Args:
        made_from: values of JSON; paths are not among them, so that a result may be moved with its inputs.
    """
    everything = {"code": code_hash(), "versions": versions(), **made_from}
    return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


def is_up_to_date(file: Path, expected: str, trial_path: str | None = None) -> bool:
    """Return whether the same result stands already.

    Args:
        file: TOML file of the result, which has to have the fingerprint, and all tables that it names beside it.
        expected: the fingerprint.
        trial_path: where the trial has to be that the file names; anywhere if None.
    """
    if not file.is_file():
        return False
    made = read_toml(file)
    is_there = trial_path is None or made.get("trial_path") == trial_path
    whole = all((file.parent / str(name)).is_file() for name in made.get("tables", ()))
    return made.get(FINGERPRINT) == expected and is_there and whole


def file_hashes(directory: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a directory, by name."""
    return {path.name: sha256_of(path) for path in sorted(directory.iterdir()) if path.is_file()}


def relative_path(start: Path, end: Path) -> str:
    """Return the path from one directory to another, relative, so that both may be moved together."""
    return Path(os.path.relpath(real_path(end), real_path(start))).as_posix()


def simulation_provenance(plan: Path, seed: int) -> str:
    """Return the text in trial.toml that describes the origin of a simulated trial."""
    return f"simulated: tensegraph {version('tensegraph')}, plan {plan.name}, seed {seed}"
