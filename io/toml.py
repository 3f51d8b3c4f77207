"""TOML: reading files and settings, finding the line of a key, and writing tables with comments."""

import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomlkit

from ..models.settings import Settings
from ..models.values.errors import InputError, reason_of
from ..models.values.tables import parse_table, unknown_keys
from .input_files import LARGEST_TOML_BYTES, check_regular

Kind = TypeVar("Kind")
DEEPEST = 64
"""Number of tables and lists within one another above which a file is not read on; a plan has four. What walks through
a table calls itself at each level, and the time that a dotted key takes grows with the square of its parts."""
_DEEP_KEY = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
INTEGER_BITS = 64
"""Size of a whole number in TOML, with its sign. Python reads larger ones, but neither computes with them nor shows
them."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return a TOML file's contents.

    Raises:
        InputError: when it is missing or not TOML, or holds more tables within one another, or larger whole numbers,
            than a file of numbers needs.
    """
    check_regular(path, LARGEST_TOML_BYTES)
    try:
        text = path.read_text(encoding="utf-8-sig")
        if _DEEP_KEY.search(text):
            raise ValueError(f"expected a key of at most {DEEPEST} parts")
        table = _parsed(text)
        _check_values(table)
    except (OSError, ValueError) as error:  # no text, or no TOML
        raise InputError(f"{path}: cannot be read as TOML: {reason_of(error)}") from error
    return table


def _parsed(text: str) -> dict[str, Any]:
    """Return the contents of a text of TOML.

    Raises:
        ValueError: when it is none, or holds what Python does not read.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError as error:
        raise ValueError(f"expected at most {DEEPEST} tables and lists within one another") from error
    except ValueError as error:  # Python makes no number of thousands of decimal digits
        longest = max(re.finditer(r"[0-9_]+", text), key=lambda found: len(found[0]))
        line = text.count("\n", 0, longest.start()) + 1
        expected = f"expected a whole number of {INTEGER_BITS} bits, with its sign"
        raise ValueError(f"line {line}: {expected}, got one of {len(longest[0])} digits") from error


def _check_values(table: dict[str, Any]) -> None:
    """Raise ValueError for a whole number that is too large, or for values that lie too deep."""
    left: list[tuple[Any, str, int]] = [(table, "", 0)]
    while left:
        value, key, depth = left.pop()
        if isinstance(value, dict | list):
            if depth > DEEPEST:
                raise ValueError(f"{key[:DEEPEST]}...: expected at most {DEEPEST} tables and lists within one another")
            if isinstance(value, dict):
                left += [(part, f"{key}.{name}" if key else name, depth + 1) for name, part in value.items()]
            else:
                left += [(part, f"{key}[{index}]", depth + 1) for index, part in enumerate(value)]
        elif isinstance(value, int) and not -(1 << INTEGER_BITS - 1) <= value < 1 << INTEGER_BITS - 1:
            got = f"one of {value.bit_length()} bits"
            raise ValueError(f"{key}: expected a whole number of {INTEGER_BITS} bits, with its sign, got {got}")


def read_settings(path: Path | None) -> Settings:
    """Return the settings of a configuration file, or the defaults; see `read_as`."""
    return read_as(Settings, path, "is no setting; a run's run.toml lists them all")


def read_as(kind: type[Kind], path: Path | None, unknown: str) -> Kind:
    """Return the tables of a file as a dataclass, or its defaults without a file.

    Args:
        kind: the dataclass.
        path: of the file.
        unknown: what an error says of a key that it does not have.

    Raises:
        InputError: for a file that cannot be read, an unknown key, or a value that is not allowed.
    """
    if path is None:
        return kind()
    table = read_toml(path)
    for key in unknown_keys(kind, table):
        raise InputError(f"{path}: {key.name}: {unknown}{key.hint}")
    return parse_table(kind, table, str(path))


LONG_STATEMENT = 1000
"""Number of characters of a statement above which it is not parsed anew with each line, but when its brackets close."""
MOST_PARSED = 1 << 21
"""Number of characters that are parsed until the search for lines ends, some two seconds; a text of thousands of lines
between quotes would be parsed anew with each of them."""


def line_of(text: str, key: str) -> int:
    """Return the line, counted from 1, of a dotted key in a TOML file, or of the innermost table around it.

    Args:
        text: of a file that is TOML.
        key: like `load.press[1].force_n`.
    """
    lines = _lines_of_keys(text)
    key = key if key in lines or f"{key}[0]" not in lines else f"{key}[0]"  # the first of several tables
    while key and key not in lines:
        key = key[: max(key.rfind("."), key.rfind("["), 0)]
    return lines.get(key, 1)


def _lines_of_keys(text: str) -> dict[str, int]:
    """Return the line of every key, as far as they are found before `MOST_PARSED` characters were parsed.

    A statement is the shortest group of lines that is valid TOML.
    """
    lines: dict[str, int] = {}
    table = ""
    statement: list[str] = []
    size = open_brackets = tried = 0
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
        tried += size
        if tried > MOST_PARSED:
            break
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


def commented(tables: Mapping[str, Any], comments: Mapping[str, str]) -> str:
    """Return tables as the text of a TOML file, with comments beside some keys.

    Args:
        tables: by name.
        comments: by table and key, such as "rest.seconds"; those of keys that are not there are left out.
    """
    document = tomlkit.item(dict(tables))
    for name, comment in comments.items():
        table, key = name.split(".")
        if key in document.get(table, {}):
            document[table][key].comment(comment)
    return str(document.as_string())
