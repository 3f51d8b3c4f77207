"""The origin of a result: versions of software, and the path to its trial."""

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path


def versions(solver: str = "gtsam") -> dict[str, str]:
    """Return the versions of the software that made a result; for a model, `solver` is torch."""
    packages = ("tensegraph", solver, "numpy", "scipy")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def relative_path(start: Path, end: Path) -> str:
    """Return the path from one directory to another, relative, so that both may be moved together."""
    return Path(os.path.relpath(end.resolve(), start.resolve())).as_posix()


def simulation_provenance(plan: Path, seed: int) -> str:
    """Return the text in trial.toml that describes the origin of a simulated trial."""
    return f"simulated: tensegraph {version('tensegraph')}, plan {plan.name}, seed {seed}"
