"""Writes the table of licences into reference/licences.md, from the metadata of the installed packages.

    python docs/licences.py

All extras have to be installed. What metadata does not say by itself stands in `NOTES` and `BY_FILE`.
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "licences.md"
TABLE = re.compile(r"\| package \|.*?\n(?=\n)", re.DOTALL)
PURPOSE = {"test": "tests", "dev": "development"}
"""What extras are for that are not of use to a user."""
NOTES = {
    "torch": "imported by `calibrate` alone",
    "imageio-ffmpeg": "it brings a build of FFmpeg under the GPL",
}
BY_FILE = {
    "cobs": "MIT",
    "ezc3d": "MIT",
    "h5netcdf": "BSD-3-Clause",
    "matplotlib": "Matplotlib licence (like that of Python)",
    "pyserial": "BSD-3-Clause",
    "scipy": "BSD-3-Clause",
}
"""Licences of packages whose metadata holds none, its whole text, or no more than "BSD": as their licence files say."""
SPDX = {"Simplified BSD license": "BSD-2-Clause", "MIT License": "MIT", "Apache Software License": "Apache-2.0"}
"""Identifiers of what older metadata calls by name."""


def needed() -> Iterator[tuple[str, str]]:
    """Yield the name of each package that pyproject.toml names, and what needs it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"everything": project["dependencies"]}
    groups |= {PURPOSE.get(k, f"extra `{k}`"): names for k, names in project["optional-dependencies"].items()}
    seen = {"tensegraph"}
    for purpose, requirements in groups.items():
        for name in sorted((re.split(r"[^\w-]", requirement)[0] for requirement in requirements), key=str.lower):
            if name not in seen:
                yield name, purpose
            seen.add(name)


def licence(name: str) -> str:
    """Return the licence of an installed package, by its expression, its field, or its classifiers.

    Raises:
        PackageNotFoundError: for a package that is not installed.
        LookupError: for one whose metadata does not tell.
    """
    about = metadata(name)
    classifiers = [text.rpartition(" :: ")[2] for text in about.get_all("Classifier", []) if "License ::" in text]
    told = [about.get("License-Expression"), BY_FILE.get(name), about.get("License"), ", ".join(classifiers)]
    for text in told:
        if text and text != "UNKNOWN" and "\n" not in text:
            return SPDX.get(text, text)
    raise LookupError(f"{name}: its metadata tells no licence: see its files, and add it to BY_FILE")


def rows() -> Iterator[str]:
    """Yield the rows of the Markdown table."""
    yield "| package | licence | needed by |"
    yield "|---|---|---|"
    for name, purpose in needed():
        note = f", {NOTES[name]}" if name in NOTES else ""
        yield f"| {name} | {licence(name)} | {purpose}{note} |"


if __name__ == "__main__":
    try:
        table = "\n".join(rows()) + "\n"
    except PackageNotFoundError as error:
        sys.exit(f"{error.name}: is not installed: pip install -e '.[all,cluster,test,dev,docs]'")
    except LookupError as error:
        sys.exit(str(error))
    PAGE.write_text(TABLE.sub(lambda _: table, PAGE.read_text(encoding="utf-8")), encoding="utf-8")
