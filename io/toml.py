"""Reading TOML files, and finding the line of a key."""

import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

from ..models.settings import Settings
from ..models.values.errors import InputError
from ..models.values.tables import parse_table, unknown_keys
from .input_files import LARGEST_TOML_BYTES, check_regular


def read_toml(path: Path) -> dict[str, Any]:
    """Return a TOML file's contents.

    Raises:
        InputError: when it is missing or not TOML.
    """
    check_regular(path, LARGEST_TOML_BYTES)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:  # no text, no TOML, or an integer of thousands of digits
        raise InputError(f"{path}: cannot be read as TOML: {error}") from error


def read_settings(path: Path | None) -> Settings:
    """Return the settings of a configuration file, or the defaults.

    Raises:
        InputError: for a file that cannot be read, an unknown setting, or a value that is not allowed.
    """
    if path is None:
        return Settings()
    table = read_toml(path)
    for key in unknown_keys(Settings, table):
        raise InputError(f"{path}: {key}: is no setting; a run's run.toml lists them all")
    return parse_table(Settings, table, str(path))


LONG_STATEMENT = 1000
"""Number of characters of a statement above which it is not parsed anew with each line, but when its brackets close."""


def line_of(text: str, key: str) -> int:
    """Return the line, counted from 1, of a dotted key in a TOML file, or of the innermost table around it.

    Args:
        text: of a file that is TOML.
        key: like `load.press[1].force_n`.
    """
    lines = _lines_of_keys(text)
    while key and key not in lines:
        key = key[: max(key.rfind("."), key.rfind("["), 0)]
    return lines.get(key, 1)


def _lines_of_keys(text: str) -> dict[str, int]:
    """Return the line of every key; a statement is the shortest group of lines that is valid TOML."""
    lines: dict[str, int] = {}
    table = ""
    statement: list[str] = []
    size = open_brackets = 0
    first = 1
    seen = Counter[str]()
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        if not statement:
            first, size, open_brackets = number, 0, 0
        statement.append(line)
        size += len(line)
        open_brackets += line.count("[") - line.count("]")
        if size > LONG_STATEMENT and open_brackets:
            continue
        try:
            parsed: Any = tomllib.loads("".join(statement))
        except tomllib.TOMLDecodeError:
            continue  # a list or a string continues on the next line
        header = "".join(statement).lstrip().startswith("[")
        statement = []
        key = "" if header else table
        while isinstance(parsed, dict) and len(parsed) == 1:
            ((name, parsed),) = parsed.items()
            key = f"{key}.{name}" if key else name
            if isinstance(parsed, list) and header:
                seen[key] += 1
                key = f"{key}[{seen[key] - 1}]"
                parsed = parsed[0]
            lines.setdefault(key, first)
        table = key if header else table
    return lines
