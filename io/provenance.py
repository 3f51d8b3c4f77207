"""The origin of a result: versions of software, the path to its trial, and a hash of all that it was made from."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from .toml import read_toml

FINGERPRINT = "fingerprint"
"""Key in the TOML file of a result: the hash of all that it was made from."""
PACKAGE = Path(__file__).parents[1]
FOLDERS = ("commands", "estimator", "factors", "io", "live", "models")


def versions(solver: str = "gtsam") -> dict[str, str]:
    """Return the versions of the software that made a result; for a model, `solver` is torch."""
    packages = ("tensegraph", solver, "numpy", "scipy")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def code_hash() -> str:
    """Return the SHA-256 of the package's modules and data: two checkouts of one version may compute differently."""
    files = [path for folder in FOLDERS for path in (PACKAGE / folder).rglob("*")] + list(PACKAGE.glob("*.py"))
    digest = hashlib.sha256()
    for path in sorted(path for path in files if path.suffix in (".py", ".safetensors")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def fingerprint(made_from: Mapping[str, Any]) -> str:
    """Return the SHA-256 of inputs, settings and options of a result, and of the software that makes it.

    Args:
        made_from: values of JSON; paths are not among them, so that a result may be moved with its inputs.
    """
    everything = {"code": code_hash(), "versions": versions(), **made_from}
    return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


def is_up_to_date(file: Path, expected: str) -> bool:
    """Return whether a result's TOML file exists and has the expected fingerprint."""
    return file.is_file() and read_toml(file).get(FINGERPRINT) == expected


def file_hashes(directory: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a directory, by name."""
    return {path.name: sha256_of(path) for path in sorted(directory.iterdir()) if path.is_file()}


def relative_path(start: Path, end: Path) -> str:
    """Return the path from one directory to another, relative, so that both may be moved together."""
    return Path(os.path.relpath(end.resolve(), start.resolve())).as_posix()


def simulation_provenance(plan: Path, seed: int) -> str:
    """Return the text in trial.toml that describes the origin of a simulated trial."""
    return f"simulated: tensegraph {version('tensegraph')}, plan {plan.name}, seed {seed}"
