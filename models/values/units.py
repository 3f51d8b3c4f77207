"""The range of each quantity in a user's file: numbers beyond it are a wrong unit or a damaged file.

The unit is the end of a name, as in `rod_length_m`. A range is wider than any laboratory: it keeps arithmetic finite.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .errors import InputError

LARGEST = {
    "n_per_m": 1e9,
    "m_per_s2": 1e6,
    "m_per_s": 1e5,
    "rad_per_s": 1e5,
    "kg_m2": 1e6,
    "m": 1e4,
    "s": 1e11,  # a stamp may count from 1970
    "us": 1e16,
    "ohm": 1e13,
    "volt": 1e4,
    "kg": 1e5,
    "hz": 1e6,
    "n": 1e7,
    "rad": 1e4,
}
"""The largest magnitude of a number in each unit."""
LARGEST_NUMBER = 1e15
"""The largest magnitude of a number without a unit: up to it, every whole number is exact."""
OTHER_UNIT = 100.0
"""Ratio of two numbers that ought to be alike, above which one of them is in another unit: a thousandth or a thousand
times as large."""


def largest(name: str) -> float:
    """Return the largest magnitude that a number of this name may have."""
    words = name.split("_")
    units = ("_".join(words[first:]) for first in range(1, len(words)))
    return next((LARGEST[unit] for unit in units if unit in LARGEST), LARGEST_NUMBER)


def beyond(value: float, limit: float) -> str:
    """Return what is wrong with a number beyond its range."""
    got = f"{value:.6g}" if isinstance(value, float) else f"a number of {len(str(abs(value)))} digits"
    return f"expected a magnitude of at most {limit:g}, got {got}: is the unit right?"


def check_ranges(table: Mapping[str, Any]) -> None:
    """Check every number of a table, as from TOML; infinite ones are left to those who know whether they are allowed.

    Raises:
        InputError: with the key of the number.
    """
    for key, name, value in _numbers(table, "", ""):
        limit = largest(name)
        if abs(value) > limit and not (isinstance(value, float) and math.isinf(value)):
            raise InputError(f"{key}: {beyond(value, limit)}")


def _numbers(value: Any, key: str, name: str) -> Iterator[tuple[str, str, float]]:
    """Yield the dotted key, the name and the value of each number."""
    if isinstance(value, Mapping):
        for inner, part in value.items():
            yield from _numbers(part, f"{key}.{inner}" if key else inner, inner)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, part in enumerate(value):
            yield from _numbers(part, f"{key}[{index}]", name)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield key, name, value
