"""The example package `examples/own_parts`, installed as pip would: its module, and what tells of its entry points."""

import shutil
import tomllib
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "examples" / "own_parts"


def install(name: str, version: str, entry_points: dict[str, dict[str, str]], place: Path) -> None:
    """Write the `dist-info` folder of a package into a directory, which stands on the path of Python's modules."""
    info = place / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    groups = (
        f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in parts.items()) for group, parts in entry_points.items()
    )
    (info / "entry_points.txt").write_text("\n".join(groups))


def install_example(place: Path) -> None:
    """Install the example package into a directory."""
    project = tomllib.loads((SOURCE / "pyproject.toml").read_text())["project"]
    install(project["name"], project["version"], project["entry-points"], place)
    shutil.copy(SOURCE / "own_parts.py", place)
