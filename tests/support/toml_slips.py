"""Slips in TOML, such as in trial.toml: values of another type, arrays of another length, units of several keys."""

import datetime
import random
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import tomli_w

Change = Callable[[str, random.Random], str]

FACTORS = (1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12, -1.0, 60.0, 2.54, 0.0174533, 9.81, 2.0, 0.5)
ODD_VALUES: tuple[Any, ...] = (
    *(datetime.date(2026, 1, 1), datetime.datetime(2026, 1, 1, 12), datetime.time(12, 30), {"x": {"y": []}}, [[[[1]]]]),
    *([True, False], [{}], ["1"], [1, "a"], [[], [1]], "nan", "0.3", "a" * 5000, "a\nb", "\u202e", 2**63, -(2**63)),
    *(1e-12, 1e12, 1e6, 255, 256, 64, -0.0, 1e-6, 100_000),
)
ODD_NAMES = (
    *("", ".", "..", "trial.toml", "board0.csv\n", "a" * 300, "./board0.csv", "x/../board0.csv", " board0.csv"),
    *("truth.csv", "config.toml", "BOARD0.CSV", "board0.csv/", "~", "$HOME", "file:board0.csv", "model.safetensors"),
)
ABSURD = {
    "stiffness": (1e6, 1e-6, 1e3),
    "mass": (1e6, 1e3, 1e-9),
    "sigma": (1e-12, 1e12, 1e6),
    "rate": (1e6, 1e-6, 1e3),
    "seconds": (1e6, 1e-6, 100.0),
    "resistor": (1e6, 1e-6),
    "length": (10.0, 0.1, 3.0),
    "noise": (1e9, 1e-9),
    "": (1e4, 1e-4),
}
"""Factors of the numbers whose key has a word: each is a number that is allowed, beside others that it cannot fit."""


def places(table: Any, key: str = "") -> Iterator[tuple[Any, Any, str]]:
    """Yield holder, key and name of every value of tables and lists, tables and lists themselves included."""
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for name, value in items:
        called = name if isinstance(name, str) else key
        yield table, name, called
        if isinstance(value, dict | list):
            yield from places(value, called)


def with_tables(text: str, rng: random.Random, change: Callable[[Any, list[tuple[Any, Any, str]]], object]) -> str:
    """Return TOML whose parsed tables were changed in place; the text itself where it is no TOML any more."""
    try:
        table = tomllib.loads(text)
        found = list(places(table))
        if found:
            change(table, found)
        return tomli_w.dumps(table)
    except (ValueError, TypeError, RecursionError, AttributeError, OverflowError):
        return text


def value_odd(text: str, rng: random.Random) -> str:
    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        holder, key, _ = rng.choice(found)
        holder[key] = rng.choice(ODD_VALUES)

    return with_tables(text, rng, change)


def value_retyped(text: str, rng: random.Random) -> str:
    """The same value as a string, a list of itself, a whole number, a fraction, a truth value."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        holder, key, _ = rng.choice(found)
        value = holder[key]
        kinds = [str, lambda v: [v], lambda v: [v, v], lambda v: {"value": v}, bool]
        if isinstance(value, int | float):
            kinds += [int, float]
        holder[key] = rng.choice(kinds)(value)

    return with_tables(text, rng, change)


def array_changed(text: str, rng: random.Random) -> str:
    """One element more or less, the order turned, rows for columns."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        arrays = [(holder, key) for holder, key, _ in found if isinstance(holder[key], list) and holder[key]]
        if not arrays:
            return
        holder, key = rng.choice(arrays)
        array = holder[key]
        at = rng.randrange(len(array))
        choices = [
            array[:at] + array[at + 1 :],
            array[:at] + array[at : at + 1] + array[at:],
            array[::-1],
            array[1:] + array[:1],
            [],
            array * 2,
            array[:at] + [array[at]] * (len(array) - at),
            rng.sample(array, len(array)),
        ]
        if all(isinstance(part, list) for part in array):
            choices += [[list(row) for row in zip(*array, strict=False)], [part for row in array for part in row]]
        holder[key] = rng.choice(choices)

    return with_tables(text, rng, change)


def values_exchanged(text: str, rng: random.Random) -> str:
    """Two values of one type change places, wherever they are."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        holder, key, _ = rng.choice(found)
        alike = [one for one in found if type(one[0][one[1]]) is type(holder[key])]
        other, other_key, _ = rng.choice(alike)
        holder[key], other[other_key] = other[other_key], holder[key]

    return with_tables(text, rng, change)


def index_changed(text: str, rng: random.Random) -> str:
    """Another node, tendon, rod or board, one that there is."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        whole = [(h, k) for h, k, _ in found if isinstance(h[k], int) and not isinstance(h[k], bool)]
        if whole:
            holder, key = rng.choice(whole)
            holder[key] = rng.choice((rng.randrange(-1, 13), rng.randrange(-1, 25)))

    return with_tables(text, rng, change)


def key_moved(text: str, rng: random.Random) -> str:
    """A key under another name, or in another table."""

    def change(table: Any, found: list[tuple[Any, Any, str]]) -> None:
        tables = [table, *(h[k] for h, k, _ in found if isinstance(h[k], dict))]
        holder = rng.choice([one for one in tables if one])
        key = rng.choice(list(holder))
        name = rng.choice((key, key, key.upper(), f" {key}", key + "s", "x" * 3000, "file", "__class__", ""))
        rng.choice(tables)[name] = holder.pop(key)

    return with_tables(text, rng, change)


def numbers_absurd(text: str, rng: random.Random) -> str:
    """All numbers of one, two or three keys times allowed but absurd factors."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        keys = sorted({name for holder, key, name in found if isinstance(holder[key], int | float)})
        for name in rng.sample(keys, min(len(keys), rng.choice((1, 1, 2, 3)))):
            factor = rng.choice(next(factors for word, factors in ABSURD.items() if word in name))
            _scale(found, factor, lambda called, name=name: called == name)

    return with_tables(text, rng, change)


def unit_slipped(text: str, rng: random.Random) -> str:
    """All numbers of one unit, as in a lab that counts in millimetres throughout."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        unit = rng.choice(("_m", "_s", "_n_per_m", "_kg", "_ohm", "_n", "_rad", "_hz", "seconds"))
        _scale(found, rng.choice(FACTORS), lambda called: called.endswith(unit))

    return with_tables(text, rng, change)


def _scale(found: list[tuple[Any, Any, str]], factor: float, which: Callable[[str], bool]) -> None:
    for holder, key, called in found:
        if which(called) and isinstance(holder[key], float | int) and not isinstance(holder[key], bool):
            holder[key] = holder[key] * factor


def name_odd(text: str, rng: random.Random) -> str:
    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        words = [(holder, key) for holder, key, _ in found if isinstance(holder[key], str)]
        if words:
            holder, key = rng.choice(words)
            holder[key] = rng.choice((*ODD_NAMES, rng.choice(words)[0].get("file", "x")))

    return with_tables(text, rng, change)


def key_twice(text: str, rng: random.Random) -> str:
    """A line again with another value, a table opened twice, a key dotted into a value."""
    lines = [line for line in text.splitlines() if "=" in line or line.startswith("[")]
    if not lines:
        return text
    line = rng.choice(lines)
    key = line.split("=")[0].strip()
    return text + "\n" + rng.choice((line, f"{key}.x = 1", f"[{key}]", f"[[{key.strip('[]')}]]", f"{key} = 1")) + "\n"


def rank_changed(text: str, rng: random.Random) -> str:
    """A number as a list, a list in a list, the rows of a matrix one after another, all numbers of a key in lists."""

    def change(_: Any, found: list[tuple[Any, Any, str]]) -> None:
        holder, key, _ = rng.choice([one for one in found if isinstance(one[0][one[1]], list | int | float)] or found)
        value = holder[key]
        choices = [[value], [[value]], [value, value]]
        if isinstance(value, list):
            choices += [[[part] for part in value], value[0] if value else [], dict(enumerate_as_keys(value))]
        holder[key] = rng.choice(choices)

    return with_tables(text, rng, change)


def enumerate_as_keys(array: list[Any]) -> Iterator[tuple[str, Any]]:
    return ((str(index), part) for index, part in enumerate(array))


def block_again(text: str, rng: random.Random) -> str:
    """A table with all of its keys once more, at the end or where it stands."""
    blocks = ["[" + block for block in text.split("\n[")]
    blocks[0] = blocks[0][1:]
    block = rng.choice(blocks[1:] or blocks)
    blocks.insert(rng.choice((len(blocks), blocks.index(block))), block)
    return "\n".join(blocks)


TOML: tuple[Change, ...] = (
    *((value_odd, value_retyped, array_changed, values_exchanged, index_changed, numbers_absurd) * 4),
    *((key_moved, unit_slipped, name_odd, key_twice, rank_changed, block_again) * 2),
)
